//! Errors of studies.

use std::ops::ControlFlow;

use insonify::Error;
use insonify_base::blame::Blame;
use insonify_mechanics::tissue::nonlinear::NonlinearError;

/// Why a study cannot be carried out, other than by an error of a part that it uses.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
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
    /// A step of a needle that pushes tissue cannot be solved.
    #[error("at {travel_mm} mm: {cause}")]
    Travel {
        /// Travel of the needle, mm.
        travel_mm: f64,
        /// Solver error.
        cause: NonlinearError,
    },
    /// The progress callback has said stop.
    #[error("stopped before the end")]
    Stopped,
}

impl StudyError {
    /// Goes on, or ends with [`StudyError::Stopped`], as a progress callback says.
    pub(crate) fn unless_stopped(flow: ControlFlow<()>) -> Result<(), Error> {
        if flow.is_break() {
            return Err(Self::Stopped.into());
        }
        Ok(())
    }

    /// Error of a request that cannot be met, with the reason.
    pub(crate) fn refused(reason: impl Into<String>) -> Error {
        Self::Refused(reason.into()).into()
    }
}

impl Blame for StudyError {
    fn is_machine(&self) -> bool {
        matches!(self, Self::Travel { cause, .. } if cause.is_machine())
    }
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}
