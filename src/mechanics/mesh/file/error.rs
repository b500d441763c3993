//! What can be wrong with a mesh file, and where in it.

use std::path::{Path, PathBuf};

use crate::mechanics::mesh::InvalidMesh;
use crate::memory::TooLarge;
use crate::output::atomic::WriteError;
use crate::{read, text};

/// Why a mesh file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The file cannot be opened or read.
    #[error("{}: cannot read the mesh: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// The contents break the format.
    #[error("{}: line {line} (byte {offset}): found {found}; expected {expected}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, from 1 (line ends inside binary data count too).
        line: usize,
        /// Byte offset, from 0.
        offset: usize,
        /// What stands there.
        found: String,
        /// What should stand there.
        expected: String,
    },
    /// The file is well formed, but what it describes is not a tetrahedral mesh.
    #[error("{}: {found}; expected {expected}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What it holds.
        found: String,
        /// What is needed.
        expected: String,
    },
    /// The cells do not make a valid mesh.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with them.
        source: InvalidMesh,
    },
    /// An array cannot be written beside the mesh.
    #[error("{}: the array `{name}` cannot be written: {problem}", path.display())]
    Array {
        /// The file.
        path: PathBuf,
        /// The array.
        name: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A time series with a time that is none.
    #[error("{}: `{file}` is given the time {time}; times must be finite", path.display())]
    Time {
        /// The list.
        path: PathBuf,
        /// The file of that time.
        file: String,
        /// Its time.
        time: f64,
    },
}

impl MeshFileError {
    /// Whether the machine is at fault rather than the input: the output cannot be written, the memory is short, the disk fails.
    pub fn is_machine(&self) -> bool {
        match self {
            MeshFileError::Write(_) => true,
            MeshFileError::Read { source, .. } => read::is_machine(source),
            _ => false,
        }
    }
}

/// A fault at a byte offset or in the whole, or more memory wanted than there is.
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
    pub fn at(offset: usize, found: impl Into<String>, expected: impl Into<String>) -> Fault {
        Fault::Contents {
            offset: Some(offset),
            found: text::clipped(&found.into(), text::MESSAGE),
            expected: expected.into(),
        }
    }

    pub fn whole(found: impl Into<String>, expected: impl Into<String>) -> Fault {
        Fault::Contents {
            offset: None,
            found: text::clipped(&found.into(), text::MESSAGE),
            expected: expected.into(),
        }
    }

    /// The error that tells of it, with the line of the offset.
    pub fn locate(self, bytes: &[u8], path: &Path) -> MeshFileError {
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

/// Bytes as an error message can show them.
pub(super) fn quote(bytes: &[u8]) -> String {
    const SHOWN: usize = 60;
    match bytes.get(..SHOWN) {
        _ if bytes.is_empty() => "the end of the file".to_owned(),
        Some(start) => format!("`{}...`", start.escape_ascii()),
        None => format!("`{}`", bytes.escape_ascii()),
    }
}
