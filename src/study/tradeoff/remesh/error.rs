//! Errors of the remeshing study.

use crate::gpu::GpuError;
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::tissue::error::LinearError;
use crate::mechanics::tissue::material::InvalidMaterial;
use crate::mechanics::tissue::remesh::RemeshError;

/// Error of studying a mesh.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The dense inverses exceed the memory of the machine.
    #[error(
        "a mesh of {size} degrees of freedom needs {:.1} GiB for its dense inverses, and {:.1} GiB of memory are available; \
         take a coarser mesh",
        gib(*needed), gib(*available)
    )]
    Memory {
        /// Number of degrees of freedom.
        size: usize,
        /// Bytes needed.
        needed: usize,
        /// Bytes available.
        available: usize,
    },
    /// The needle's line crosses too few elements with a movable corner.
    #[error(
        "only {moves} corners can be moved along the needle's line, {} expected: the mesh is too coarse, or lies beside the \
         line down through the middle of its box",
        super::subject::LEAST_MOVES
    )]
    Track {
        /// Number of moves found.
        moves: usize,
    },
    /// The mesh has too few nodes for the contacts.
    #[error("the mesh has {found} free nodes beside the needle, {expected} expected as contacts; take a finer mesh")]
    Contacts {
        /// Number of nodes found.
        found: usize,
        /// Number of nodes expected.
        expected: usize,
    },
    /// The material parameters are invalid.
    #[error(transparent)]
    Material(#[from] InvalidMaterial),
    /// The stiffness cannot be assembled, factorised or inverted.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// A remesher refuses a change.
    #[error(transparent)]
    Remesh(#[from] RemeshError),
    /// A GPU operation failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The locator belongs to a mesh with another number of nodes.
    #[error(transparent)]
    Locator(#[from] InvalidMesh),
}

impl StudyError {
    /// Returns whether the machine failed, rather than the input.
    pub fn is_machine(&self) -> bool {
        matches!(self, Self::Gpu(error) if error.is_machine())
    }
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}
