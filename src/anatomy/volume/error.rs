//! Errors of image files.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use insonify_base::blame::Blame;
use insonify_base::csv::CsvError;
use insonify_base::memory::TooLarge;
use insonify_base::output::OutputError;
use insonify_base::{read, text};

/// Position of an error in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// The header in general.
    Header,
    /// A line of a text header, counted from 1.
    Line(usize),
    /// A byte of the file, counted from 0.
    Byte(u64),
    /// The voxels in general.
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

/// Why an image cannot be read, made, completed or written.
#[derive(Debug, thiserror::Error)]
pub enum VolumeError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {cause}", path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The data file named in the header cannot be read.
    #[error("{}, {at}: the data file {} cannot be read: {cause}", path.display(), text::clipped(&data.to_string_lossy(), text::MESSAGE))]
    Data {
        /// Path of the header file.
        path: PathBuf,
        /// Position of the name in the header.
        at: At,
        /// Path of the data file.
        data: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The file contains an invalid value.
    #[error("{}, {at}: found {found}, expected {expected}", path.display())]
    Malformed {
        /// Path of the file.
        path: PathBuf,
        /// Position in the file.
        at: At,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The file may be valid, but uses an unsupported feature.
    #[error("{}, {at}: {found} is not supported; {expected}", path.display())]
    Unsupported {
        /// Path of the file.
        path: PathBuf,
        /// Position in the file.
        at: At,
        /// What is not supported.
        found: String,
        /// What is supported, or what to do.
        expected: String,
    },
    /// A label volume holds a number that is not a label.
    #[error(
        "{}: voxel ({}, {}, {}) is {value:?}{origin}, expected a whole number: this is no label volume (labels are stored as whole \
         numbers within 2^63 of 0, without a scale; a segmentation is resampled by the nearest neighbour, of a \
         probability map save where it is at least 0.5)",
        path.display(), voxel[0], voxel[1], voxel[2]
    )]
    Fractional {
        /// Path of the file.
        path: PathBuf,
        /// Index of the first such voxel.
        voxel: [usize; 3],
        /// Value of the voxel.
        value: f64,
        /// Stored number and scale, in brackets, if there is a scale.
        origin: String,
    },
    /// The numbers are valid but do not form a label volume.
    #[error("{}: {cause}", path.display())]
    Volume {
        /// Path of the file.
        path: PathBuf,
        /// Cause of the error.
        cause: Box<VolumeError>,
    },
    /// More distinct labels than a byte can index.
    #[error(
        "at least {0} distinct labels; at most 256 are supported (is this a grey image, such as a reconstructed volume, rather than a label \
         map? Labels come from its segmentation. Echoes: insonify rf --bmode)"
    )]
    TooManyLabels(usize),
    /// An option, or a part of a volume or texture, is invalid.
    #[error("{text}")]
    Value {
        /// Name of the option, if it is one.
        key: Option<&'static str>,
        /// What was found and expected.
        text: String,
    },
    /// A table cannot be read.
    #[error(transparent)]
    Csv(#[from] CsvError),
    /// More memory is needed than is available.
    #[error(transparent)]
    Memory(#[from] TooLarge),
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] OutputError),
}

impl VolumeError {
    /// Name of the option at fault, if it is one.
    pub fn key(&self) -> Option<&'static str> {
        match self {
            Self::Value { key, .. } => *key,
            _ => None,
        }
    }

    /// An error about no particular option; `text` says what was found and expected.
    pub fn new(text: impl Into<String>) -> Self {
        let (key, text) = (None, text.into());
        Self::Value { key, text }
    }

    /// An error about the option `key`; `text` says what was found and expected.
    pub fn option(key: &'static str, text: String) -> Self {
        let key = Some(key);
        Self::Value { key, text }
    }

    pub(super) fn wrong_count(found: usize, expected: usize) -> Self {
        Self::new(format!("{found} voxels for a size that needs {expected}"))
    }

    /// An error if there are more labels than a byte can index.
    pub(crate) fn check_labels(labels: usize) -> Result<(), Self> {
        if labels > 256 {
            Err(Self::TooManyLabels(labels))
        } else {
            Ok(())
        }
    }

    /// The error as one of a file.
    pub fn in_file(self, path: &Path) -> Self {
        let (path, cause) = (path.to_owned(), Box::new(self));
        Self::Volume { path, cause }
    }

    /// An error of the operating system in reading a file.
    pub fn read(path: &Path, cause: io::Error) -> Self {
        Self::Read {
            path: path.to_owned(),
            cause,
        }
    }

    /// An error about an invalid value in a file; a long `found` is shortened.
    pub fn malformed(path: &Path, at: At, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Malformed {
            path: path.to_owned(),
            at,
            found: text::clipped(&found.into(), text::MESSAGE),
            expected: expected.into(),
        }
    }

    /// An error about an unsupported feature of a file; a long `found` is shortened.
    pub fn unsupported(path: &Path, at: At, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Unsupported {
            path: path.to_owned(),
            at,
            found: text::clipped(&found.into(), text::MESSAGE),
            expected: expected.into(),
        }
    }
}

impl Blame for VolumeError {
    fn is_machine(&self) -> bool {
        match self {
            Self::Write(error) => error.is_machine(),
            Self::Memory(_) => true,
            Self::Csv(error) => error.is_machine(),
            Self::Read { cause, .. } | Self::Data { cause, .. } => read::is_machine(cause),
            _ => false,
        }
    }
}

/// Text of a file as shown in an error: quoted and truncated to a readable length; bytes that are no text are not
/// shown.
pub(super) fn quoted(text: &str) -> String {
    const SHOWN: usize = 60;
    if !is_text(text) {
        return "bytes that are no text".to_owned();
    }
    let mut shown: String = text.chars().take(SHOWN).collect();
    if shown.len() < text.len() {
        shown.push('…');
    }
    format!("\"{}\"", shown.replace(['\t', '\n', '\r'], " "))
}

/// Whether decoded bytes are text: no control characters but tabs and line ends, and none that is no UTF-8.
pub(super) fn is_text(text: &str) -> bool {
    let strange = |c: char| (c.is_control() && !c.is_ascii_whitespace()) || c == char::REPLACEMENT_CHARACTER;
    !text.contains(strange)
}
