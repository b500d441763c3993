//! Errors of studies.

use std::path::PathBuf;

use crate::base::csv::CsvError;
use crate::base::output::OutputError;
use crate::base::range::OutOfRange;
use crate::gpu::GpuError;
use crate::imaging::synth::SynthError;
use crate::input::InputError;
use crate::mechanics::insertion::{InvalidSetup, StepError};
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::tissue::error::LinearError;
use crate::mechanics::tissue::nonlinear::NonlinearError;
use crate::mechanics::tissue::remesh::RemeshError;
use crate::tracking::TrackingError;

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
    /// The needle's line crosses too few elements with a movable corner.
    #[error(
        "only {moves} corners can be moved along the needle's line, {expected} expected: the mesh is too coarse, or lies beside \
         the line down through the middle of its box"
    )]
    Track {
        /// Number of moves found.
        moves: usize,
        /// Number of moves expected.
        expected: usize,
    },
    /// The mesh has too few nodes for the contacts.
    #[error("the mesh has {found} free nodes beside the needle, {expected} expected as contacts; take a finer mesh")]
    Contacts {
        /// Number of nodes found.
        found: usize,
        /// Number of nodes expected.
        expected: usize,
    },
    /// There are fewer than two grids to compare.
    #[error("{0} grids: expected two or more; the finest is the gold standard")]
    Grids(usize),
    /// The gold standard cannot be solved.
    #[error("the gold standard cannot be solved: {0}")]
    Gold(String),
    /// A table cannot be read.
    #[error(transparent)]
    Table(#[from] CsvError),
    /// A measured curve with too few points.
    #[error(
        "the curve: found {0} points beyond 0 mm before the force drops; expected at least 4, with a force above 0 N"
    )]
    Curve(usize),
    /// An insertion that cannot be scored.
    #[error("{} {reason}", run.display())]
    Unscored {
        /// Folder or table of the run.
        run: PathBuf,
        /// What it lacks.
        reason: &'static str,
    },
    /// No task fulfils the conditions.
    #[error("none of {tried} random targets in {organ} fulfils the conditions: {reasons}")]
    NoTask {
        /// Name of the organ.
        organ: String,
        /// Number of targets tried.
        tried: usize,
        /// Numbers of refused targets and their reasons, the most frequent first.
        reasons: String,
    },
    /// A target that no needle may be sent to.
    #[error("the target {found}; expected {expected}")]
    Target {
        /// What the target is.
        found: String,
        /// Permitted targets.
        expected: &'static str,
    },
    /// No line to a target fulfils the conditions.
    #[error("no path to {target}: of {tried} lines {reasons}")]
    NoPath {
        /// The target.
        target: String,
        /// Number of lines tried.
        tried: usize,
        /// Numbers of excluded lines and their reasons, the most frequent first.
        reasons: String,
    },
    /// No label or tissue has the name.
    #[error("no label or tissue is named {organ:?}; expected one of {known}")]
    NoOrgan {
        /// The name.
        organ: String,
        /// Names of the volume.
        known: String,
    },
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

impl StudyError {
    /// Returns whether the machine failed, rather than the input.
    pub fn is_machine(&self) -> bool {
        match self {
            Self::Synth(SynthError::Gpu(error)) | Self::Gpu(error) => error.is_machine(),
            Self::Synth(SynthError::Memory(_)) => true,
            Self::Input(error) => error.is_machine(),
            Self::Output(error) => error.is_machine(),
            Self::Table(error) => error.is_machine(),
            _ => false,
        }
    }
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}
