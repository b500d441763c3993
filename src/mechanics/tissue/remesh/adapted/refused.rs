//! Why a node cannot be moved.

use crate::mechanics::tissue::element::DegenerateElement;

/// Why a node cannot be moved. The mesh is then as it was.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RefusedMove {
    /// There is no such node.
    #[error("node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node {
        /// The node given.
        node: u32,
        /// How many there are.
        nodes: usize,
    },
    /// The position is NaN or infinite.
    #[error("node {node} cannot move to {to:?}: positions must be finite")]
    Position {
        /// The node.
        node: u32,
        /// The position given, mm.
        to: [f64; 3],
    },
    /// A tetrahedron would be inverted or flat.
    #[error("moving node {node} to {to:?} mm spoils tetrahedron {element} (nodes {corners:?}): {cause}")]
    Element {
        /// The node.
        node: u32,
        /// The position given, mm.
        to: [f64; 3],
        /// The tetrahedron.
        element: u32,
        /// Its nodes.
        corners: [u32; 4],
        /// What would be wrong with it.
        cause: DegenerateElement,
    },
    /// A tetrahedron would be too thin.
    #[error(
        "moving node {node} to {to:?} mm makes tetrahedron {element} too thin: Jacobian condition {condition:.3e}, at most \
         {limit:.3e} expected (a regular one has 1)"
    )]
    Condition {
        /// The node.
        node: u32,
        /// The position given, mm.
        to: [f64; 3],
        /// The tetrahedron.
        element: u32,
        /// Its Jacobian condition after the move.
        condition: f64,
        /// The limit.
        limit: f64,
    },
}
