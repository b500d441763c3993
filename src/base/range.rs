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

/// Parses finite numbers separated by commas.
pub(crate) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let found: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok().filter(|number: &f64| number.is_finite()))
        .collect();
    let found = found.and_then(|found| found.try_into().ok());
    found.ok_or_else(|| format!("expected {N} finite numbers separated by commas"))
}

/// Checks that a number is finite and `holds`.
pub(crate) fn check(key: &str, found: f64, holds: bool, expected: impl Into<String>) -> Result<(), OutOfRange> {
    match found.is_finite() && holds {
        true => Ok(()),
        false => Err(OutOfRange::new(key, found, expected)),
    }
}
