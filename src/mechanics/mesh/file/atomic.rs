//! Files that appear whole or not at all.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::MeshFileError;

/// Writes `path` through `fill`. The bytes go to a temporary file in the same folder, which takes the name only when all
/// of them are written; on failure nothing is left, and an older file of that name stays as it was.
///
/// # Errors
/// [`MeshFileError::Write`] when the folder, the file or the disk refuses, or when `path` names something that is not a
/// regular file.
pub(super) fn write(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> Result<(), MeshFileError> {
    write_beside(path, fill).map_err(|source| MeshFileError::Write {
        path: path.to_owned(),
        source,
    })
}

fn write_beside(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>) -> io::Result<()> {
    if path.exists() && !path.is_file() {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "it exists and is not a regular file",
        ));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // The process's umask narrows these, as for any file a program creates.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder
        .prefix(".insonify-")
        .tempfile_in(folder.unwrap_or(Path::new(".")))?;
    let mut buffer = BufWriter::new(file.as_file_mut());
    fill(&mut buffer)?;
    buffer.flush()?;
    drop(buffer);
    file.persist(path)?;
    Ok(())
}
