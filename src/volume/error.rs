//! What can be wrong with an image file.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::InvalidVolume;
use crate::output::atomic::WriteError;
use crate::{read, text};

/// Where in a file something is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// Somewhere in the header as a whole.
    Header,
    /// A line of a text header, counted from 1.
    Line(usize),
    /// A byte of the file, counted from 0.
    Byte(u64),
    /// The voxels as a whole.
    Voxels,
    /// The pixels of a picture.
    Pixels,
    /// The files of a folder.
    Folder,
}

impl fmt::Display for At {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Header => write!(f, "header"),
            Self::Line(line) => write!(f, "line {line}"),
            Self::Byte(byte) => write!(f, "byte {byte}"),
            Self::Voxels => write!(f, "voxels"),
            Self::Pixels => write!(f, "pixels"),
            Self::Folder => write!(f, "folder"),
        }
    }
}

/// Why an image file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum VolumeError {
    /// The system could not read the file.
    #[error("{}: cannot be read: {cause}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
    /// The system could not read the file of the data, which the header names.
    #[error("{}, {at}: the data file {} cannot be read: {cause}", path.display(), text::clipped(&data.to_string_lossy(), text::MESSAGE))]
    Data {
        /// The file of the header.
        path: PathBuf,
        /// Where in it.
        at: At,
        /// The file of the data.
        data: PathBuf,
        /// What the system said.
        cause: io::Error,
    },
    /// The file says something it cannot say.
    #[error("{}, {at}: found {found}, expected {expected}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Where in it.
        at: At,
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// The file may be sound, but it uses something that is not read here.
    #[error("{}, {at}: {found} is not supported; {expected}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// Where in it.
        at: At,
        /// What is not supported.
        found: String,
        /// What is, or what to do.
        expected: String,
    },
    /// A label volume holds a number that is no label.
    #[error(
        "{}: voxel ({}, {}, {}) is {value:?}, expected a whole number: this is no label volume (label values lie within 2^63 of 0)",
        path.display(), voxel[0], voxel[1], voxel[2]
    )]
    Fractional {
        /// The file.
        path: PathBuf,
        /// Index of the first such voxel.
        voxel: [usize; 3],
        /// Its value.
        value: f64,
    },
    /// The numbers are sound but make no label volume.
    #[error("{}: {cause}", path.display())]
    Volume {
        /// The file.
        path: PathBuf,
        /// What is wrong with them.
        cause: InvalidVolume,
    },
    /// The system could not write the file.
    #[error(transparent)]
    Write(#[from] WriteError),
}

impl VolumeError {
    /// Whether the machine failed, rather than the input: writing, and reading other than a file that is missing,
    /// forbidden or not a file at all.
    pub fn is_machine(&self) -> bool {
        match self {
            Self::Write(_) => true,
            Self::Read { cause, .. } | Self::Data { cause, .. } => read::is_machine(cause),
            _ => false,
        }
    }

    pub(crate) fn read(path: &Path, cause: io::Error) -> Self {
        Self::Read {
            path: path.to_owned(),
            cause,
        }
    }

    pub(crate) fn malformed(path: &Path, at: At, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            at,
            found: text::clipped(&found.into(), text::MESSAGE),
            expected: expected.into(),
        }
    }

    pub(crate) fn unsupported(path: &Path, at: At, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Unsupported {
            path: path.to_owned(),
            at,
            found: text::clipped(&found.into(), text::MESSAGE),
            expected: expected.into(),
        }
    }
}

/// Text of a file as an error shows it: quoted, cut to a readable length.
pub(crate) fn quoted(text: &str) -> String {
    const SHOWN: usize = 60;
    let mut shown: String = text.chars().take(SHOWN).collect();
    if shown.len() < text.len() {
        shown.push('…');
    }
    format!("{shown:?}")
}
