//! Errors of the insertion study.

use crate::mechanics::insertion::spring::InvalidParameters;
use crate::mechanics::insertion::{InvalidSetup, StepError};
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::needle::InvalidNeedleModel;
use crate::mechanics::tissue::material::InvalidMaterial;

/// Error of an insertion study.
#[derive(Debug, thiserror::Error)]
pub enum InsertionStudyError {
    /// A number is out of range.
    #[error("{what} is {found}; expected {expected}")]
    Number {
        /// Name of the option.
        what: &'static str,
        /// Value given.
        found: f64,
        /// Accepted range.
        expected: &'static str,
    },
    /// The dense inverses exceed the memory of the machine.
    #[error(
        "levels I, III and IV of a block of {nodes} nodes need {:.1} GiB for their dense inverses, and {:.1} GiB of memory are \
         available; take fewer nodes",
        gib(*needed), gib(*available)
    )]
    Memory {
        /// Number of nodes.
        nodes: usize,
        /// Bytes needed.
        needed: usize,
        /// Bytes available.
        available: usize,
    },
    /// The block cannot be meshed.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// The material parameters are invalid.
    #[error(transparent)]
    Material(#[from] InvalidMaterial),
    /// The needle parameters are invalid.
    #[error(transparent)]
    Needle(#[from] InvalidNeedleModel),
    /// An insertion cannot be set up.
    #[error(transparent)]
    Setup(#[from] InvalidSetup),
    /// The mass-spring model cannot be created.
    #[error(transparent)]
    Springs(#[from] InvalidParameters),
    /// A step cannot be computed.
    #[error(transparent)]
    Step(#[from] StepError),
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}
