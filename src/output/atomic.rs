//! Files that appear whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// A file that could not be written: always the machine's failure, never that of the input.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot be written: {cause}", path.display())]
pub struct WriteError {
    /// The file that was asked for.
    pub path: PathBuf,
    /// What the system said.
    pub cause: io::Error,
}

impl WriteError {
    /// Ties a system error to the file that was asked for.
    pub fn new(path: &Path, cause: io::Error) -> Self {
        Self {
            path: path.to_owned(),
            cause,
        }
    }
}

/// Writes `path` through `fill`. The bytes go to a temporary file in the same folder, which takes the name only when all
/// of them are written; on failure nothing is left and an older file of that name stays as it was.
///
/// # Errors
/// [`WriteError`] when the folder, the file or the disk refuses, when `fill` fails, or when `path` names something that
/// is not a regular file.
pub fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>) -> Result<(), WriteError> {
    let mut file = create_beside(path)?;
    let mut buffer = BufWriter::new(file.as_file_mut());
    fill(&mut buffer)
        .and_then(|()| buffer.flush())
        .map_err(|cause| WriteError::new(path, cause))?;
    drop(buffer);
    persist(file, path)
}

/// A temporary file in the folder of `path`, removed when dropped unless [`persist`]ed.
pub(crate) fn create_beside(path: &Path) -> Result<NamedTempFile, WriteError> {
    if path.exists() && !path.is_file() {
        let cause = io::Error::new(io::ErrorKind::InvalidInput, "it exists and is not a regular file");
        return Err(WriteError::new(path, cause));
    }
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".insonify-");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The process's umask narrows these, as for any file a program creates.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder).map_err(|cause| {
        // The name of the temporary file is nobody's concern.
        let said = cause.to_string();
        let said = said.split(" at path ").next().unwrap_or_default();
        WriteError::new(path, io::Error::new(cause.kind(), said))
    })
}

/// Gives a finished temporary file its name.
pub(crate) fn persist(file: NamedTempFile, path: &Path) -> Result<(), WriteError> {
    file.persist(path)
        .map(drop)
        .map_err(|failure| WriteError::new(path, failure.error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_write_keeps_the_old_file_and_leaves_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.bin");
        write(&path, |w| w.write_all(b"old")).unwrap();
        let failure = write(&path, |w| {
            w.write_all(&[0; 100_000])?;
            Err(io::Error::from(io::ErrorKind::StorageFull))
        })
        .unwrap_err();
        assert_eq!(failure.cause.kind(), io::ErrorKind::StorageFull);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn folders_and_missing_folders_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let onto_folder = write(folder.path(), |w| w.write_all(b"x")).unwrap_err();
        assert!(onto_folder.to_string().contains("not a regular file"), "{onto_folder}");
        let missing = write(&folder.path().join("no/such/file"), |w| w.write_all(b"x")).unwrap_err();
        assert!(!missing.to_string().contains(".insonify-"), "{missing}");
    }

    #[cfg(unix)]
    #[test]
    fn written_files_are_as_readable_as_any_other() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (ours, plain) = (folder.path().join("ours"), folder.path().join("plain"));
        write(&ours, |w| w.write_all(b"x")).unwrap();
        std::fs::write(&plain, b"x").unwrap();
        let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&plain));
    }
}
