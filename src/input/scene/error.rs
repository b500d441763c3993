//! Errors at keys of scene files.

use super::file::SceneFile;
use crate::input::{Cause, InputError};

/// Attaches an error to a key of a scene file.
pub(super) trait At<T> {
    fn at(self, file: &SceneFile, key: &str) -> Result<T, InputError>;
}

impl<T, E: Into<Cause>> At<T> for Result<T, E> {
    fn at(self, file: &SceneFile, key: &str) -> Result<T, InputError> {
        self.map_err(|cause| file.fault(key, cause))
    }
}
