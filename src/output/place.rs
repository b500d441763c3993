//! Checks that outputs can be written, made before the computation.

use std::fs;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::atomic::{WriteError, folder_of};
use super::staged::{self, StagedFile};

/// Number of leading bytes compared to identify the kind of an existing file.
const START: u64 = 512;

/// Why an output cannot be written to a path.
#[derive(Debug, thiserror::Error)]
pub enum PlaceError {
    /// A file system error.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A folder cannot be created.
    #[error("{}: no folder can be made there: {cause}", path.display())]
    Folder {
        /// Path of the folder.
        path: PathBuf,
        /// Error of the operating system.
        cause: io::Error,
    },
    /// The parent folder of a file does not exist.
    #[error("{}: its folder is not there; make it first, or name another", path.display())]
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
    /// Two outputs of one run with the same path.
    #[error("{}: two outputs have this name; name another place for one of them", path.display())]
    Twice {
        /// The path.
        path: PathBuf,
    },
    /// Files that could not be moved to their final places at the end of a run.
    #[error("{cause}\nThe run is done, and {moved} of its files are in their places; the others are kept in {}", path.display())]
    Kept {
        /// Folder that holds the files.
        path: PathBuf,
        /// Number of files moved.
        moved: usize,
        /// Error that stopped the move.
        cause: Box<PlaceError>,
    },
}

impl PlaceError {
    /// Whether the machine is at fault rather than the request.
    pub fn is_machine(&self) -> bool {
        matches!(
            self,
            Self::Write(_) | Self::Folder { .. } | Self::NoFolder { .. } | Self::Kept { .. }
        )
    }
}

/// Checks that files can be written under these names: their folders exist and are writable, they are not folders and, without
/// `force`, none replaces one of the `inputs` or a file of another kind. Removes temporary files that killed runs left beside them.
///
/// # Errors
/// [`PlaceError`] if a file cannot be written.
pub fn check(files: &[&Path], inputs: &[PathBuf], force: bool) -> Result<(), PlaceError> {
    for (at, path) in files.iter().enumerate() {
        if files[..at].iter().any(|other| same(other, path)) {
            return Err(PlaceError::Twice {
                path: path.to_path_buf(),
            });
        }
        check_one(path, inputs, force)?;
    }
    Ok(())
}

fn check_one(path: &Path, inputs: &[PathBuf], force: bool) -> Result<(), PlaceError> {
    let wrong = |expected| PlaceError::Kind {
        path: path.to_owned(),
        expected,
    };
    let failed = |cause| WriteError::new(path, cause);
    match fs::metadata(path) {
        Ok(found) if !found.is_file() => return Err(wrong("a regular file")),
        Ok(_) if force => {}
        Ok(_) if inputs.iter().any(|input| same(input, path)) => {
            return Err(PlaceError::Input { path: path.to_owned() });
        }
        Ok(found) if found.len() > 0 && !is_same_kind(path).map_err(failed)? => {
            return Err(PlaceError::Taken { path: path.to_owned() });
        }
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => {
            return Err(wrong("a file in a folder; the path leads through a file"));
        }
        _ => {}
    }
    let folder = folder_of(path);
    if !folder.exists() {
        return Err(PlaceError::NoFolder { path: path.to_owned() });
    }
    staged::clear_leftovers(folder);
    StagedFile::within(folder).map(drop).map_err(failed)?;
    Ok(())
}

/// Whether two paths refer to the same file: by identity if it exists, otherwise by name.
fn same(a: &Path, b: &Path) -> bool {
    let whole = |path: &Path| {
        let folder = fs::canonicalize(folder_of(path)).ok()?;
        Some(fs::canonicalize(path).unwrap_or(folder.join(path.file_name()?)))
    };
    whole(a).is_some_and(|a| whole(b) == Some(a))
}

/// Whether an existing file starts like those that are written under such names.
fn is_same_kind(path: &Path) -> io::Result<bool> {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let marks: &[&[u8]] = match ending.as_ref().and_then(|ending| ending.to_str()) {
        Some("mha") => &[b"ObjectType", b"NDims"],
        Some("nrrd") => &[b"NRRD"],
        Some("nii") => &[b"n+1\0"],
        Some("gz") => &[&[0x1f, 0x8b]],
        Some("vtu") => &[b"<VTKFile"],
        Some("svg") => &[b"<svg"],
        Some("csv") => &[b"time_s"],
        Some("json") => &[b"\"frame\":"],
        _ => &[b"\x89PNG"],
    };
    let mut start = Vec::new();
    fs::File::open(path)?.take(START).read_to_end(&mut start)?;
    Ok(marks
        .iter()
        .any(|mark| start.windows(mark.len()).any(|part| part == *mark)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_another_kind_and_inputs_stay() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for (name, text) in [
            ("a.vtu", "<?xml version=\"1.0\"?>\n<VTKFile>"),
            ("notes.vtu", "my notes"),
            ("notes", "my notes"),
            ("empty.png", ""),
            ("a.png", "\x7fPNG"),
        ] {
            fs::write(at(name), text).unwrap();
        }
        fs::create_dir(at("folder.vtu")).unwrap();
        let input = [at("a.vtu")];
        let checked = |name: &str, inputs: &[PathBuf], force| check(&[&at(name)], inputs, force);
        checked("a.vtu", &[], false).unwrap();
        checked("empty.png", &input, false).unwrap();
        checked("new.vtu", &input, false).unwrap();
        assert!(matches!(checked("a.vtu", &input, false), Err(PlaceError::Input { .. })));
        for name in ["notes.vtu", "notes", "a.png"] {
            assert!(
                matches!(checked(name, &[], false), Err(PlaceError::Taken { .. })),
                "{name}"
            );
            checked(name, &input, true).unwrap();
        }
        checked("a.vtu", &input, true).unwrap();
        for name in ["folder.vtu", "notes/a.vtu"] {
            let refused = checked(name, &[], true).unwrap_err();
            assert!(
                matches!(refused, PlaceError::Kind { .. }) && !refused.is_machine(),
                "{refused}"
            );
        }
        assert!(checked("none/a.vtu", &[], true).unwrap_err().is_machine());
        let twice = check(&[&at("b.csv"), &at("./b.csv")], &[], false);
        assert!(matches!(twice, Err(PlaceError::Twice { .. })), "{twice:?}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 6);
    }
}
