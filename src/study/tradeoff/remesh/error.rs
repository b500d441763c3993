//! Why remeshing cannot be studied.

use crate::gpu::GpuError;
use crate::mechanics::mesh::locator::NodeCount;
use crate::mechanics::tissue::assembly::AssemblyError;
use crate::mechanics::tissue::compliance::ComplianceError;
use crate::mechanics::tissue::condensed::CondensedError;
use crate::mechanics::tissue::factor::FactorError;
use crate::mechanics::tissue::inverse::InverseError;
use crate::mechanics::tissue::material::InvalidMaterial;
use crate::mechanics::tissue::remesh::RemeshError;
use crate::mechanics::tissue::remesh::adapted::RefusedMove;
use crate::mechanics::tissue::rigid::RigidError;
use crate::mechanics::tissue::switching::SwitchError;

/// Why a mesh cannot be studied.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The dense inverses are larger than the memory of the machine.
    #[error(
        "a mesh of {size} degrees of freedom needs {:.1} GiB for its dense inverses, and {:.1} GiB of memory are available; \
         take a coarser mesh",
        gib(*needed), gib(*available)
    )]
    Memory {
        /// Degrees of freedom.
        size: usize,
        /// Bytes that are needed.
        needed: usize,
        /// Bytes that can be had.
        available: usize,
    },
    /// The line through the mesh crosses too few elements with a corner that can be moved.
    #[error(
        "only {moves} corners can be moved along the needle's line, {} expected: the mesh is too coarse, or lies beside the \
         line down through the middle of its box",
        super::subject::LEAST_MOVES
    )]
    Track {
        /// Moves found.
        moves: usize,
    },
    /// There are too few nodes for the contacts.
    #[error("the mesh has {found} free nodes beside the needle, {expected} expected as contacts; take a finer mesh")]
    Contacts {
        /// Nodes found.
        found: usize,
        /// Nodes expected.
        expected: usize,
    },
    /// The material is no material.
    #[error(transparent)]
    Material(#[from] InvalidMaterial),
    /// The mesh can move as a whole or in part.
    #[error(transparent)]
    Rigid(#[from] RigidError),
    /// The mesh cannot be assembled.
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    /// Its stiffness cannot be factored.
    #[error(transparent)]
    Factor(#[from] FactorError),
    /// It has no inverse.
    #[error(transparent)]
    Inverse(#[from] InverseError),
    /// Entries of the inverse cannot be had.
    #[error(transparent)]
    Compliance(#[from] ComplianceError),
    /// A move that was possible before is not.
    #[error(transparent)]
    Move(#[from] RefusedMove),
    /// A remesher refuses.
    #[error(transparent)]
    Remesh(#[from] RemeshError),
    /// Contacts cannot be condensed.
    #[error(transparent)]
    Condensed(#[from] CondensedError),
    /// Contacts cannot be solved for.
    #[error(transparent)]
    Switch(#[from] SwitchError),
    /// A device fails.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A locator of another mesh.
    #[error(transparent)]
    Locator(#[from] NodeCount),
}

impl StudyError {
    /// Whether the machine is at fault rather than what was asked for.
    pub fn is_machine(&self) -> bool {
        matches!(self, Self::Gpu(error) if error.is_machine())
    }
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}
