//! Selection of nodes and axes by tables of scenarios and static problems.

use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use insonify_base::document::{InputError, InvalidFile, RegionName};
use insonify_base::range::{Ranges, parameters};
use insonify_mesh::TetMesh;

/// An invalid selection of nodes or axes, with the key concerned.
pub type SelectionError = Box<(String, InvalidFile)>;

/// Letters of the axes 0 to 2.
pub const AXES: [char; 3] = ['x', 'y', 'z'];

/// Default distance of a node from the wall of a cylinder, mm.
const WITHIN_MM: f64 = 1.0;

parameters! {
    /// An endless cylinder that selects nodes.
    #[derive(Copy)]
    pub struct CylinderChoice with required keys {
        /// A point of the axis, mm.
        at_mm: [f64; 3];
        /// Direction of the axis; any length.
        axis: [f64; 3];
        /// Radius.
        radius_mm: f64, above 0 "mm";
        /// Nodes selected: those `inside`, those `outside`, or those near the `wall`. Default `wall`.
        #[serde(default)]
        part: CylinderPart;
        /// With `wall`: largest distance of a node from it. Default 1.
        within_mm: Option<f64>, in 0 "mm";
    }
}

/// Part of space that a cylinder selects; nodes on the wall are in each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum CylinderPart {
    /// Up to the radius from the axis.
    Inside,
    /// Near the radius.
    #[default]
    Wall,
    /// From the radius on.
    Outside,
}

impl CylinderChoice {
    /// Amount by which a point lies beyond the selected part, mm: 0 or less if it is selected. Errors name the odd
    /// number.
    fn miss_mm(&self, key: &str) -> Result<impl Fn(&[f64; 3]) -> f64 + use<>, SelectionError> {
        let number =
            |key: String, found: f64, expected: &str| Err(Box::new((key, InvalidFile::number(found, expected))));
        if let Some((name, found, expected)) = self.out_of_range() {
            return number(format!("{key}.{name}"), found, &expected);
        }
        if let Some(index) = self.at_mm.iter().position(|x| !x.is_finite()) {
            return number(format!("{key}.at_mm[{index}]"), self.at_mm[index], "a coordinate, mm");
        }
        let axis = Vector3::from(self.axis);
        let Some(axis) = axis
            .try_normalize(1e-9)
            .filter(|axis| axis.iter().all(|x| x.is_finite()))
        else {
            let expected = "finite numbers that are not all zero";
            return Err(keys(format!("{key}.axis"), format!("{:?}", self.axis), expected));
        };
        let (radius, within) = (self.radius_mm, self.within_mm.unwrap_or(WITHIN_MM));
        if self.within_mm.is_some() && self.part != CylinderPart::Wall {
            let found = "`within_mm` of a part that has no wall";
            return Err(keys(format!("{key}.within_mm"), found, "`part = \"wall\"`"));
        }
        let (point_on_axis, part) = (Point3::from(self.at_mm), self.part);
        Ok(move |point: &[f64; 3]| {
            let offset = Point3::from(*point) - point_on_axis;
            let beyond = (offset - axis * axis.dot(&offset)).norm() - radius;
            match part {
                CylinderPart::Inside => beyond,
                CylinderPart::Outside => -beyond,
                CylinderPart::Wall => beyond.abs() - within,
            }
        })
    }
}

/// Declares a table that selects nodes: the keys that do so, and after them its own.
macro_rules! selecting {
    ($(#[$meta:meta])* pub struct $name:ident { $($own:tt)* }) => {
        $(#[$meta])*
        pub struct $name {
            /// Node numbers from 0 in the order of the mesh file.
            pub nodes: Option<Vec<i64>>,
            /// All nodes in this box, including its faces, as two opposite corners, mm. `inf` leaves a side open.
            pub box_mm: Option<[[f64; 3]; 2]>,
            /// All nodes inside or outside of an endless cylinder, or near its wall.
            pub cylinder: Option<$crate::input::selection::CylinderChoice>,
            /// All nodes on the surface of a region, where it borders on others or on nothing: its name, a part of its
            /// name, or its number.
            pub surface_of: Option<insonify_base::document::RegionName>,
            /// All nodes of a region: its name, a part of its name, or its number.
            pub region: Option<insonify_base::document::RegionName>,
            /// Only nodes on the surface of the mesh. Default false.
            #[serde(default)]
            pub surface: bool,
            $($own)*
        }

        impl $name {
            /// The nodes that the table selects.
            pub(crate) fn selection(&self) -> $crate::input::selection::Selection<'_> {
                $crate::input::selection::Selection {
                    nodes: self.nodes.as_deref(),
                    box_mm: self.box_mm.as_ref(),
                    cylinder: self.cylinder.as_ref(),
                    surface_of: self.surface_of.as_ref(),
                    region: self.region.as_ref(),
                    surface: self.surface,
                }
            }
        }
    };
}
pub(crate) use selecting;

/// Node selection of a table: by number, or as the intersection of a box, a cylinder, a region, the surface of a region
/// and that of the mesh, where given.
pub(crate) struct Selection<'a> {
    /// Numbers of nodes, from 0.
    pub nodes: Option<&'a [i64]>,
    /// Two opposite corners of a box, mm; infinite for an open side.
    pub box_mm: Option<&'a [[f64; 3]; 2]>,
    /// Cylinder that selects the nodes inside it, outside it or near its wall.
    pub cylinder: Option<&'a CylinderChoice>,
    /// Region whose surface is selected: its faces with other regions, and those without a neighbour.
    pub surface_of: Option<&'a RegionName>,
    /// Region whose nodes are selected.
    pub region: Option<&'a RegionName>,
    /// Whether only nodes of the mesh surface are selected, or of the part of it in this region.
    pub surface: bool,
}

