//! Errors of studies.

use insonify_base::cause::Cause;
use insonify_base::csv::CsvError;
use insonify_base::document::InputError;
use insonify_base::output::OutputError;
use insonify_base::range::OutOfRange;
use insonify_gpu::GpuError;
use insonify_imaging::synth::SynthError;
use insonify_mechanics::insertion::{InvalidSetup, StepError};
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::nonlinear::NonlinearError;
use insonify_mechanics::tissue::remesh::RemeshError;
use insonify_mesh::InvalidMesh;
use insonify_tracking::TrackingError;

/// Why a study cannot be carried out.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// An option is out of range.
    #[error(transparent)]
    Number(#[from] OutOfRange),
    /// The dense inverses exceed the memory of the machine.
    #[error(
        "{what} needs {:.1} GiB for its dense inverses, and {:.1} GiB of memory are available; take a coarser mesh (fewer nodes)",
        gib(*needed), gib(*available)
    )]
    Memory {
        /// Model, with its size.
        what: String,
        /// Bytes needed.
        needed: usize,
        /// Bytes available.
        available: usize,
    },
    /// A request that cannot be met, with the reason.
    #[error("{0}")]
    Refused(String),
    /// A table cannot be read.
    #[error(transparent)]
    Table(#[from] CsvError),
    /// A step of a needle that pushes tissue cannot be solved.
    #[error("at {travel_mm} mm: {cause}")]
    Travel {
        /// Travel of the needle, mm.
        travel_mm: f64,
        /// Solver error.
        cause: NonlinearError,
    },
    /// An output cannot be drawn or written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The scene is invalid.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A path of needle or probe is invalid.
    #[error(transparent)]
    Path(#[from] TrackingError),
    /// A frame cannot be rendered.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// A GPU operation failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// A mesh cannot be created.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// The stiffness cannot be assembled, factorised or inverted.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// Nonlinear tissue cannot be solved.
    #[error(transparent)]
    Nonlinear(#[from] NonlinearError),
    /// A remesher refuses a change.
    #[error(transparent)]
    Remesh(#[from] RemeshError),
    /// An insertion cannot be set up.
    #[error(transparent)]
    Setup(#[from] InvalidSetup),
    /// A step of an insertion cannot be computed.
    #[error(transparent)]
    Step(#[from] StepError),
}

impl Cause for StudyError {
    fn is_machine(&self) -> bool {
        match self {
            Self::Synth(error) => error.is_machine(),
            Self::Gpu(error) => error.is_machine(),
            Self::Input(error) => error.is_machine(),
            Self::Output(error) => error.is_machine(),
            Self::Table(error) => error.is_machine(),
            _ => false,
        }
    }

    fn input(&self) -> Option<&InputError> {
        match self {
            Self::Input(error) => Some(error),
            _ => None,
        }
    }
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}
