//! Which nodes a fix or a load means.

use super::error::{StaticsError, Wrong};
use super::file::ProblemFile;

impl ProblemFile {
    /// The nodes that a table picks, of those at `positions`; `table` is its key.
    pub(super) fn select(
        &self,
        table: &str,
        nodes: Option<&[i64]>,
        box_mm: Option<&[[f64; 3]; 2]>,
        positions: &[[f64; 3]],
    ) -> Result<Vec<u32>, StaticsError> {
        let expected = "`nodes` or `box_mm`";
        match (nodes, box_mm) {
            (Some([]), None) => Err(self.wrong_keys(format!("{table}.nodes"), "no nodes", "at least one")),
            (Some(nodes), None) => self.numbered(&format!("{table}.nodes"), nodes, positions.len()),
            (None, Some(corners)) => self.in_box(&format!("{table}.box_mm"), corners, positions),
            (None, None) => Err(self.wrong_keys(table.to_owned(), "neither `nodes` nor `box_mm`", expected)),
            (Some(_), Some(_)) => Err(self.wrong_keys(table.to_owned(), "both `nodes` and `box_mm`", expected)),
        }
    }

    /// Node numbers, checked.
    pub(super) fn numbered(&self, key: &str, nodes: &[i64], of: usize) -> Result<Vec<u32>, StaticsError> {
        let check = |(at, &found): (usize, &i64)| match u32::try_from(found) {
            Ok(node) if (node as usize) < of => Ok(node),
            _ => Err(self.fault(format!("{key}[{at}]"), Wrong::Node { found, nodes: of })),
        };
        nodes.iter().enumerate().map(check).collect()
    }

    fn in_box(&self, key: &str, corners: &[[f64; 3]; 2], positions: &[[f64; 3]]) -> Result<Vec<u32>, StaticsError> {
        if let Some((at, found)) = first(corners.as_flattened(), |x| x.is_nan()) {
            let expected = "a coordinate, mm, or `inf` for an open side";
            return Err(self.fault(
                format!("{key}[{}][{}]", at / 3, at % 3),
                Wrong::Number { found, expected },
            ));
        }
        let low: [f64; 3] = std::array::from_fn(|axis| corners[0][axis].min(corners[1][axis]));
        let high: [f64; 3] = std::array::from_fn(|axis| corners[0][axis].max(corners[1][axis]));
        let inside =
            |position: &[f64; 3]| (0..3).all(|axis| low[axis] <= position[axis] && position[axis] <= high[axis]);
        let picked: Vec<u32> = (0..positions.len() as u32)
            .filter(|node| inside(&positions[*node as usize]))
            .collect();
        if picked.is_empty() {
            let expected = format!("a box that holds at least one of the mesh's nodes{}", extent(positions));
            return Err(self.wrong_keys(key.to_owned(), "no node in this box", expected));
        }
        Ok(picked)
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
