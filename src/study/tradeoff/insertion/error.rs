//! Why insertions cannot be studied.

use crate::mechanics::insertion::StepError;
use crate::mechanics::insertion::finite::InvalidSetup;
use crate::mechanics::insertion::spring::InvalidParameters;
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::mesh::locator::NodeCount;
use crate::mechanics::needle::InvalidNeedleModel;
use crate::mechanics::tissue::material::InvalidMaterial;

/// Why insertions cannot be studied.
#[derive(Debug, thiserror::Error)]
pub enum InsertionStudyError {
    /// A number out of range.
    #[error("{what} is {found}; expected {expected}")]
    Number {
        /// Which.
        what: &'static str,
        /// As given.
        found: f64,
        /// Its range.
        expected: &'static str,
    },
    /// The dense inverses are larger than the memory of the machine.
    #[error(
        "levels I, III and IV of a block of {nodes} nodes need {:.1} GiB for their dense inverses, and {:.1} GiB of memory are \
         available; take fewer nodes",
        gib(*needed), gib(*available)
    )]
    Memory {
        /// Nodes.
        nodes: usize,
        /// Bytes that are needed.
        needed: usize,
        /// Bytes that can be had.
        available: usize,
    },
    /// The block cannot be meshed.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// The material is no material.
    #[error(transparent)]
    Material(#[from] InvalidMaterial),
    /// The needle is no needle.
    #[error(transparent)]
    Needle(#[from] InvalidNeedleModel),
    /// An insertion cannot be set up.
    #[error(transparent)]
    Setup(#[from] InvalidSetup),
    /// The mass-spring model cannot be made.
    #[error(transparent)]
    Springs(#[from] InvalidParameters),
    /// A step cannot be made.
    #[error(transparent)]
    Step(#[from] StepError),
    /// A locator of another mesh.
    #[error(transparent)]
    Locator(#[from] NodeCount),
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}
