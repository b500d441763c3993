//! What can be wrong with a scene, and where in its file.

use std::path::PathBuf;

use super::file::SceneFile;
use crate::document::{Fault, Unreadable};
use crate::effects::OutOfRange;
use crate::mechanics::mesh::file::MeshFileError;
use crate::mechanics::mesh::{InvalidDisplacement, InvalidMesh};
use crate::phantom::PhantomError;
use crate::tissue::TissueError;
use crate::tracking::calibration::CalibrationError;
use crate::tracking::needle::InvalidNeedle;
use crate::tracking::pose::InvalidPose;
use crate::tracking::probe::{InvalidGrid, InvalidProbe};
use crate::tracking::trajectory::TrajectoryError;
use crate::volume::VolumeError;
use crate::volume::complete::CompletionError;
use crate::volume::texture::InvalidTexture;

/// Why a scene cannot be used: what is wrong, the key that it is about and where that stands in the file.
pub type SceneError = Fault<Problem>;

/// What is wrong with a scene.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The file cannot be read, or says what no scene says.
    #[error(transparent)]
    Text(#[from] Unreadable),
    /// Keys that contradict each other, or do not say enough.
    #[error("found {found}; expected {expected}")]
    Keys {
        /// What is there.
        found: String,
        /// What should be.
        expected: &'static str,
    },
    /// A number outside its range.
    #[error("found {found}; expected {expected}")]
    Number {
        /// The number.
        found: f64,
        /// The range.
        expected: &'static str,
    },
    /// A name that nothing in the scene has.
    #[error("nothing here is named \"{found}\"; expected {expected}")]
    Name {
        /// The name.
        found: String,
        /// What there is.
        expected: String,
    },
    /// A tracked sequence without the transform asked for.
    #[error("no frame of {} has `{transform}`, or valid transforms that connect the two; it has {has}", path.display())]
    NoTransform {
        /// The sequence.
        path: PathBuf,
        /// The transform asked for.
        transform: String,
        /// The transforms that are there.
        has: String,
    },
    /// A transform that has no valid pose in any frame.
    #[error("`{transform}`: {source}")]
    NoPose {
        /// The transform asked for.
        transform: String,
        /// The cause.
        source: TrajectoryError,
    },
    /// A frame past the last.
    #[error("frame {frame} of {of}; frames count from 0")]
    Frame {
        /// The frame asked for, from 0.
        frame: usize,
        /// Frames that there are.
        of: usize,
    },
    /// A phantom cannot be made.
    #[error(transparent)]
    Phantom(#[from] PhantomError),
    /// A volume, texture or sequence file cannot be read.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A volume cannot be completed.
    #[error(transparent)]
    Completion(#[from] CompletionError),
    /// A tissue is wrong.
    #[error(transparent)]
    Tissue(#[from] TissueError),
    /// A texture is wrong.
    #[error(transparent)]
    Texture(#[from] InvalidTexture),
    /// The probe is wrong.
    #[error(transparent)]
    Probe(#[from] InvalidProbe),
    /// The pose is wrong.
    #[error(transparent)]
    Pose(#[from] InvalidPose),
    /// The needle is wrong.
    #[error(transparent)]
    Needle(#[from] InvalidNeedle),
    /// A path is wrong.
    #[error(transparent)]
    Trajectory(#[from] TrajectoryError),
    /// A calibration is wrong.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// A displacement field is wrong.
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
    /// The image cannot be laid out.
    #[error(transparent)]
    Image(#[from] InvalidGrid),
}

impl SceneError {
    /// Whether the machine failed rather than the scene: a file that is there cannot be read.
    pub fn is_machine(&self) -> bool {
        self.problem().is_machine()
    }
}

impl Problem {
    /// Whether the machine failed rather than the scene.
    pub(crate) fn is_machine(&self) -> bool {
        match self {
            Self::Text(error) => error.is_machine(),
            Self::Phantom(error) => error.is_machine(),
            Self::Volume(error) => error.is_machine(),
            Self::MeshFile(error) => error.is_machine(),
            Self::Trajectory(error) => error.is_machine(),
            Self::Calibration(error) => error.is_machine(),
            _ => false,
        }
    }
}

impl SceneFile {
    /// An error about a key of this file.
    pub(super) fn fault(&self, key: impl Into<String>, problem: impl Into<Problem>) -> SceneError {
        SceneError::new(problem).at_key(key, self.source.as_ref())
    }

    /// As [`SceneFile::fault`], for keys that contradict each other or do not say enough.
    pub(super) fn wrong_keys(
        &self,
        key: impl Into<String>,
        found: impl Into<String>,
        expected: &'static str,
    ) -> SceneError {
        let found = found.into();
        self.fault(key, Problem::Keys { found, expected })
    }
}

/// Ties an error to a key of a scene file.
pub(super) trait At<T> {
    fn at(self, file: &SceneFile, key: &str) -> Result<T, SceneError>;
}

impl<T, E: Into<Problem>> At<T> for Result<T, E> {
    fn at(self, file: &SceneFile, key: &str) -> Result<T, SceneError> {
        self.map_err(|problem| file.fault(key, problem))
    }
}
