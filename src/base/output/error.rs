//! Errors of output files.

use std::io;
use std::path::{Path, PathBuf};

use super::staged;
use crate::blame::Blame;

/// Why an output cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The system refuses to write a file.
    #[error("{}: cannot be written: {cause}", path.display())]
    Write {
        /// Path of the requested file.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// A name, or contents that do not fit the file.
    #[error("{}: {text}", path.display())]
    Contents {
        /// Path of the requested file.
        path: PathBuf,
        /// What was found and expected.
        text: String,
    },
    /// A folder cannot be created.
    #[error("{}: the folder cannot be created: {cause}", path.display())]
    Folder {
        /// Path of the folder.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The parent folder of a file does not exist.
    #[error("{}: its folder does not exist; create it first, or name another", path.display())]
    NoFolder {
        /// Path of the file.
        path: PathBuf,
    },
    /// A folder in place of a file, a file in place of a folder, or something that is neither.
    #[error("{}: the output must be {expected}", path.display())]
    Kind {
        /// The requested path.
        path: PathBuf,
        /// What can be written.
        expected: &'static str,
    },
    /// An existing file that this program did not write, or that is of another kind.
    #[error(
        "{}: this file is in the way: it is of another kind, or no earlier run into this folder lists it; name another place, or \
         replace it with --force",
        path.display()
    )]
    Taken {
        /// Path of the file.
        path: PathBuf,
    },
    /// An existing file that the same run reads.
    #[error("{}: the output would replace a file that this run reads; name another place, or replace it with --force", path.display())]
    Input {
        /// Path of the file.
        path: PathBuf,
    },
    /// A run that was cut off, or a finished one, that another run cannot go on with.
    #[error("{}: --resume: the run there has {text}; name another folder, or leave out --resume", path.display())]
    OtherRun {
        /// Path of the folder.
        path: PathBuf,
        /// The difference.
        text: String,
    },
    /// Two outputs of one run with the same path.
    #[error("{}: two outputs have this name; name another place for one of them", path.display())]
    Twice {
        /// The path.
        path: PathBuf,
    },
    /// A plot that the drawing library cannot draw.
    #[error("the plot \"{title}\" cannot be drawn: {cause}")]
    Plot {
        /// Title of the plot.
        title: String,
        /// Message of the drawing library.
        cause: String,
    },
    /// A report that cannot be serialised as JSON.
    #[error("the report cannot be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// Files that could not be moved to their final places at the end of a run.
    #[error("{cause}\nThe run finished, but only {moved} of its files could be moved into place; the rest are in {}", path.display())]
    Kept {
        /// Folder that holds the files.
        path: PathBuf,
        /// Number of files moved.
        moved: usize,
        /// Error that stopped the move.
        cause: Box<OutputError>,
    },
}

impl OutputError {
    /// Attaches the requested path to a system error.
    pub fn write(path: &Path, cause: io::Error) -> Self {
        let path = staged::shown(path);
        let cause = without_temporary_name(cause);
        Self::Write { path, cause }
    }

    /// An error about the name or contents of a file; `text` says what was found and expected.
    pub fn contents(path: &Path, text: String) -> Self {
        let path = path.to_owned();
        Self::Contents { path, text }
    }
}

impl Blame for OutputError {
    fn is_machine(&self) -> bool {
        use io::ErrorKind::{IsADirectory, NotADirectory, NotFound, PermissionDenied, ReadOnlyFilesystem};
        match self {
            Self::Write { cause, .. } | Self::Folder { cause, .. } => !matches!(
                cause.kind(),
                IsADirectory | NotADirectory | NotFound | PermissionDenied | ReadOnlyFilesystem
            ),
            Self::Plot { .. } | Self::Json(_) | Self::Kept { .. } => true,
            _ => false,
        }
    }
}

/// A system error without the name of the temporary file, which no longer exists.
pub(super) fn without_temporary_name(cause: io::Error) -> io::Error {
    match cause.to_string().split_once(" at path ") {
        Some((said, _)) => io::Error::new(cause.kind(), said),
        None => cause,
    }
}
