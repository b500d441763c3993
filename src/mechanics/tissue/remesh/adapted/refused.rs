//! Reasons for refusing a move.

use crate::mechanics::tissue::element::DegenerateElement;

/// Why a node cannot be moved. The mesh is then unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RefusedMove {
    /// The node does not exist.
    #[error("node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node {
        /// Node given.
        node: u32,
        /// Number of nodes.
        nodes: usize,
    },
    /// The position is NaN or infinite.
    #[error("node {node} cannot move to {to:?}: positions must be finite")]
    Position {
        /// Node to move.
        node: u32,
        /// Position given, mm.
        to: [f64; 3],
    },
    /// A tetrahedron would become inverted or flat.
    #[error("moving node {node} to {to:?} mm spoils tetrahedron {element} (nodes {corners:?}): {cause}")]
    Element {
        /// Node to move.
        node: u32,
        /// Position given, mm.
        to: [f64; 3],
        /// Index of the tetrahedron.
        element: u32,
        /// Node indices of the tetrahedron.
        corners: [u32; 4],
        /// Defect of the tetrahedron after the move.
        cause: DegenerateElement,
    },
    /// A tetrahedron would become too thin.
    #[error(
        "moving node {node} to {to:?} mm makes tetrahedron {element} too thin: Jacobian condition {condition:.3e}, at most \
         {limit:.3e} expected (a regular one has 1)"
    )]
    Condition {
        /// Node to move.
        node: u32,
        /// Position given, mm.
        to: [f64; 3],
        /// Index of the tetrahedron.
        element: u32,
        /// Jacobian condition of the tetrahedron after the move.
        condition: f64,
        /// Largest condition allowed.
        limit: f64,
    },
}
