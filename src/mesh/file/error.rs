//! Errors of mesh files, with their position.

use std::path::{Path, PathBuf};

use crate::InvalidMesh;
use insonify_base::blame::Blame;
use insonify_base::memory::TooLarge;
use insonify_base::output::OutputError;
use insonify_base::{read, text};

/// Reason why a mesh file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The file cannot be opened or read.
    #[error("{}: cannot read the mesh: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] OutputError),
    /// The contents violate the format.
    #[error("{}: line {line} (byte {offset}): found {found}; expected {expected}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, from 1 (line ends inside binary data count too).
        line: usize,
        /// Byte offset, from 0.
        offset: usize,
        /// Contents at that position.
        found: String,
        /// Expected contents.
        expected: String,
    },
    /// The file is well formed, but does not describe a tetrahedral mesh.
    #[error("{}: {found}; expected {expected}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Contents of the file.
        found: String,
        /// Required contents.
        expected: String,
    },
    /// The cells do not form a valid mesh.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The fault of the mesh.
        source: InvalidMesh,
    },
    /// An array cannot be written with the mesh.
    #[error("{}: the array `{name}` cannot be written: {problem}", path.display())]
    Array {
        /// The file.
        path: PathBuf,
        /// Name of the array.
        name: String,
        /// Description of the fault.
        problem: String,
    },
    /// A time in a time series is not finite.
    #[error("{}: `{file}` is given the time {time}; times must be finite", path.display())]
    Time {
        /// File of the time series.
        path: PathBuf,
        /// File of that time.
        file: String,
        /// The invalid time.
        time: f64,
    },
}

impl Blame for MeshFileError {
    fn is_machine(&self) -> bool {
        match self {
            MeshFileError::Write(error) => error.is_machine(),
            MeshFileError::Read { source, .. } => read::is_machine(source),
            _ => false,
        }
    }
}

/// A fault at a byte offset or in the entire file, or a lack of memory.
#[derive(Debug, PartialEq)]
pub(super) enum Fault {
    Contents {
        offset: Option<usize>,
        found: String,
        expected: String,
    },
    Memory(TooLarge),
}

impl From<TooLarge> for Fault {
    fn from(error: TooLarge) -> Fault {
        Fault::Memory(error)
    }
}

impl Fault {
    pub(super) fn at(offset: usize, found: impl Into<String>, expected: impl Into<String>) -> Fault {
        Fault::Contents {
            offset: Some(offset),
            found: text::clipped(&found.into(), text::MESSAGE),
            expected: expected.into(),
        }
    }

    pub(super) fn of_file(found: impl Into<String>, expected: impl Into<String>) -> Fault {
        Fault::Contents {
            offset: None,
            found: text::clipped(&found.into(), text::MESSAGE),
            expected: expected.into(),
        }
    }

    /// Converts the fault into an error with the line of its offset.
    pub(super) fn locate(self, bytes: &[u8], path: &Path) -> MeshFileError {
        let path = path.to_owned();
        match self {
            Fault::Memory(error) => MeshFileError::Read {
                path,
                source: error.into(),
            },
            Fault::Contents {
                offset: None,
                found,
                expected,
            } => MeshFileError::Content { path, found, expected },
            Fault::Contents {
                offset: Some(offset),
                found,
                expected,
            } => {
                let line = 1 + bytes[..offset.min(bytes.len())].iter().filter(|b| **b == b'\n').count();
                MeshFileError::Syntax {
                    path,
                    line,
                    offset,
                    found,
                    expected,
                }
            }
        }
    }
}

/// Formats bytes for an error message: text as it is, other bytes as "binary data".
pub(super) fn quote(bytes: &[u8]) -> String {
    const SHOWN: usize = 60;
    let shown = &bytes[..bytes.len().min(SHOWN)];
    // A character that the cut splits is no sign of binary data.
    let text = match std::str::from_utf8(shown) {
        Err(error) if error.error_len().is_none() => &shown[..error.valid_up_to()],
        _ => shown,
    };
    let text = String::from_utf8_lossy(text);
    let is_text = text
        .chars()
        .all(|c| c.is_whitespace() || !(c.is_control() || c == char::REPLACEMENT_CHARACTER));
    match text.trim_end() {
        _ if bytes.is_empty() => "the end of the file".to_owned(),
        _ if !is_text => "binary data".to_owned(),
        text if bytes.len() > SHOWN => format!("`{text}...`"),
        text => format!("`{text}`"),
    }
}
