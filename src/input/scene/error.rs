//! Errors of scene files.

use std::path::PathBuf;

use super::file::SceneFile;
use crate::anatomy::acoustics::TissueError;
use crate::anatomy::volume::VolumeError;
use crate::base::document::{Fault, InvalidFile};
use crate::imaging::effects::OutOfRange;
use crate::mechanics::mesh::file::MeshFileError;
use crate::mechanics::mesh::{InvalidDisplacement, InvalidMesh};
use crate::tracking::TrackingError;

/// Error of a scene: the cause, the key concerned and its place in the file.
pub type SceneError = Fault<Problem>;

/// Cause of a scene error.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The file cannot be read or parsed.
    #[error(transparent)]
    Text(#[from] InvalidFile),
    /// A name that is unknown in the scene.
    #[error("nothing here is named \"{found}\"; expected {expected}")]
    Name {
        /// The unknown name.
        found: String,
        /// Known names.
        expected: String,
    },
    /// A tracked sequence without the requested transform.
    #[error("no frame of {} has `{transform}`, or valid transforms that connect the two; it has {has}", path.display())]
    NoTransform {
        /// Path of the sequence.
        path: PathBuf,
        /// Name of the requested transform.
        transform: String,
        /// Names of the available transforms.
        has: String,
    },
    /// A transform that has no valid pose in any frame.
    #[error("`{transform}`: {source}")]
    NoPose {
        /// Name of the requested transform.
        transform: String,
        /// Underlying error of the path.
        source: TrackingError,
    },
    /// A frame past the last.
    #[error("frame {frame} of {of}; frames count from 0")]
    Frame {
        /// Requested frame, from 0.
        frame: usize,
        /// Number of frames.
        of: usize,
    },
    /// A volume or phantom cannot be made or completed, or a volume, texture or sequence file cannot be read.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A tissue is invalid.
    #[error(transparent)]
    Tissue(#[from] TissueError),
    /// The probe, its pose or path, the image, the needle or a calibration is invalid.
    #[error(transparent)]
    Tracking(#[from] TrackingError),
    /// A displacement field is invalid.
    #[error(transparent)]
    Displacement(#[from] InvalidDisplacement),
    /// A mesh cannot be made.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// A mesh file cannot be read.
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// A parameter of an effect is out of range.
    #[error(transparent)]
    Effect(#[from] OutOfRange),
}

impl SceneError {
    /// Whether the machine is at fault rather than the scene: an existing file cannot be read.
    pub fn is_machine(&self) -> bool {
        self.problem().is_machine()
    }
}

impl Problem {
    /// Whether the machine is at fault rather than the scene.
    pub(crate) fn is_machine(&self) -> bool {
        match self {
            Self::Text(error) => error.is_machine(),
            Self::Volume(error) => error.is_machine(),
            Self::MeshFile(error) => error.is_machine(),
            Self::Tracking(error) => error.is_machine(),
            _ => false,
        }
    }
}

/// Attaches an error to a key of a scene file.
pub(super) trait At<T> {
    fn at(self, file: &SceneFile, key: &str) -> Result<T, SceneError>;
}

impl<T, E: Into<Problem>> At<T> for Result<T, E> {
    fn at(self, file: &SceneFile, key: &str) -> Result<T, SceneError> {
        self.map_err(|problem| file.fault(key, problem))
    }
}