/// Selected nodes, ascending unless by number, and the numbers of the region that they are of.
pub(crate) struct Selected {
    pub nodes: Vec<u32>,
    pub regions: Option<Vec<i32>>,
}

impl Selection<'_> {
    /// Selects nodes of a mesh; `table` is the key of the table, `numbers` finds the regions that a name at a key
    /// means, and `fault` makes an error of the file.
    pub(crate) fn select(
        &self,
        table: &str,
        mesh: &TetMesh,
        numbers: impl Fn(&str, &RegionName) -> Result<Vec<i32>, InputError>,
        fault: impl Fn(SelectionError) -> InputError,
    ) -> Result<Selected, InputError> {
        let known = |key: &str, name: Option<&RegionName>| {
            let regions = name.map(|name| numbers(&format!("{table}.{key}"), name));
            regions.transpose()
        };
        let regions = known("region", self.region)?;
        let surface_of = known("surface_of", self.surface_of)?;
        let choice = Choice {
            table,
            selection: self,
            regions: regions.as_deref(),
            surface_of: surface_of.as_deref(),
        };
        let nodes = choice.nodes(mesh).map_err(fault)?;
        Ok(Selected { nodes, regions })
    }
}

/// A selection whose regions are found.
struct Choice<'a> {
    table: &'a str,
    selection: &'a Selection<'a>,
    regions: Option<&'a [i32]>,
    surface_of: Option<&'a [i32]>,
}

