//! Errors of probes, poses, needles, paths and calibrations.

use std::io;
use std::path::{Path, PathBuf};

use super::trajectory::SkipReason;
use insonify_base::blame::Blame;
use insonify_base::csv::CsvError;
use insonify_base::range::Ranges;
use insonify_base::read;

/// Why a probe, pose, needle, image grid, path, placement or calibration is invalid.
#[derive(Debug, thiserror::Error)]
pub enum TrackingError {
    /// A value is missing, superfluous or out of range.
    #[error("{text}")]
    Value {
        /// Key in the table, if a single one is at fault.
        key: Option<&'static str>,
        /// What was found and expected.
        text: String,
    },
    /// A keyframe's time or pose is invalid.
    #[error("keyframe {index}: {text}")]
    Keyframe {
        /// Index of the keyframe, from 0.
        index: usize,
        /// Key of the keyframe, if a single one is at fault.
        key: Option<&'static str>,
        /// What was found and expected.
        text: String,
    },
    /// A transform that places tracked frames is not rigid.
    #[error("{which} transform: {text}")]
    Transform {
        /// Name of the transform.
        which: &'static str,
        /// What was found and expected.
        text: String,
    },
    /// A tracked sequence in which no frame has a valid pose.
    #[error("none of {frames} frames has a valid pose; the first: {first}")]
    NoValidPose {
        /// Number of frames in the sequence.
        frames: usize,
        /// Reason for skipping the first one.
        first: SkipReason,
    },
    /// A table is malformed.
    #[error(transparent)]
    Csv(#[from] CsvError),
    /// A file cannot be opened or read.
    #[error("cannot read `{}`: {source}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// A file holds something else than expected.
    #[error("`{}`{text}", path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Place in the file, and what was found and expected there.
        text: String,
    },
}

impl TrackingError {
    /// An error of a table as a whole.
    pub fn new(text: impl Into<String>) -> Self {
        let (key, text) = (None, text.into());
        Self::Value { key, text }
    }

    /// An error at a key.
    pub fn at(key: &'static str, text: impl Into<String>) -> Self {
        let (key, text) = (Some(key), text.into());
        Self::Value { key, text }
    }

    pub(super) fn read(path: &Path, source: io::Error) -> Self {
        let path = path.to_owned();
        Self::Read { path, source }
    }

    /// An error about the contents of a file; `text` follows the path in the message, with its punctuation.
    pub fn file(path: &Path, text: impl Into<String>) -> Self {
        let (path, text) = (path.to_owned(), text.into());
        Self::File { path, text }
    }

    /// The error as one of a keyframe.
    pub(super) fn of_keyframe(self, index: usize) -> Self {
        let (key, text) = (self.key(), self.to_string());
        Self::Keyframe { index, key, text }
    }

    /// Key at fault, if there is a single one.
    pub fn key(&self) -> Option<&'static str> {
        match self {
            Self::Value { key, .. } | Self::Keyframe { key, .. } => *key,
            _ => None,
        }
    }
}

impl Blame for TrackingError {
    fn is_machine(&self) -> bool {
        match self {
            Self::Read { source, .. } => read::is_machine(source),
            Self::Csv(error) => error.is_machine(),
            _ => false,
        }
    }
}

/// An error unless every number of a table, `owner`, lies within its range.
pub(super) fn in_ranges(owner: &str, table: &impl Ranges) -> Result<(), TrackingError> {
    match table.out_of_range() {
        None => Ok(()),
        Some((key, number, expected)) => Err(outside(owner, key, number, &expected)),
    }
}

/// An error unless a number lies within the range that a table `T` has for its key.
pub(super) fn in_range<T: Ranges>(owner: &str, key: &'static str, number: f64) -> Result<(), TrackingError> {
    T::check_number(key, number).map_err(|error| outside(owner, key, number, &error.expected))
}

fn outside(owner: &str, key: &'static str, number: f64, expected: &str) -> TrackingError {
    TrackingError::at(key, format!("{owner} key `{key}` is {number}; expected {expected}"))
}

/// Key at fault in a result that must be a [`TrackingError::Value`].
#[cfg(test)]
pub(crate) fn key<T>(result: Result<T, TrackingError>) -> Option<&'static str> {
    match result {
        Err(TrackingError::Value { key, .. }) => key,
        Err(error) => panic!("{error}"),
        Ok(_) => panic!("no error"),
    }
}
