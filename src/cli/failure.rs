//! Failures of subcommands and their exit status.

use std::io;

use insonify::error::{INPUT, MACHINE};
use insonify_base::cause::Cause;
use insonify_base::document::{Excerpt, InputError};

/// Why a subcommand failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// Error of the library or of a study.
    #[error("{0}")]
    Library(Box<dyn Cause>),
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
    /// Standard output is full, or closed other than by a reader that stopped reading.
    #[error("standard output cannot be written: {0}")]
    Output(io::Error),
}

impl Failure {
    /// Creates an error for invalid arguments: what was requested, and what to request instead.
    pub(crate) fn usage(found: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Usage {
            found: found.into(),
            help: help.into(),
        }
    }

    /// The error of an input file that this failure carries.
    fn input(&self) -> Option<&InputError> {
        match self {
            Self::Library(error) => error.input(),
            _ => None,
        }
    }

    /// What to do instead, if it is known.
    pub(crate) fn help(&self) -> Option<&str> {
        match self {
            Self::Usage { help, .. } => Some(help),
            _ => self.input()?.help(),
        }
    }

    /// The lines of a file that this failure is about.
    pub(crate) fn excerpt(&self) -> Option<&Excerpt> {
        self.input()?.excerpt()
    }

    /// Exit status: 2 if the user can correct the request, 1 if the machine failed.
    pub(crate) fn status(&self) -> u8 {
        match self {
            Self::Library(error) if error.is_machine() => MACHINE,
            Self::Usage { .. } | Self::Library(_) => INPUT,
            Self::Unstable { .. } | Self::Unmeasured { .. } | Self::Output(_) => MACHINE,
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

impl<E: Cause> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Library(Box::new(error))
    }
}
