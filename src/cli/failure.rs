//! Failures of subcommands that are no errors of the library.

use std::io;

use insonify::Blame;
pub(crate) use insonify::Error;

/// Why a subcommand failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// Arguments that contradict each other or do not apply to this scene.
    #[error("{found}")]
    Usage {
        /// What was requested.
        found: String,
        /// What to request instead.
        help: String,
    },
    /// Stability cases that failed; they have been printed.
    #[error("{failed} of {cases} hard cases failed")]
    Unstable {
        /// Number of failed cases.
        failed: usize,
        /// Number of cases run.
        cases: usize,
    },
    /// A study that failed; the others were completed.
    #[error("the study `{study}` failed: {reason}{}", others(*more))]
    Unmeasured {
        /// Name of the study.
        study: String,
        /// Reason of the failure.
        reason: String,
        /// Number of further failed studies.
        more: usize,
    },
    /// The time limit is over.
    #[error("the time limit of {0} s is over")]
    OverTime(f64),
    /// A thread cannot be started.
    #[error("a thread cannot be started: {0}")]
    Thread(io::Error),
    /// No frame would show anything of the volume; the warnings of the scene say why.
    #[error("nothing is rendered: {0}")]
    Blind(String),
    /// Standard output is full, or closed other than by a reader that stopped reading.
    #[error("standard output cannot be written: {0}")]
    Output(io::Error),
}

/// Error of invalid arguments: what was requested, and what to request instead.
pub(crate) fn usage(found: impl Into<String>, help: impl Into<String>) -> Error {
    let (found, help) = (found.into(), help.into());
    Failure::Usage { found, help }.into()
}

impl Blame for Failure {
    fn is_machine(&self) -> bool {
        !matches!(self, Self::Usage { .. })
    }

    fn help(&self) -> Option<&str> {
        match self {
            Self::Usage { help, .. } => Some(help),
            Self::OverTime(_) => Some(
                "what is unfinished is gone, but for whole frames with --resume; give more time (--time-limit-s), or the run less to do",
            ),
            _ => None,
        }
    }
}

/// Describes further failures in words.
fn others(more: usize) -> String {
    match more {
        0 => String::new(),
        more => format!("; {more} more failed"),
    }
}
