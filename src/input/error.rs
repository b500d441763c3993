//! Errors of input files.

use crate::anatomy::acoustics::TissueError;
use crate::anatomy::volume::VolumeError;
use crate::base::document::{Fault, InvalidFile, NoRegion};
use crate::base::range::OutOfRange;
use crate::gpu::GpuError;
use crate::mechanics::insertion::InvalidSetup;
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::mesh::file::MeshFileError;
use crate::mechanics::mesh::generate::GenerateError;
use crate::mechanics::needle::beam::BeamError;
use crate::mechanics::tissue::error::LinearError;
use crate::mechanics::tissue::nonlinear::NonlinearError;
use crate::mechanics::tissue::viscoelastic::HistoryError;
use crate::tracking::TrackingError;

/// Error of an input file: the cause, the key concerned and its place in the file.
pub type InputError = Fault<Cause>;

/// Cause of an error of an input file.
#[derive(Debug, thiserror::Error)]
pub enum Cause {
    /// The file cannot be read or parsed, or its keys contradict each other.
    #[error(transparent)]
    Text(#[from] InvalidFile),
    /// A number is out of range.
    #[error(transparent)]
    Number(#[from] OutOfRange),
    /// An unknown region.
    #[error(transparent)]
    Region(#[from] NoRegion),
    /// A name, transform, pose or frame that the input lacks, with those that it has.
    #[error("{0}")]
    Unknown(String),
    /// A volume or phantom cannot be made or completed, or a volume, texture or sequence file cannot be read.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// The acoustic properties of a tissue are invalid.
    #[error(transparent)]
    Tissue(#[from] TissueError),
    /// The probe, its pose or path, the image, the needle or a calibration is invalid.
    #[error(transparent)]
    Tracking(#[from] TrackingError),
    /// The elements do not form a valid mesh, or one that computation can use.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// A mesh file cannot be read.
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// No mesh can be generated.
    #[error(transparent)]
    Generate(#[from] GenerateError),
    /// No GPU is available.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Linear tissue cannot be assembled, held or solved.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// The mesh does not form a valid body.
    #[error(transparent)]
    Body(#[from] NonlinearError),
    /// A step of a history failed.
    #[error("at {time_s} s: {cause}")]
    Step {
        /// The end of the step, s.
        time_s: f64,
        /// Cause of the failure.
        cause: NonlinearError,
    },
    /// A material test or its history is invalid.
    #[error(transparent)]
    History(#[from] HistoryError),
    /// The shape of a needle, or the wanted motion of its base, cannot be computed.
    #[error(transparent)]
    Beam(#[from] BeamError),
    /// No model of an insertion can be built.
    #[error(transparent)]
    Setup(#[from] InvalidSetup),
}

impl Cause {
    /// A name that is unknown in the file.
    pub(super) fn name(found: &str, expected: &str) -> Self {
        Self::Unknown(format!("unknown name \"{found}\"; expected {expected}"))
    }

    /// A node number outside the mesh.
    pub(super) fn node(found: i64, nodes: usize) -> Self {
        Self::Unknown(format!(
            "found node {found}; the mesh has {nodes} nodes, numbered from 0"
        ))
    }
}

impl InputError {
    /// Whether the machine is at fault rather than the input: an existing file cannot be read, memory is too small, or a device
    /// failed.
    pub fn is_machine(&self) -> bool {
        match self.problem() {
            Cause::Text(error) => error.is_machine(),
            Cause::Volume(error) => error.is_machine(),
            Cause::MeshFile(error) => error.is_machine(),
            Cause::Tracking(error) => error.is_machine(),
            Cause::Generate(error) => error.is_machine(),
            Cause::Gpu(error) => error.is_machine(),
            Cause::Setup(error) => error.is_machine(),
            Cause::Linear(error) => error.is_machine(),
            Cause::Body(error) | Cause::Step { cause: error, .. } => error.is_machine(),
            _ => false,
        }
    }
}
