//! Atomic writing of files.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;

use super::OutputError;
use super::staged::{self, StagedFile};

/// Writes `path` through `fill`. The bytes go to a temporary file in the same folder, which is renamed only when all of
/// them are written and, except for files of a [`super::folder::Folder`], synchronised to disk; on failure the
/// temporary file is removed and an existing file of that name is left unchanged. Symbolic links are followed.
///
/// # Errors
/// [`OutputError`] when the folder, the file or the disk refuses, when `fill` fails, or when `path` names something
/// that is not a regular file.
pub fn write(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>) -> Result<(), OutputError> {
    write_whole(path, fill).map_err(|cause| OutputError::write(path, cause))
}

fn write_whole(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>) -> io::Result<()> {
    if path.exists() && !path.is_file() {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "it exists and is not a regular file",
        ));
    }
    let path = if path.is_symlink() {
        &fs::canonicalize(path)?
    } else {
        path
    };
    let mut staged = StagedFile::within(folder_of(path))?;
    let mut buffer = BufWriter::new(staged.file.as_file_mut());
    fill(&mut buffer)?;
    buffer.flush()?;
    drop(buffer);
    if !staged::is_staged(path) {
        staged.file.as_file().sync_all()?;
    }
    staged.persist(path)
}

/// Parent folder of a file.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
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
        assert!(matches!(&failure, OutputError::Write { cause, .. } if cause.kind() == io::ErrorKind::StorageFull));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn folders_and_missing_folders_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let onto_folder = write(folder.path(), |w| w.write_all(b"x")).unwrap_err();
        assert!(onto_folder.to_string().contains("not a regular file"), "{onto_folder}");
        let nowhere = write(&folder.path().join("no/such/file"), |w| w.write_all(b"x")).unwrap_err();
        assert!(!nowhere.to_string().contains(".insonify"), "{nowhere}");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| folder.path().join(name));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        write(&link, |w| w.write_all(b"new")).unwrap();
        assert!(link.is_symlink());
        assert_eq!(fs::read(&file).unwrap(), b"new");
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
