//! A folder whose contents change all together, when a run is done.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use insonify::output::atomic::WriteError;
use tempfile::TempDir;

use crate::cli::failure::Failure;

/// A hidden folder within the one asked for, gone when dropped.
pub struct Staging {
    target: PathBuf,
    /// Whether the target was made for this run: it goes too if nothing comes of it.
    made: bool,
    folder: Option<TempDir>,
}

impl Staging {
    /// Makes the folder asked for, if it is not there, and one within to write to.
    pub fn beside(target: &Path) -> Result<Self, Failure> {
        if target.as_os_str().is_empty() {
            return Err(Failure::usage("-o names no folder", "name a folder"));
        }
        if target.exists() && !target.is_dir() {
            let found = format!("-o {} is there and is no folder", target.display());
            return Err(Failure::usage(found, "name a folder"));
        }
        let made = !target.exists();
        let wrong = |cause| Failure::Folder {
            path: target.to_owned(),
            cause,
        };
        fs::create_dir_all(target).map_err(wrong)?;
        let folder = tempfile::Builder::new()
            .prefix(".insonify-")
            .tempdir_in(target)
            .map_err(wrong)?;
        Ok(Self {
            target: target.to_owned(),
            made,
            folder: Some(folder),
        })
    }

    /// Where to write.
    pub fn folder(&self) -> &Path {
        self.folder.as_ref().map_or(&self.target, TempDir::path)
    }

    /// Moves all that was written to its place; what has the same names there goes.
    pub fn install(mut self) -> Result<(), Failure> {
        let from = self.folder().to_owned();
        let moved = self.move_all(&from);
        self.made = false;
        moved.map_err(|cause| WriteError::new(&self.target, cause).into())
    }

    fn move_all(&self, from: &Path) -> io::Result<()> {
        for entry in fs::read_dir(from)? {
            let entry = entry?;
            let to = self.target.join(entry.file_name());
            if to.is_dir() {
                fs::remove_dir_all(&to)?;
            }
            fs::rename(entry.path(), to)?;
        }
        Ok(())
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        drop(self.folder.take());
        if self.made {
            // Only where it is empty; anything else in it is not of this run.
            let _ = fs::remove_dir(&self.target);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_changes_until_all_is_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let target = folder.path().join("out");
        let staging = Staging::beside(&target).expect("staged");
        fs::write(staging.folder().join("a"), "new").expect("written");
        drop(staging);
        assert!(!target.exists(), "a folder that was made for nothing goes");

        fs::create_dir_all(target.join("frames")).expect("a folder");
        fs::write(target.join("frames/old"), "old").expect("written");
        fs::write(target.join("kept"), "mine").expect("written");
        let staging = Staging::beside(&target).expect("staged");
        fs::create_dir(staging.folder().join("frames")).expect("a folder");
        fs::write(staging.folder().join("frames/new"), "new").expect("written");
        assert!(target.join("frames/old").exists() && !target.join("frames/new").exists());
        staging.install().expect("installed");
        assert!(target.join("frames/new").exists() && !target.join("frames/old").exists());
        let left = fs::read_dir(&target).expect("a folder").count();
        assert_eq!(
            (left, fs::read_to_string(target.join("kept")).expect("text").as_str()),
            (2, "mine")
        );
    }

    #[test]
    fn a_file_in_its_place_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("file");
        fs::write(&file, "x").expect("written");
        assert_eq!(
            Staging::beside(&file).map(drop).map_err(|failure| failure.status()),
            Err(2)
        );
    }
}
