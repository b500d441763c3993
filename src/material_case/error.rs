//! What can be wrong with a case file.

use super::file::CaseFile;
use crate::document::{Fault, Unreadable};
use crate::mechanics::tissue::viscoelastic::point::PointError;

/// Why a material cannot be tested: what is wrong, the key that it is about and where that stands in the file.
pub type MaterialCaseError = Fault<Wrong>;

/// What is wrong with a test of a material.
#[derive(Debug, thiserror::Error)]
pub enum Wrong {
    /// The file cannot be read, or says what no case says.
    #[error(transparent)]
    Text(#[from] Unreadable),
    /// Keys that contradict each other, or do not say enough.
    #[error("found {found}; expected {expected}")]
    Keys {
        /// What is there.
        found: String,
        /// What should be.
        expected: String,
    },
    /// The material or its history is none.
    #[error(transparent)]
    Point(#[from] PointError),
}

impl MaterialCaseError {
    /// Whether the machine failed rather than the input.
    pub fn is_machine(&self) -> bool {
        match self.problem() {
            Wrong::Text(error) => error.is_machine(),
            Wrong::Keys { .. } | Wrong::Point(_) => false,
        }
    }
}

impl CaseFile {
    /// An error about keys that contradict each other or do not say enough.
    pub(super) fn wrong_keys(
        &self,
        key: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> MaterialCaseError {
        let (found, expected) = (found.into(), expected.into());
        MaterialCaseError::new(Wrong::Keys { found, expected }).at_key(key, self.source.as_ref())
    }

    /// The error with the key that it is about.
    pub(super) fn blame(&self, error: PointError) -> MaterialCaseError {
        let key = match &error {
            PointError::Number { key, at, .. } => {
                let key = match *key {
                    "time_s" | "value" => format!("history.{key}"),
                    // Here it is of the shear.
                    "knee_strain" => "knee_shear".to_owned(),
                    _ => (*key).to_owned(),
                };
                at.map_or(key.clone(), |at| format!("{key}[{at}]"))
            }
            PointError::Lengths { .. } => "history.value".to_owned(),
            PointError::History(_) => "history.time_s".to_owned(),
            PointError::Overflow { .. } => "history.value".to_owned(),
        };
        MaterialCaseError::new(error).at_key(key, self.source.as_ref())
    }
}
