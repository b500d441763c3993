//! Checks of numbers against their ranges.

use std::fmt;

/// A parameter outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("`{key}` is {found}; expected {expected}")]
pub struct OutOfRange {
    /// Name of the parameter, such as `radius_mm`, or its path in a file.
    pub key: String,
    /// Value found.
    pub found: String,
    /// Permitted values.
    pub expected: String,
}

impl OutOfRange {
    pub(crate) fn new(key: impl Into<String>, found: impl fmt::Display, expected: impl Into<String>) -> Self {
        Self {
            key: key.into(),
            found: found.to_string(),
            expected: expected.into(),
        }
    }
}

/// Checks that a number is finite and `holds`.
pub(crate) fn check(key: &str, found: f64, holds: bool, expected: impl Into<String>) -> Result<(), OutOfRange> {
    match found.is_finite() && holds {
        true => Ok(()),
        false => Err(OutOfRange::new(key, found, expected)),
    }
}
