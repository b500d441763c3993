//! Errors of moves and of remeshers.

use super::{Level, Precision};
use crate::tissue::element::DegenerateElement;
use crate::tissue::error::LinearError;
use insonify_base::blame::Blame;

/// Why a move, a change or another request is refused. Mesh and remesher are then unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RemeshError {
    /// A node that does not exist.
    #[error("node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node {
        /// Node named.
        node: u32,
        /// Number of nodes of the mesh.
        nodes: usize,
    },
    /// A position that is not finite.
    #[error("node {node} cannot move to {to:?}: positions must be finite")]
    Position {
        /// Node to be moved.
        node: u32,
        /// Position to move it to, mm.
        to: [f64; 3],
    },
    /// A tetrahedron would become inverted or flat.
    #[error("moving node {node} to {to:?} mm spoils tetrahedron {element} (nodes {corners:?}): {cause}")]
    Element {
        /// Node to be moved.
        node: u32,
        /// Position to move it to, mm.
        to: [f64; 3],
        /// Index of the tetrahedron, from 0.
        element: u32,
        /// Its nodes, from 0.
        corners: [u32; 4],
        /// Why its volume would be unusable.
        cause: DegenerateElement,
    },
    /// A tetrahedron would become too thin.
    #[error(
        "moving node {node} to {to:?} mm makes tetrahedron {element} too thin: Jacobian condition {condition:.3e}, at most \
         {limit:.3e} expected (a regular one has 1)"
    )]
    Condition {
        /// Node to be moved.
        node: u32,
        /// Position to move it to, mm.
        to: [f64; 3],
        /// Index of the tetrahedron, from 0.
        element: u32,
        /// Jacobian condition that it would have; 1 for a regular one.
        condition: f64,
        /// Largest Jacobian condition accepted.
        limit: f64,
    },
    /// An element that does not exist.
    #[error("element {element}, but there are only {elements} (numbered from 0)")]
    NoElement {
        /// Element named.
        element: u32,
        /// Number of elements of the mesh.
        elements: usize,
    },
    /// A displacement of the node is prescribed.
    #[error("node {node} is fixed")]
    Fixed {
        /// Node, from 0.
        node: u32,
    },
    /// The node is already in contact, or a candidate of the probe.
    #[error("node {node} is already a contact or a probe candidate")]
    Taken {
        /// Node, from 0.
        node: u32,
    },
    /// No corner of the element that the tip entered can be moved there, with the reason for each in the order tried.
    #[error("no node can be moved to the tip at {tip:?} mm (element {element}): {}", list(.unfit))]
    NoCorner {
        /// Index of the element, from 0.
        element: u32,
        /// Position of the tip in the reference state, mm.
        tip: [f64; 3],
        /// Reason for each corner, in the order tried.
        unfit: Vec<RemeshError>,
    },
    /// A change was skipped or repeated, or the mesh has changed again since.
    #[error(
        "change {found} of a mesh at change {mesh}, expected change {expected}; pass each change once, in order, or call `refresh`"
    )]
    OutOfStep {
        /// Number of the next change, from 1.
        expected: u64,
        /// Number of the change passed.
        found: u64,
        /// Number of the last change of the mesh.
        mesh: u64,
    },
    /// The change makes the stiffness nearly singular relative to its previous value.
    #[error(
        "moving node {node} makes the capacitance matrix I + dK G singular to working precision: reciprocal condition \
         {reciprocal_condition:.1e}, at least {limit:.1e} expected; move it less close to a face, or another node"
    )]
    Singular {
        /// Node to be moved.
        node: u32,
        /// Reciprocal condition of the capacitance matrix I + dK G.
        reciprocal_condition: f64,
        /// Smallest reciprocal condition accepted.
        limit: f64,
    },
    /// All moves since the base together make the stiffness nearly singular relative to that of the base.
    #[error(
        "the mesh has moved so far from its base that I + dK G is singular to working precision: reciprocal condition \
         {reciprocal_condition:.1e}, at least {limit:.1e} expected: the mesh has moved too far from its base"
    )]
    FarFromBase {
        /// Reciprocal condition of the matrix I + dK G.
        reciprocal_condition: f64,
        /// Smallest reciprocal condition accepted.
        limit: f64,
    },
    /// Entries of the compliance cannot be read.
    #[error(transparent)]
    Compliance(#[from] LinearError),
    /// The device that stores the inverse has failed; another remesher must be made.
    #[error("the device that holds the inverse has failed: {0}")]
    Device(String),
    /// The remesher does not support this level.
    #[error("this remesher, of level {offered}, does not support level {asked}; create another")]
    Level {
        /// Level requested.
        asked: Level,
        /// Level of the remesher.
        offered: Level,
    },
    /// The available compliance does not suit the level.
    #[error("level {level} in {precision}: {reason}")]
    Unsuited {
        /// Level requested.
        level: Level,
        /// Precision of the inverse.
        precision: Precision,
        /// Why they do not suit the compliance.
        reason: String,
    },
}

impl Blame for RemeshError {}

fn list(unfit: &[RemeshError]) -> String {
    unfit.iter().map(RemeshError::to_string).collect::<Vec<_>>().join("; ")
}
