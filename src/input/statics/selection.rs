//! Selection of nodes and axes by a fix or a load.

use crate::base::document::InvalidFile;
use crate::input::Cause;
use crate::mechanics::mesh::TetMesh;

/// An invalid selection of nodes or axes, with the key concerned.
pub(crate) type Odd = Box<(String, Cause)>;

pub(super) const AXES: [char; 3] = ['x', 'y', 'z'];

/// Node selection of a table: by number, or as the intersection of a box, regions and the surface, where given.
#[derive(Debug)]
pub(crate) struct Choice<'a> {
    pub nodes: Option<&'a [i64]>,
    pub box_mm: Option<&'a [[f64; 3]; 2]>,
    /// Numbers of regions.
    pub regions: Option<&'a [i32]>,
    /// Whether only nodes of the mesh surface are selected, or of the part of it in these regions.
    pub surface: bool,
}

impl Choice<'_> {
    /// Selected nodes, ascending unless by number; `table` is the key of the table.
    pub fn select(&self, table: &str, mesh: &TetMesh) -> Result<Vec<u32>, Odd> {
        let others = self.box_mm.is_some() || self.regions.is_some() || self.surface;
        let expected = "`nodes`, or some of `box_mm`, `region` and `surface`";
        match self.nodes {
            Some(_) if others => Err(keys(table.to_owned(), "`nodes` beside another choice", expected)),
            Some([]) => Err(keys(format!("{table}.nodes"), "no nodes", "at least one")),
            Some(nodes) => numbered(&format!("{table}.nodes"), nodes, mesh.nodes().len()),
            None if others => self.everywhere(table, mesh),
            None => Err(keys(table.to_owned(), "no choice of nodes", expected)),
        }
    }

    fn everywhere(&self, table: &str, mesh: &TetMesh) -> Result<Vec<u32>, Odd> {
        let mut picked = vec![self.regions.is_none() && !self.surface; mesh.nodes().len()];
        let mut pick = |nodes: &[u32]| nodes.iter().for_each(|node| picked[*node as usize] = true);
        let of = |region: i32| self.regions.is_none_or(|regions| regions.contains(&region));
        if self.surface {
            let faces = mesh.surface().filter(|face| of(face.region));
            faces.for_each(|face| pick(&face.nodes));
        } else if self.regions.is_some() {
            let elements = mesh.elements().iter().zip(mesh.regions());
            let elements = elements.filter(|(_, region)| of(**region));
            elements.for_each(|(corners, _)| pick(corners));
        }
        if !picked.contains(&true) {
            let (found, expected) = match self.surface {
                true => ("no node on the surface", "a region on the surface of the mesh"),
                false => ("no node of this region", "a region that has elements in the mesh"),
            };
            return Err(keys(table.to_owned(), found, expected));
        }
        if let Some(corners) = self.box_mm {
            let key = format!("{table}.box_mm");
            let [low, high] = ordered(&key, corners)?;
            let held = picked.clone();
            for (picked, position) in picked.iter_mut().zip(mesh.nodes()) {
                *picked &= (0..3).all(|axis| low[axis] <= position[axis] && position[axis] <= high[axis]);
            }
            if !picked.contains(&true) {
                let nodes = held.iter().zip(mesh.nodes());
                let positions = nodes.filter(|(held, _)| **held).map(|(_, position)| *position);
                let expected = format!("a box that holds at least one of the nodes{}", extent(positions));
                return Err(keys(key, "no node in this box", expected));
            }
        }
        let nodes = (0..).zip(picked).filter(|(_, picked)| *picked);
        Ok(nodes.map(|(node, _)| node).collect())
    }
}

/// Parses letters into axes (0 to 2).
pub(crate) fn axes(table: &str, letters: &str) -> Result<Vec<u8>, Odd> {
    let place = |letter: char| AXES.iter().position(|axis| *axis == letter).map(|axis| axis as u8);
    let mut axes: Vec<u8> = letters.chars().filter_map(place).collect();
    axes.sort_unstable();
    axes.dedup();
    // Unknown and repeated letters are refused.
    if axes.is_empty() || axes.len() != letters.chars().count() {
        let expected = "some of the letters x, y and z, each once, such as \"xyz\" or \"z\"";
        return Err(keys(format!("{table}.axes"), format!("\"{letters}\""), expected));
    }
    Ok(axes)
}

fn keys(key: String, found: impl Into<String>, expected: impl Into<String>) -> Odd {
    Box::new((key, InvalidFile::keys(found, expected).into()))
}

pub(super) fn numbered(key: &str, nodes: &[i64], of: usize) -> Result<Vec<u32>, Odd> {
    let check = |(at, &found): (usize, &i64)| match u32::try_from(found) {
        Ok(node) if (node as usize) < of => Ok(node),
        _ => Err(Box::new((format!("{key}[{at}]"), Cause::Node { found, nodes: of }))),
    };
    nodes.iter().enumerate().map(check).collect()
}

/// Minimum and maximum corners of a box.
pub(crate) fn ordered(key: &str, corners: &[[f64; 3]; 2]) -> Result<[[f64; 3]; 2], Odd> {
    if let Some((at, found)) = first(corners.as_flattened(), |x| x.is_nan()) {
        let expected = "a coordinate, mm, or `inf` for an open side";
        return Err(Box::new((
            format!("{key}[{}][{}]", at / 3, at % 3),
            InvalidFile::number(found, expected).into(),
        )));
    }
    Ok([
        std::array::from_fn(|axis| corners[0][axis].min(corners[1][axis])),
        std::array::from_fn(|axis| corners[0][axis].max(corners[1][axis])),
    ])
}

fn first(numbers: &[f64], wrong: impl Fn(f64) -> bool) -> Option<(usize, f64)> {
    numbers.iter().copied().enumerate().find(|(_, number)| wrong(*number))
}

/// Describes the bounding box of nodes.
fn extent(positions: impl Iterator<Item = [f64; 3]>) -> String {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for position in positions {
        for axis in 0..3 {
            low[axis] = low[axis].min(position[axis]);
            high[axis] = high[axis].max(position[axis]);
        }
    }
    let along = |axis: usize| format!("{} to {} mm along {}", low[axis], high[axis], AXES[axis]);
    format!(", which lie from {}, {}, {}", along(0), along(1), along(2))
}