impl Choice<'_> {
    fn nodes(&self, mesh: &TetMesh) -> Result<Vec<u32>, SelectionError> {
        let (table, selection) = (self.table, self.selection);
        let others = [
            selection.box_mm.is_some(),
            selection.cylinder.is_some(),
            selection.surface,
        ];
        let others = others.contains(&true) || self.regions.is_some() || self.surface_of.is_some();
        let expected = "`nodes`, or some of `box_mm`, `cylinder`, `region`, `surface_of` and `surface`";
        match selection.nodes {
            Some(_) if others => Err(keys(table.to_owned(), "`nodes` beside another choice", expected)),
            Some([]) => Err(keys(format!("{table}.nodes"), "no nodes", "at least one")),
            Some(nodes) => numbered(&format!("{table}.nodes"), nodes, mesh.nodes().len()),
            None if others => self.everywhere(mesh),
            None => Err(keys(table.to_owned(), "no choice of nodes", expected)),
        }
    }

    /// Nodes that every stated part of the selection has; an error names the part that leaves none.
    fn everywhere(&self, mesh: &TetMesh) -> Result<Vec<u32>, SelectionError> {
        let (table, surface) = (self.table, self.selection.surface);
        let mut picked = vec![self.regions.is_none() && !surface; mesh.nodes().len()];
        let mut pick = |nodes: &[u32]| nodes.iter().for_each(|node| picked[*node as usize] = true);
        let is_chosen = |region: i32| self.regions.is_none_or(|regions| regions.contains(&region));
        // By faces, not by nodes: a node where two regions meet is on the surface of a region only if a face
        // of that region is.
        if surface {
            let faces = mesh.surface().filter(|face| is_chosen(face.region));
            faces.for_each(|face| pick(&face.nodes));
        } else if self.regions.is_some() {
            let elements = mesh.elements().iter().zip(mesh.regions());
            let elements = elements.filter(|(_, region)| is_chosen(**region));
            elements.for_each(|(corners, _)| pick(corners));
        }
        if !picked.contains(&true) {
            let (found, expected) = if surface {
                ("no node on the surface", "a region on the surface of the mesh")
            } else {
                ("no node of this region", "a region that has elements in the mesh")
            };
            return Err(keys(table.to_owned(), found, expected));
        }
        if let Some(regions) = self.surface_of {
            let mut is_on_surface = vec![false; picked.len()];
            mesh.surface_of(regions)
                .for_each(|face| face.nodes.iter().for_each(|node| is_on_surface[*node as usize] = true));
            let before = picked.clone();
            picked
                .iter_mut()
                .zip(is_on_surface)
                .for_each(|(picked, is_on_surface)| *picked &= is_on_surface);
            if !picked.contains(&true) {
                let found = if before.contains(&false) {
                    "no node on the surface of this region among the others selected"
                } else {
                    "no node on the surface of this region"
                };
                return Err(keys(
                    format!("{table}.surface_of"),
                    found,
                    "a region that has elements in the mesh",
                ));
            }
        }
        if let Some(cylinder) = self.selection.cylinder {
            let key = format!("{table}.cylinder");
            let miss_mm = cylinder.miss_mm(&key)?;
            let candidates = (0..).zip(mesh.nodes()).filter(|(node, _)| picked[*node]);
            let misses: Vec<(usize, f64)> = candidates
                .map(|(node, position_mm)| (node, miss_mm(position_mm)))
                .collect();
            misses.iter().for_each(|(node, miss)| picked[*node] = *miss <= 0.0);
            if !picked.contains(&true) {
                let least = misses.iter().map(|(_, miss)| *miss).fold(f64::INFINITY, f64::min);
                let found = format!("no node in this part of the cylinder: the nearest is {least:.3} mm beyond it");
                return Err(keys(key, found, "one that holds at least one of the nodes"));
            }
        }
        if let Some(corners) = self.selection.box_mm {
            let key = format!("{table}.box_mm");
            let [low, high] = ordered(&key, corners)?;
            let before = picked.clone();
            for (picked, position) in picked.iter_mut().zip(mesh.nodes()) {
                *picked &= (0..3).all(|axis| low[axis] <= position[axis] && position[axis] <= high[axis]);
            }
            if !picked.contains(&true) {
                let nodes = before.iter().zip(mesh.nodes());
                let positions = nodes.filter(|(picked, _)| **picked).map(|(_, position)| *position);
                let expected = format!("a box that holds at least one of the nodes{}", extent(positions));
                return Err(keys(key, "no node in this box", expected));
            }
        }
        let nodes = (0..).zip(picked).filter(|(_, picked)| *picked);
        Ok(nodes.map(|(node, _)| node).collect())
    }
}

/// Parses letters into axes (0 to 2).
pub fn axes(table: &str, letters: &str) -> Result<Vec<u8>, SelectionError> {
    let axis_of = |letter: char| AXES.iter().position(|axis| *axis == letter).map(|axis| axis as u8);
    let mut axes: Vec<u8> = letters.chars().filter_map(axis_of).collect();
    axes.sort_unstable();
    axes.dedup();
    // Unknown and repeated letters are refused.
    if axes.is_empty() || axes.len() != letters.chars().count() {
        let expected = "some of the letters x, y and z, each once, such as \"xyz\" or \"z\"";
        return Err(keys(format!("{table}.axes"), format!("\"{letters}\""), expected));
    }
    Ok(axes)
}

fn keys(key: String, found: impl Into<String>, expected: impl Into<String>) -> SelectionError {
    Box::new((key, InvalidFile::keys(found, expected)))
}

/// Checks that each number is that of one of `node_count` nodes (from 0); `key` is the key of the list.
pub fn numbered(key: &str, nodes: &[i64], node_count: usize) -> Result<Vec<u32>, SelectionError> {
    let check = |(index, &found): (usize, &i64)| match u32::try_from(found) {
        Ok(node) if (node as usize) < node_count => Ok(node),
        _ => Err(Box::new((
            format!("{key}[{index}]"),
            InvalidFile::node(found, node_count),
        ))),
    };
    nodes.iter().enumerate().map(check).collect()
}

/// Minimum and maximum corners of a box.
pub fn ordered(key: &str, corners: &[[f64; 3]; 2]) -> Result<[[f64; 3]; 2], SelectionError> {
    if let Some((index, found)) = first(corners.as_flattened(), |x| x.is_nan()) {
        let expected = "a coordinate, mm, or `inf` for an open side";
        return Err(Box::new((
            format!("{key}[{}][{}]", index / 3, index % 3),
            InvalidFile::number(found, expected),
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
    let extent = |axis: usize| format!("{} to {} mm along {}", low[axis], high[axis], AXES[axis]);
    format!(", which lie from {}, {}, {}", extent(0), extent(1), extent(2))
}
