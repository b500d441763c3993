//! Temporary files and folders: hidden names beside their targets, removed when dropped, when the program is asked to
//! end ([`abandon`]), and, if it was killed, by the next run.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use tempfile::{NamedTempFile, TempDir};

/// Prefix of temporary names; the process number and six random letters follow.
const PREFIX: &str = ".insonify-";

/// Temporary files and folders, and folders created for them. Creating, renaming and removing them requires the lock.
static LIVE: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// Acquires the lock that is required to create, rename and remove temporary files.
pub(super) fn hold() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    LIVE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An entry of [`LIVE`].
#[derive(Debug)]
pub(super) struct Live(PathBuf);

impl Live {
    /// Registers a path for removal by [`abandon`]: a folder created for a run only if it is empty.
    pub(super) fn new(path: &Path) -> Self {
        Self::enter(&mut hold(), path)
    }

    fn enter(live: &mut BTreeSet<PathBuf>, path: &Path) -> Self {
        live.insert(path.to_owned());
        Self(path.to_owned())
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        hold().remove(&self.0);
    }
}

/// A temporary file.
pub struct StagedFile {
    /// The open file, under its temporary name.
    pub file: NamedTempFile,
    _live: Live,
}

impl StagedFile {
    /// Creates a temporary file within a folder.
    pub fn within(folder: &Path) -> io::Result<Self> {
        let name = prefix();
        let mut builder = tempfile::Builder::new();
        builder.prefix(&name);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // Narrowed by the process's umask, as for any file that a program creates.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let mut live = hold();
        let file = builder.tempfile_in(folder)?;
        // Shows other runs that it is in use; without the lock they check for the process.
        let _ = file.as_file().try_lock();
        let live = Live::enter(&mut live, file.path());
        Ok(Self { file, _live: live })
    }

    /// Renames the file to its final path.
    pub fn persist(self, path: &Path) -> io::Result<()> {
        let _held = hold();
        let Self { file, _live } = self;
        let result = file.persist(path).map(drop).map_err(|failure| failure.error);
        drop(_held);
        result
    }
}

/// A temporary folder.
#[derive(Debug)]
pub(super) struct StagedFolder {
    path: PathBuf,
    /// Removes the folder when dropped; `None` for one that stays for a run that goes on with it.
    temporary: Option<(TempDir, Live)>,
    _lock: Option<File>,
}

impl StagedFolder {
    /// Creates a temporary folder within another.
    pub(super) fn within(folder: &Path) -> io::Result<Self> {
        let mut live = hold();
        let folder = tempfile::Builder::new().prefix(&prefix()).tempdir_in(folder)?;
        Ok(Self {
            path: folder.path().to_owned(),
            _lock: locked(folder.path()),
            temporary: Some({
                let live = Live::enter(&mut live, folder.path());
                (folder, live)
            }),
        })
    }

    /// Creates a folder within another that stays where the run does not end: files in it are whole.
    pub(super) fn lasting_within(folder: &Path) -> io::Result<Self> {
        let _held = hold();
        let path = tempfile::Builder::new().prefix(&prefix()).tempdir_in(folder)?.keep();
        let lock = locked(&path);
        Ok(Self {
            path,
            temporary: None,
            _lock: lock,
        })
    }

