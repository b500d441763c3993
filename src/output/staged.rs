//! Files and folders in the making: hidden names beside their targets, removed when they are dropped, when the program is asked to
//! end ([`abandon`]), and, where it was killed, by the next run.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use tempfile::{NamedTempFile, TempDir};

/// Start of the names; the number of the process follows, and six random letters.
const PREFIX: &str = ".insonify-";

/// Everything in the making, and folders that were made for it. Whoever begins, renames or removes any of it has the lock.
static LIVE: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// The right to begin, rename and remove.
pub(super) fn hold() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    LIVE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// An entry of [`LIVE`].
#[derive(Debug)]
pub(super) struct Live(PathBuf);

impl Live {
    /// A path that [`abandon`] removes: a folder that was made for a run only if it is empty.
    pub fn new(path: &Path) -> Self {
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

/// A file in the making.
pub(super) struct StagedFile {
    pub file: NamedTempFile,
    _live: Live,
}

impl StagedFile {
    /// A file within a folder.
    pub fn within(folder: &Path) -> io::Result<Self> {
        let name = prefix();
        let mut builder = tempfile::Builder::new();
        builder.prefix(&name);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The process's umask narrows these, as for any file that a program creates.
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let mut live = hold();
        let file = builder.tempfile_in(folder)?;
        // Shows other runs that it is in use; without it they look for the process.
        let _ = file.as_file().try_lock();
        let live = Live::enter(&mut live, file.path());
        Ok(Self { file, _live: live })
    }

    /// Gives the file its name.
    pub fn persist(self, path: &Path) -> io::Result<()> {
        let _held = hold();
        let Self { file, _live } = self;
        let result = file.persist(path).map(drop).map_err(|failure| failure.error);
        drop(_held);
        result
    }
}

/// A folder in the making.
#[derive(Debug)]
pub(super) struct StagedFolder {
    folder: TempDir,
    _lock: Option<File>,
    _live: Live,
}

impl StagedFolder {
    /// A folder within another.
    pub fn within(folder: &Path) -> io::Result<Self> {
        let mut live = hold();
        let folder = tempfile::Builder::new().prefix(&prefix()).tempdir_in(folder)?;
        let lock = File::open(folder.path()).ok().filter(|file| file.try_lock().is_ok());
        Ok(Self {
            _live: Live::enter(&mut live, folder.path()),
            folder,
            _lock: lock,
        })
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Leaves it where it is, under a name that no later run clears.
    pub fn keep(self) -> PathBuf {
        let hidden = self.folder.keep();
        let shown = hidden.with_file_name(format!("insonify-not-installed-{}", process::id()));
        match fs::rename(&hidden, &shown) {
            Ok(()) => shown,
            Err(_) => hidden,
        }
    }
}

fn prefix() -> String {
    format!("{PREFIX}{}-", process::id())
}

/// Whether a path leads through something in the making.
pub(super) fn is_staged(path: &Path) -> bool {
    path.components().any(|part| is_named(Path::new(&part)))
}

/// The path without what is in the making, for messages.
pub(super) fn shown(path: &Path) -> PathBuf {
    path.components().filter(|part| !is_named(Path::new(part))).collect()
}

fn is_named(name: &Path) -> bool {
    name.as_os_str().as_encoded_bytes().starts_with(PREFIX.as_bytes())
}

/// Removes all that is in the making, for a process that is about to end: nothing is begun, renamed or removed afterwards.
pub fn abandon() {
    const TRIES: usize = 50;
    let live = hold();
    let is_staged = |path: &&PathBuf| path.file_name().is_some_and(|name| is_named(Path::new(name)));
    let (staged, made): (Vec<_>, Vec<_>) = live.iter().partition(is_staged);
    // Folders that were made are empty only then.
    for path in staged.into_iter().chain(made) {
        let staged = is_staged(&path);
        // Other threads may still make folders in it.
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

/// Removes what runs that were killed left in a folder: what bears our name, the number of a process that is no more, and no lock.
pub(super) fn clear_leftovers(folder: &Path) {
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
        // What cannot be removed is in nobody's way.
        let _ = match kind.is_dir() {
            true => fs::remove_dir_all(&path),
            false => fs::remove_file(&path),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A process number that no process has: above the largest that Linux gives.
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
