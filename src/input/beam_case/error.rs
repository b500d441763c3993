//! Errors of case files.

use super::file::CaseFile;
use crate::base::document::{Fault, Unreadable};
use crate::mechanics::needle::beam::BeamError;

/// Error of a case: the cause, the key concerned and its place in the file.
pub type BeamCaseError = Fault<Wrong>;

/// Cause of a case error.
#[derive(Debug, thiserror::Error)]
pub enum Wrong {
    /// The file cannot be read or parsed.
    #[error(transparent)]
    Text(#[from] Unreadable),
    /// A number outside its range.
    #[error("found {found}; expected {expected}")]
    Number {
        /// The number found.
        found: f64,
        /// The expected range.
        expected: String,
    },
    /// Keys that contradict each other, or are incomplete.
    #[error("found {found}; expected {expected}")]
    Keys {
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The shape of the needle, or the wanted motion of its base, cannot be computed.
    #[error(transparent)]
    Beam(BeamError),
}

impl BeamCaseError {
    /// Whether the machine is at fault rather than the input.
    pub fn is_machine(&self) -> bool {
        matches!(self.problem(), Wrong::Text(error) if error.is_machine())
    }
}

impl CaseFile {
    /// Creates an error about a key of this file.
    pub(super) fn fault(&self, key: impl Into<String>, wrong: impl Into<Wrong>) -> BeamCaseError {
        BeamCaseError::new(wrong).at_key(key, self.source.as_ref())
    }
}
