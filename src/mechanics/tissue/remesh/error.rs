//! Errors of remeshers.

use super::{Level, Precision};
use crate::mechanics::tissue::compliance::ComplianceError;

/// Why a remesher refuses a change or another request. The remesher is then unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RemeshError {
    /// A change was skipped or repeated, or the mesh has changed again since.
    #[error(
        "change {found} of a mesh at change {mesh}, but change {expected} is due; hand over every change once, or refresh"
    )]
    OutOfStep {
        /// Number of the change expected next.
        expected: u64,
        /// Number of the change given.
        found: u64,
        /// Number of changes of the mesh.
        mesh: u64,
    },
    /// The change makes the stiffness nearly singular relative to its previous value.
    #[error(
        "moving node {node} makes the capacitance matrix I + dK G singular to working precision: reciprocal condition \
         {reciprocal_condition:.1e}, at least {limit:.1e} expected; move it less close to a face, or another node"
    )]
    Singular {
        /// Moved node.
        node: u32,
        /// Estimated reciprocal condition.
        reciprocal_condition: f64,
        /// Smallest reciprocal condition allowed.
        limit: f64,
    },
    /// All moves since the base together make the stiffness nearly singular relative to that of the base.
    #[error(
        "the mesh has moved so far from its base that I + dK G is singular to working precision: reciprocal condition \
         {reciprocal_condition:.1e}, at least {limit:.1e} expected: the mesh has moved too far from its base"
    )]
    FarFromBase {
        /// Estimated reciprocal condition.
        reciprocal_condition: f64,
        /// Smallest reciprocal condition allowed.
        limit: f64,
    },
    /// Entries of the compliance cannot be read.
    #[error(transparent)]
    Compliance(#[from] ComplianceError),
    /// The device that stores the inverse has failed; another remesher must be made.
    #[error("the device that holds the inverse has failed: {0}")]
    Device(String),
    /// The remesher does not support this level.
    #[error("this remesher works at level {offered} and the like, not at {asked}; make another")]
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
        /// Precision requested.
        precision: Precision,
        /// Reason and remedy.
        reason: String,
    },
}
