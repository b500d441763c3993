//! Failures of subcommands and their exit status.

use std::fmt;
use std::io;

use crate::error::{Error, INPUT, MACHINE};
use crate::study::StudyError;
use miette::{Diagnostic, LabeledSpan, SourceCode};

/// Why a subcommand failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Error of the library.
    #[error(transparent)]
    Library(Box<Error>),
    /// Error of a study.
    #[error(transparent)]
    Study(Box<StudyError>),
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
    pub fn usage(found: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Usage {
            found: found.into(),
            help: help.into(),
        }
    }

    /// Exit status: 2 if the user can correct the request, 1 if the machine failed.
    pub fn status(&self) -> u8 {
        match self {
            Self::Library(error) => error.exit_status(),
            Self::Study(error) if error.is_machine() => MACHINE,
            Self::Usage { .. } | Self::Study(_) => INPUT,
            Self::Unstable { .. } | Self::Unmeasured { .. } | Self::Output(_) => MACHINE,
        }
    }
}

impl Diagnostic for Failure {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        match self {
            Self::Library(error) => error.help(),
            Self::Usage { help, .. } => Some(Box::new(help)),
            _ => None,
        }
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        match self {
            Self::Library(error) => error.source_code(),
            _ => None,
        }
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        match self {
            Self::Library(error) => error.labels(),
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

impl<E: Into<Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Library(Box::new(error.into()))
    }
}

impl From<StudyError> for Failure {
    fn from(error: StudyError) -> Self {
        Self::Study(Box::new(error))
    }
}
