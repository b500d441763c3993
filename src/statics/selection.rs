//! Which nodes a fix or a load means.

use super::error::{StaticsError, Wrong};
use super::file::ProblemFile;

/// What is wrong with a choice of nodes or axes, and the key that it is about.
pub(crate) type Odd = Box<(String, Wrong)>;

pub(super) const AXES: [char; 3] = ['x', 'y', 'z'];

impl ProblemFile {
    /// The nodes that a table picks, of those at `positions`; `table` is its key.
    pub(super) fn select(
        &self,
        table: &str,
        nodes: Option<&[i64]>,
        box_mm: Option<&[[f64; 3]; 2]>,
        positions: &[[f64; 3]],
    ) -> Result<Vec<u32>, StaticsError> {
        select(table, nodes, box_mm, positions).map_err(|odd| self.fault(odd.0, odd.1))
    }

    /// Node numbers, checked.
    pub(super) fn numbered(&self, key: &str, nodes: &[i64], of: usize) -> Result<Vec<u32>, StaticsError> {
        numbered(key, nodes, of).map_err(|odd| self.fault(odd.0, odd.1))
    }

    /// Checks that a vector is finite.
    pub(super) fn finite(&self, key: &str, vector: &[f64; 3]) -> Result<(), StaticsError> {
        match first(vector, |x| !x.is_finite()) {
            Some((at, found)) => {
                let expected = "a finite number";
                Err(self.fault(format!("{key}[{at}]"), Wrong::Number { found, expected }))
            }
            None => Ok(()),
        }
    }

    /// The axes of a table, checked.
    pub(super) fn axes(&self, table: &str, letters: &str) -> Result<Vec<u8>, StaticsError> {
        axes(table, letters).map_err(|odd| self.fault(odd.0, odd.1))
    }
}

/// The nodes that a table picks, by number or by a box; `table` is its key.
pub(crate) fn select(
    table: &str,
    nodes: Option<&[i64]>,
    box_mm: Option<&[[f64; 3]; 2]>,
    positions: &[[f64; 3]],
) -> Result<Vec<u32>, Odd> {
    let expected = "`nodes` or `box_mm`";
    match (nodes, box_mm) {
        (Some([]), None) => Err(keys(format!("{table}.nodes"), "no nodes", "at least one")),
        (Some(nodes), None) => numbered(&format!("{table}.nodes"), nodes, positions.len()),
        (None, Some(corners)) => in_box(&format!("{table}.box_mm"), corners, positions),
        (None, None) => Err(keys(table.to_owned(), "neither `nodes` nor `box_mm`", expected)),
        (Some(_), Some(_)) => Err(keys(table.to_owned(), "both `nodes` and `box_mm`", expected)),
    }
}

/// The axes (0 to 2) that letters name.
pub(crate) fn axes(table: &str, letters: &str) -> Result<Vec<u8>, Odd> {
    let place = |letter: char| AXES.iter().position(|axis| *axis == letter).map(|axis| axis as u8);
    let mut axes: Vec<u8> = letters.chars().filter_map(place).collect();
    axes.sort_unstable();
    axes.dedup();
    // No letter that is none, and none twice.
    if axes.is_empty() || axes.len() != letters.chars().count() {
        let expected = "some of the letters x, y and z, each once, such as \"xyz\" or \"z\"";
        return Err(keys(format!("{table}.axes"), format!("\"{letters}\""), expected));
    }
    Ok(axes)
}

fn keys(key: String, found: impl Into<String>, expected: impl Into<String>) -> Odd {
    let (found, expected) = (found.into(), expected.into());
    Box::new((key, Wrong::Keys { found, expected }))
}

fn numbered(key: &str, nodes: &[i64], of: usize) -> Result<Vec<u32>, Odd> {
    let check = |(at, &found): (usize, &i64)| match u32::try_from(found) {
        Ok(node) if (node as usize) < of => Ok(node),
        _ => Err(Box::new((format!("{key}[{at}]"), Wrong::Node { found, nodes: of }))),
    };
    nodes.iter().enumerate().map(check).collect()
}

/// The corners of a box, least and greatest.
pub(crate) fn ordered(key: &str, corners: &[[f64; 3]; 2]) -> Result<[[f64; 3]; 2], Odd> {
    if let Some((at, found)) = first(corners.as_flattened(), |x| x.is_nan()) {
        let expected = "a coordinate, mm, or `inf` for an open side";
        return Err(Box::new((
            format!("{key}[{}][{}]", at / 3, at % 3),
            Wrong::Number { found, expected },
        )));
    }
    Ok([
        std::array::from_fn(|axis| corners[0][axis].min(corners[1][axis])),
        std::array::from_fn(|axis| corners[0][axis].max(corners[1][axis])),
    ])
}

fn in_box(key: &str, corners: &[[f64; 3]; 2], positions: &[[f64; 3]]) -> Result<Vec<u32>, Odd> {
    let [low, high] = ordered(key, corners)?;
    let inside = |position: &[f64; 3]| (0..3).all(|axis| low[axis] <= position[axis] && position[axis] <= high[axis]);
    let picked: Vec<u32> = (0..positions.len() as u32)
        .filter(|node| inside(&positions[*node as usize]))
        .collect();
    if picked.is_empty() {
        let expected = format!("a box that holds at least one of the mesh's nodes{}", extent(positions));
        return Err(keys(key.to_owned(), "no node in this box", expected));
    }
    Ok(picked)
}

fn first(numbers: &[f64], wrong: impl Fn(f64) -> bool) -> Option<(usize, f64)> {
    numbers.iter().copied().enumerate().find(|(_, number)| wrong(*number))
}

/// Where the nodes are, in words.
fn extent(positions: &[[f64; 3]]) -> String {
    let along = |axis: usize| {
        let all = positions.iter().map(|position| position[axis]);
        let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
            (low.min(x), high.max(x))
        });
        format!("{low} to {high} mm along {}", ["x", "y", "z"][axis])
    };
    format!(", which lie from {}, {}, {}", along(0), along(1), along(2))
}
