//! Errors of case files.

use super::file::CaseFile;
use crate::base::document::{Fault, Unreadable};
use crate::mechanics::tissue::viscoelastic::HistoryError;

/// Error of a material test: the cause, the key concerned and its place in the file.
pub type MaterialCaseError = Fault<Wrong>;

/// Cause of an error of a material test.
#[derive(Debug, thiserror::Error)]
pub enum Wrong {
    /// The file cannot be read or parsed.
    #[error(transparent)]
    Text(#[from] Unreadable),
    /// Keys that contradict each other, or are incomplete.
    #[error("found {found}; expected {expected}")]
    Keys {
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The material or its history is invalid.
    #[error(transparent)]
    Point(#[from] HistoryError),
}

impl MaterialCaseError {
    /// Whether the machine is at fault rather than the input.
    pub fn is_machine(&self) -> bool {
        match self.problem() {
            Wrong::Text(error) => error.is_machine(),
            Wrong::Keys { .. } | Wrong::Point(_) => false,
        }
    }
}

impl CaseFile {
    /// Creates an error about keys that contradict each other or are incomplete.
    pub(super) fn wrong_keys(
        &self,
        key: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> MaterialCaseError {
        let (found, expected) = (found.into(), expected.into());
        MaterialCaseError::new(Wrong::Keys { found, expected }).at_key(key, self.source.as_ref())
    }

    /// Attaches the key concerned to an error.
    pub(super) fn blame(&self, error: HistoryError) -> MaterialCaseError {
        let key = match &error {
            HistoryError::Number { key, at, .. } => {
                let key = match *key {
                    "time_s" | "value" => format!("history.{key}"),
                    // In a case file the knee refers to the shear strain.
                    "knee_strain" => "knee_shear".to_owned(),
                    _ => (*key).to_owned(),
                };
                at.map_or(key.clone(), |at| format!("{key}[{at}]"))
            }
            HistoryError::Lengths { .. } => "history.value".to_owned(),
            HistoryError::Overflow { .. } => "history.value".to_owned(),
            _ => "history.time_s".to_owned(),
        };
        MaterialCaseError::new(error).at_key(key, self.source.as_ref())
    }
}
