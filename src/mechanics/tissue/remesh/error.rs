//! Errors of moves and of remeshers.

use super::{Level, Precision};
use crate::tissue::element::DegenerateElement;
use crate::tissue::error::LinearError;
use insonify_base::cause::Cause;

/// Why a move, a change or another request is refused. Mesh and remesher are then unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RemeshError {
    #[error("node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node { node: u32, nodes: usize },
    #[error("node {node} cannot move to {to:?}: positions must be finite")]
    Position { node: u32, to: [f64; 3] },
    /// A tetrahedron would become inverted or flat.
    #[error("moving node {node} to {to:?} mm spoils tetrahedron {element} (nodes {corners:?}): {cause}")]
    Element {
        node: u32,
        to: [f64; 3],
        element: u32,
        corners: [u32; 4],
        cause: DegenerateElement,
    },
    /// A tetrahedron would become too thin.
    #[error(
        "moving node {node} to {to:?} mm makes tetrahedron {element} too thin: Jacobian condition {condition:.3e}, at most \
         {limit:.3e} expected (a regular one has 1)"
    )]
    Condition {
        node: u32,
        to: [f64; 3],
        element: u32,
        condition: f64,
        limit: f64,
    },
    #[error("element {element}, but there are only {elements} (numbered from 0)")]
    NoElement { element: u32, elements: usize },
    /// A displacement of the node is prescribed.
    #[error("node {node} is fixed")]
    Fixed { node: u32 },
    /// The node is already in contact, or a candidate of the probe.
    #[error("node {node} is already a contact or a probe candidate")]
    Taken { node: u32 },
    /// No corner of the element that the tip entered can be moved there, with the reason for each in the order tried.
    #[error("no node can be moved to the tip at {tip:?} mm (element {element}): {}", list(.unfit))]
    NoCorner {
        element: u32,
        tip: [f64; 3],
        unfit: Vec<RemeshError>,
    },
    /// A change was skipped or repeated, or the mesh has changed again since.
    #[error(
        "change {found} of a mesh at change {mesh}, expected change {expected}; pass each change once, in order, or call `refresh`"
    )]
    OutOfStep { expected: u64, found: u64, mesh: u64 },
    /// The change makes the stiffness nearly singular relative to its previous value.
    #[error(
        "moving node {node} makes the capacitance matrix I + dK G singular to working precision: reciprocal condition \
         {reciprocal_condition:.1e}, at least {limit:.1e} expected; move it less close to a face, or another node"
    )]
    Singular {
        node: u32,
        reciprocal_condition: f64,
        limit: f64,
    },
    /// All moves since the base together make the stiffness nearly singular relative to that of the base.
    #[error(
        "the mesh has moved so far from its base that I + dK G is singular to working precision: reciprocal condition \
         {reciprocal_condition:.1e}, at least {limit:.1e} expected: the mesh has moved too far from its base"
    )]
    FarFromBase { reciprocal_condition: f64, limit: f64 },
    /// Entries of the compliance cannot be read.
    #[error(transparent)]
    Compliance(#[from] LinearError),
    /// The device that stores the inverse has failed; another remesher must be made.
    #[error("the device that holds the inverse has failed: {0}")]
    Device(String),
    /// The remesher does not support this level.
    #[error("this remesher, of level {offered}, does not support level {asked}; create another")]
    Level { asked: Level, offered: Level },
    /// The available compliance does not suit the level.
    #[error("level {level} in {precision}: {reason}")]
    Unsuited {
        level: Level,
        precision: Precision,
        reason: String,
    },
}

impl Cause for RemeshError {}

fn list(unfit: &[RemeshError]) -> String {
    unfit.iter().map(RemeshError::to_string).collect::<Vec<_>>().join("; ")
}
