//! Errors at keys of problem files.

use super::file::ProblemFile;
use super::selection::SelectionError;
use crate::base::document::InvalidFile;
use crate::input::InputError;

impl ProblemFile {
    /// Creates an error about a selection of nodes or axes.
    #[allow(clippy::boxed_local, reason = "the boxed error of a result")]
    pub(super) fn odd(&self, odd: SelectionError) -> InputError {
        self.fault(odd.0, odd.1)
    }

    /// Checks that a number is finite and no larger than `most`.
    pub(super) fn within(&self, key: &str, found: f64, most: f64, expected: &'static str) -> Result<(), InputError> {
        match found.abs() <= most {
            true => Ok(()),
            false => Err(self.fault(key, InvalidFile::number(found, expected))),
        }
    }

    /// Checks that each component of a vector is finite and no larger than `most`.
    pub(super) fn vector(
        &self,
        key: &str,
        vector: &[f64; 3],
        most: f64,
        expected: &'static str,
    ) -> Result<(), InputError> {
        let check = |(at, found): (usize, &f64)| self.within(&format!("{key}[{at}]"), *found, most, expected);
        vector.iter().enumerate().try_for_each(check)
    }
}
