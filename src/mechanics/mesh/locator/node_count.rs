//! Check of the number of node positions.

/// Error for a number of node positions that does not match the mesh.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{found} {state} node positions for a mesh of {expected} nodes")]
pub struct NodeCount {
    /// State of the positions: `current` or `reference`.
    pub state: &'static str,
    /// Number of positions.
    pub found: usize,
    /// Number of nodes of the mesh.
    pub expected: usize,
}

impl NodeCount {
    /// Checks the numbers of positions, where there are any, for a mesh of `expected` nodes.
    ///
    /// # Errors
    /// [`NodeCount`] of the first that does not match.
    pub fn check(
        current: Option<&[[f64; 3]]>,
        reference: Option<&[[f64; 3]]>,
        expected: usize,
    ) -> Result<(), NodeCount> {
        for (state, positions) in [("current", current), ("reference", reference)] {
            if let Some(found) = positions.map(<[_]>::len).filter(|&found| found != expected) {
                return Err(NodeCount { state, found, expected });
            }
        }
        Ok(())
    }
}
