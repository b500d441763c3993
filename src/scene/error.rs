//! What can be wrong with a scene, and where in its file.

use std::fmt;
use std::io;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use miette::{Diagnostic, LabeledSpan, SourceCode};

use super::file::{SceneFile, VERSION};
use super::source::Source;
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
///
/// As a [`miette::Diagnostic`] it shows the line with a caret; as text it names key, file and line.
#[derive(Debug)]
pub struct SceneError(Box<Inner>);

#[derive(Debug)]
struct Inner {
    problem: Problem,
    key: Option<String>,
    /// Name of the scene file.
    file: Option<String>,
    /// Where in it the key is written.
    place: Option<Place>,
    help: Option<String>,
}

#[derive(Debug)]
struct Place {
    source: Arc<Source>,
    span: Range<usize>,
}

/// What is wrong with a scene.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The scene file cannot be read.
    #[error("{}: cannot be read: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
    /// The scene file is not text.
    #[error("{}: byte {byte} is not UTF-8 text", path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// The first byte that is no text, from 0.
        byte: usize,
    },
    /// Not TOML, or a value of the wrong type.
    #[error("{0}")]
    Syntax(String),
    /// A key that no scene has there.
    #[error("unknown key `{key}`")]
    UnknownKey {
        /// The key.
        key: String,
        /// The keys known in its table.
        known: Vec<String>,
    },
    /// Another version, or none.
    #[error("found {}, expected `version = {VERSION}`", found.map_or("no version".to_owned(), |found| format!("version {found}")))]
    Version {
        /// The version found.
        found: Option<u32>,
    },
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
    #[error("no frame of {} has or connects `{transform}`; it has {has}", path.display())]
    NoTransform {
        /// The sequence.
        path: PathBuf,
        /// The transform asked for.
        transform: String,
        /// The transforms that are there.
        has: String,
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
    pub(super) fn new(problem: impl Into<Problem>) -> Self {
        Self(Box::new(Inner {
            problem: problem.into(),
            key: None,
            file: None,
            place: None,
            help: None,
        }))
    }

    pub(super) fn in_text(mut self, source: &Arc<Source>, span: Option<Range<usize>>) -> Self {
        let source = Arc::clone(source);
        self.0.file = Some(source.name().to_owned());
        self.0.place = span.map(|span| Place { source, span });
        self
    }

    pub(super) fn with_help(mut self, help: Option<String>) -> Self {
        self.0.help = help;
        self
    }

    /// What is wrong.
    pub fn problem(&self) -> &Problem {
        &self.0.problem
    }

    /// Path of the key that it is about, such as `effects.speckle.axial_mm`, where it is about one.
    pub fn key(&self) -> Option<&str> {
        self.0.key.as_deref()
    }

    /// Name of the scene file and line (from 1), where the key is written in one.
    pub fn location(&self) -> Option<(&str, usize)> {
        let place = self.0.place.as_ref()?;
        Some((place.source.name(), place.source.line(place.span.start)))
    }

    /// Whether the machine failed rather than the scene: a file that is there cannot be read.
    pub fn is_machine(&self) -> bool {
        match &self.0.problem {
            Problem::Read { cause, .. } => !matches!(
                cause.kind(),
                io::ErrorKind::NotFound
                    | io::ErrorKind::PermissionDenied
                    | io::ErrorKind::IsADirectory
                    | io::ErrorKind::NotADirectory
                    | io::ErrorKind::InvalidInput
                    | io::ErrorKind::InvalidFilename
            ),
            Problem::Volume(error) => error.is_machine(),
            Problem::MeshFile(error) => error.is_machine(),
            _ => false,
        }
    }
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(key) = &self.0.key {
            write!(f, "{key}: ")?;
        }
        write!(f, "{}", self.0.problem)?;
        match self.location() {
            Some((name, line)) => write!(f, " ({name}, line {line})"),
            None => self.0.file.as_ref().map_or(Ok(()), |name| write!(f, " ({name})")),
        }
    }
}

impl std::error::Error for SceneError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.0.problem.source()
    }
}

impl Diagnostic for SceneError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.0.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.0.place.as_ref().map(|place| place as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.0.place.as_ref()?.span.clone();
        let label = LabeledSpan::new_primary_with_span(Some("here".to_owned()), span);
        Some(Box::new(std::iter::once(label)))
    }
}

impl SourceCode for Place {
    fn read_span<'a>(
        &'a self,
        span: &miette::SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn miette::SpanContents<'a> + 'a>, miette::MietteError> {
        let inner = self.source.text().read_span(span, before, after)?;
        Ok(Box::new(miette::MietteSpanContents::new_named(
            self.source.name().to_owned(),
            inner.data(),
            *inner.span(),
            inner.line(),
            inner.column(),
            inner.line_count(),
        )))
    }
}

impl SceneFile {
    /// An error about a key of this file.
    pub(super) fn fault(&self, key: impl Into<String>, problem: impl Into<Problem>) -> SceneError {
        let key = key.into();
        let mut error = SceneError::new(problem);
        if let Some(source) = &self.source {
            error = error.in_text(source, source.find(&key));
        }
        error.0.key = Some(key);
        error
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