    /// Takes over the folder of a run that was cut off, which then stays as [`StagedFolder::lasting_within`] does.
    pub(super) fn taken_over(left: &Path) -> io::Result<Self> {
        let parent = left.parent().unwrap_or(Path::new("."));
        let folder = Self::lasting_within(parent)?;
        let _held = hold();
        fs::remove_dir(&folder.path)?;
        fs::rename(left, &folder.path)?;
        for entry in fs::read_dir(&folder.path)?.flatten() {
            // Half-written files of the run.
            if is_named(Path::new(&entry.file_name())) {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(Self {
            _lock: locked(&folder.path),
            ..folder
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Removes the folder, which is empty.
    pub(super) fn remove(self) {
        if self.temporary.is_none() {
            let _held = hold();
            let _ = fs::remove_dir_all(&self.path);
        }
    }

    /// Keeps the folder under a name that no later run removes.
    pub(super) fn keep(self) -> PathBuf {
        let hidden = self.temporary.map_or(self.path, |(folder, _live)| folder.keep());
        let shown = hidden.with_file_name(format!("insonify-not-installed-{}", process::id()));
        match fs::rename(&hidden, &shown) {
            Ok(()) => shown,
            Err(_) => hidden,
        }
    }
}

fn locked(folder: &Path) -> Option<File> {
    File::open(folder).ok().filter(|file| file.try_lock().is_ok())
}

fn prefix() -> String {
    format!("{PREFIX}{}-", process::id())
}

/// Whether a path leads through a temporary file or folder.
pub(super) fn is_staged(path: &Path) -> bool {
    path.components().any(|part| is_named(Path::new(&part)))
}

/// Path without its temporary components, for messages.
pub(super) fn shown(path: &Path) -> PathBuf {
    path.components().filter(|part| !is_named(Path::new(part))).collect()
}

fn is_named(name: &Path) -> bool {
    name.as_os_str().as_encoded_bytes().starts_with(PREFIX.as_bytes())
}

/// Removes all temporary files and folders of a process that is about to end: none is created, renamed or removed
/// afterwards.
pub fn abandon() {
    const TRIES: usize = 50;
    let live = hold();
    let is_staged = |path: &&PathBuf| path.file_name().is_some_and(|name| is_named(Path::new(name)));
    let (staged, created): (Vec<_>, Vec<_>) = live.iter().partition(is_staged);
    // Created folders are empty only then.
    for path in staged.into_iter().chain(created) {
        let staged = is_staged(&path);
        // Other threads may still create folders in it.
        for _ in 0..TRIES {
            let removed = match (path.is_dir(), staged) {
                (true, true) => fs::remove_dir_all(path),
                (true, false) => fs::remove_dir(path),
                (false, _) => fs::remove_file(path),
            };
            if removed.is_ok() || !staged || !path.exists() {
                break;
            }
            thread::sleep(Duration::from_millis(10));
        }
    }
    std::mem::forget(live);
}

/// Removes temporary files of killed runs from a folder: those with this prefix and no lock, whose process no longer
/// exists.
pub(super) fn clear_leftovers(folder: &Path) {
    for path in leftovers(folder) {
        // Failure to remove them is harmless.
        let _ = if path.is_dir() {
            fs::remove_dir_all(&path)
        } else {
            fs::remove_file(&path)
        };
    }
}

/// Temporary files and folders of killed runs in a folder, in the order of their names.
pub(super) fn leftovers(folder: &Path) -> Vec<PathBuf> {
    let mut left = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some(owner) = name.to_str().and_then(|name| name.strip_prefix(PREFIX)) else {
            continue;
        };
        let Some(owner) = owner.split_once('-').and_then(|(pid, _)| pid.parse::<u32>().ok()) else {
            continue;
        };
        let (path, Ok(kind)) = (entry.path(), entry.file_type()) else {
            continue;
        };
        let alive = owner == process::id() || Path::new("/proc").join(owner.to_string()).exists();
        if alive || kind.is_symlink() || !File::open(&path).is_ok_and(|file| file.try_lock().is_ok()) {
            continue;
        }
        left.push(path);
    }
    left.sort();
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A process number that no process has: above the largest on Linux.
    const DEAD: u32 = 4_194_305;

    #[test]
    fn leftovers_of_dead_processes_go_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let dead = format!("{PREFIX}{DEAD}-AbCdEf");
        fs::create_dir_all(at(&dead).join("frames")).unwrap();
        fs::write(at(&dead).join("frames/a"), "x").unwrap();
        let dead_file = format!("{PREFIX}{DEAD}-GhIjKl");
        let locked = format!("{PREFIX}{DEAD}-locked");
        let others = [
            locked.clone(),
            format!("{PREFIX}AbCdEf"),
            format!("{PREFIX}{}-own", process::id()),
            format!("insonify-{DEAD}-AbCdEf"),
            "mine".to_owned(),
        ];
        for name in others.iter().chain([&dead_file]) {
            fs::write(at(name), "x").unwrap();
        }
        let in_use = File::open(at(&locked)).unwrap();
        in_use.lock().unwrap();
        clear_leftovers(folder.path());
        assert!(!at(&dead).exists() && !at(&dead_file).exists());
        for name in &others {
            assert!(at(name).exists(), "{name}");
        }
    }

    #[test]
    fn a_folder_that_is_kept_has_a_name_that_no_run_clears() {
        let folder = tempfile::tempdir().unwrap();
        let staged = StagedFolder::within(folder.path()).unwrap();
        assert!(is_staged(&staged.path().join("a")));
        assert_eq!(shown(&staged.path().join("a")), folder.path().join("a"));
        let kept = staged.keep();
        assert!(kept.is_dir() && !is_staged(&kept), "{}", kept.display());
    }
}
