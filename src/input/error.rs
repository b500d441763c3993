//! Errors of input files.

use std::path::PathBuf;

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
    /// A name that is unknown in the file.
    #[error("unknown name \"{found}\"; expected {expected}")]
    Name {
        /// The unknown name.
        found: String,
        /// Known names.
        expected: String,
    },
    /// An unknown region.
    #[error(transparent)]
    Region(#[from] NoRegion),
    /// A node number outside the mesh.
    #[error("found node {found}; the mesh has {nodes} nodes, numbered from 0")]
    Node {
        /// The node number found.
        found: i64,
        /// Number of nodes.
        nodes: usize,
    },
    /// A tracked sequence without the requested transform.
    #[error("no frame of {} has `{transform}`, or valid transforms that connect the two; it has {has}", path.display())]
    NoTransform {
        /// Path of the sequence.
        path: PathBuf,
        /// Name of the requested transform.
        transform: String,
        /// Names of the available transforms.
        has: String,
    },
    /// A transform that has no valid pose in any frame.
    #[error("`{transform}`: {source}")]
    NoPose {
        /// Name of the requested transform.
        transform: String,
        /// Underlying error of the path.
        source: TrackingError,
    },
    /// A frame past the last.
    #[error("frame {frame} of {of}; frames count from 0")]
    Frame {
        /// Requested frame, from 0.
        frame: usize,
        /// Number of frames.
        of: usize,
    },
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
