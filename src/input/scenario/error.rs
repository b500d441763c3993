//! Errors at keys of scenario files.

use super::file::ScenarioFile;
use crate::base::document::InvalidFile;
use crate::input::InputError;

impl ScenarioFile {
    /// Returns a number of this file if it is within its range.
    pub(super) fn number(
        &self,
        key: impl Into<String>,
        found: f64,
        holds: impl FnOnce(f64) -> bool,
        expected: &'static str,
    ) -> Result<f64, InputError> {
        if found.is_finite() && holds(found) {
            Ok(found)
        } else {
            Err(self.fault(key, InvalidFile::number(found, expected)))
        }
    }

    /// Returns a direction vector of this file.
    pub(super) fn direction(
        &self,
        key: &str,
        found: [f64; 3],
    ) -> Result<nalgebra::Unit<nalgebra::Vector3<f64>>, InputError> {
        let finite = found.iter().all(|x| x.is_finite());
        nalgebra::Unit::try_new(nalgebra::Vector3::from(found), 1e-9)
            .filter(|_| finite)
            .ok_or_else(|| {
                let expected = "finite numbers that are not all zero";
                self.wrong_keys(key, format!("{found:?}"), expected)
            })
    }

    /// Returns a point of this file.
    pub(super) fn place(&self, key: &str, found: [f64; 3]) -> Result<nalgebra::Point3<f64>, InputError> {
        if found.iter().all(|x| x.abs() <= crate::base::matrix::FARTHEST_MM) {
            Ok(found.into())
        } else {
            let expected = "finite coordinates of at most 1e6 mm";
            Err(self.wrong_keys(key, format!("{found:?}"), expected))
        }
    }

    /// Converts an error of the scene, which lies in its own file or inline in this one.
    pub(super) fn of_scene(&self, mut error: InputError, is_inline: bool) -> InputError {
        let key = error.key().map(str::to_owned);
        if is_inline && key.as_deref() == Some("volume.file") && self.source.is_some() {
            let help = "the key `file` under [scene.volume] names the label file: put the path of your own there";
            error = error.with_help(Some(help.to_owned()));
        }
        match key {
            Some(key) if key.starts_with("needle") => error.at_key(key, self.source.as_ref()),
            Some(key) if is_inline => error.at_key(format!("scene.{key}"), self.source.as_ref()),
            _ => error,
        }
    }
}
