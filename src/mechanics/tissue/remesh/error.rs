//! Why a remesher refuses.

use super::{Level, Precision};
use crate::mechanics::tissue::compliance::ComplianceError;

/// Why a remesh, or another request to a remesher, is refused. The remesher is then as it was.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RemeshError {
    /// A change was left out, or given twice, or the mesh has gone on.
    #[error(
        "change {found} of a mesh at change {mesh}, but change {expected} is due; hand over every change once, or refresh"
    )]
    OutOfStep {
        /// The change that comes next.
        expected: u64,
        /// The change given.
        found: u64,
        /// Changes of the mesh.
        mesh: u64,
    },
    /// The change makes the stiffness nearly singular relative to what it was.
    #[error(
        "moving node {node} makes the capacitance matrix I + dK G singular to working precision: reciprocal condition \
         {reciprocal_condition:.1e}, at least {limit:.1e} expected; move it less close to a face, or another node"
    )]
    Singular {
        /// The node moved.
        node: u32,
        /// Reciprocal condition, estimated.
        reciprocal_condition: f64,
        /// The limit.
        limit: f64,
    },
    /// The whole of the moves since the base makes it so.
    #[error(
        "the mesh has moved so far from its base that I + dK G is singular to working precision: reciprocal condition \
         {reciprocal_condition:.1e}, at least {limit:.1e} expected; prepare a new base"
    )]
    FarFromBase {
        /// Reciprocal condition, estimated.
        reciprocal_condition: f64,
        /// The limit.
        limit: f64,
    },
    /// Entries of the compliance cannot be had.
    #[error(transparent)]
    Compliance(#[from] ComplianceError),
    /// The device that holds the inverse has failed. Make another remesher.
    #[error("the device that holds the inverse has failed: {0}")]
    Device(String),
    /// The remesher does not work at this level.
    #[error("this remesher works at level {offered} and the like, not at {asked}; make another")]
    Level {
        /// Asked for.
        asked: Level,
        /// Its own.
        offered: Level,
    },
    /// The compliance at hand does not suit the level.
    #[error("level {level} in {precision}: {reason}")]
    Unsuited {
        /// Asked for.
        level: Level,
        /// Asked for.
        precision: Precision,
        /// What is missing, and what to do.
        reason: String,
    },
}
