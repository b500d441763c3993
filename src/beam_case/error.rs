//! What can be wrong with a case file.

use super::file::CaseFile;
use crate::document::{Fault, Unreadable};
use crate::mechanics::needle::beam::BeamError;
use crate::mechanics::needle::beam::inverse::InverseError;

/// Why a needle cannot be bent so: what is wrong, the key that it is about and where that stands in the file.
pub type BeamCaseError = Fault<Wrong>;

/// What is wrong with a case.
#[derive(Debug, thiserror::Error)]
pub enum Wrong {
    /// The file cannot be read, or says what no case says.
    #[error(transparent)]
    Text(#[from] Unreadable),
    /// A number outside its range.
    #[error("found {found}; expected {expected}")]
    Number {
        /// The number.
        found: f64,
        /// The range.
        expected: String,
    },
    /// Keys that contradict each other, or do not say enough.
    #[error("found {found}; expected {expected}")]
    Keys {
        /// What is there.
        found: String,
        /// What should be.
        expected: String,
    },
    /// The needle has no shape.
    #[error(transparent)]
    Beam(BeamError),
    /// No base motion brings about what is wanted.
    #[error(transparent)]
    Inverse(InverseError),
}

impl BeamCaseError {
    /// Whether the machine failed rather than the input.
    pub fn is_machine(&self) -> bool {
        matches!(self.problem(), Wrong::Text(error) if error.is_machine())
    }
}

impl CaseFile {
    /// An error about a key of this file.
    pub(super) fn fault(&self, key: impl Into<String>, wrong: impl Into<Wrong>) -> BeamCaseError {
        BeamCaseError::new(wrong).at_key(key, self.source.as_ref())
    }
}
