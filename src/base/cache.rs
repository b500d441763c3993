//! Cache of generated data: in memory across synthesizers and, for the command, in the user's cache folder across runs.

use std::cell::Cell;
use std::collections::VecDeque;
use std::env;
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use super::output::atomic;

/// Environment variable that overrides the cache folder.
const FOLDER_VARIABLE: &str = "INSONIFY_CACHE";

/// Size that the files of [`cached`] have together at most, bytes; the ones unused for longest go first.
const MAX_BYTES: u64 = 512 << 20;

/// Limit on the total size of the results in memory, bytes; the least recently used are dropped.
const MAX_BYTES_IN_MEMORY: usize = 64 << 20;

/// Length of the checksum in front of each file's bytes.
const SUM: usize = blake3::OUT_LEN;

static IS_ON: AtomicBool = AtomicBool::new(false);

static IN_MEMORY: Mutex<Recent> = Mutex::new(Recent(VecDeque::new()));

/// Results by key, the least recently used first.
struct Recent(VecDeque<(String, Vec<u8>)>);

impl Recent {
    fn get(&mut self, key: &str) -> Option<Vec<u8>> {
        let index = self.0.iter().position(|(other, _)| other == key)?;
        let entry = self.0.remove(index)?;
        let bytes = entry.1.clone();
        self.0.push_back(entry);
        Some(bytes)
    }

    fn put(&mut self, key: &str, bytes: &[u8]) {
        if bytes.len() > MAX_BYTES_IN_MEMORY / 2 || self.0.iter().any(|(other, _)| other == key) {
            return;
        }
        self.0.push_back((key.to_owned(), bytes.to_vec()));
        let mut bytes_held: usize = self.0.iter().map(|(_, bytes)| bytes.len()).sum();
        while bytes_held > MAX_BYTES_IN_MEMORY {
            bytes_held -= self.0.pop_front().map_or(bytes_held, |(_, bytes)| bytes.len());
        }
    }
}

/// The user's cache folder: `$INSONIFY_CACHE`, or `insonify` in the cache folder of the system; `None` where the system
/// has no place for it.
pub fn folder() -> Option<PathBuf> {
    let variable = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let usual = || {
        let folder = match env::consts::OS {
            "windows" => variable("LOCALAPPDATA"),
            "macos" => variable("HOME").map(|home| home.join("Library/Caches")),
            _ => variable("XDG_CACHE_HOME")
                .filter(|folder| folder.is_absolute())
                .or_else(|| variable("HOME").map(|home| home.join(".cache"))),
        };
        folder.map(|folder| folder.join("insonify"))
    };
    variable(FOLDER_VARIABLE).or_else(usual)
}

/// Lets [`cached`] write files. Only the command calls this: programs that embed the library write nothing to their
/// users' folders.
pub fn switch_on() {
    IS_ON.store(true, Ordering::Relaxed);
}

thread_local! {
    static IS_BYPASSED: Cell<bool> = const { Cell::new(false) };
}

/// Lets [`cached`] on this thread make every result anew, as a check that results do not depend on where they were
/// made.
pub fn bypass() {
    IS_BYPASSED.set(true);
}

/// The result of `make` (`length` bytes), which the key determines: from memory, else from a file that this very
/// program wrote, else newly made. Without a readable and writable cache folder only memory is used.
pub fn cached(key: &str, length: usize, make: impl FnOnce() -> Vec<u8>) -> Vec<u8> {
    if IS_BYPASSED.get() {
        return make();
    }
    let recent = || IN_MEMORY.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(bytes) = recent().get(key) {
        return bytes;
    }
    let bytes = from_file(key, length, make);
    recent().put(key, &bytes);
    bytes
}

/// [`cached`] without the memory.
fn from_file(key: &str, length: usize, make: impl FnOnce() -> Vec<u8>) -> Vec<u8> {
    let folder = folder().filter(|_| IS_ON.load(Ordering::Relaxed));
    let Some(path) = folder.and_then(|folder| path(&folder.join("made"), key)) else {
        return make();
    };
    if let Some(bytes) = get(&path, length) {
        return bytes;
    }
    let bytes = make();
    let _ = put(&path, &bytes);
    bytes
}

/// Size and time of making of this program: another build may round otherwise, or be slower.
pub fn program() -> Option<String> {
    let program = fs::metadata(env::current_exe().ok()?).ok()?;
    let built = program.modified().ok()?.duration_since(UNIX_EPOCH).ok()?;
    Some(format!("{} {}", program.len(), built.as_nanos()))
}

/// File of a key, for this program.
fn path(folder: &Path, key: &str) -> Option<PathBuf> {
    let name = blake3::hash(format!("{} {key}", program()?).as_bytes()).to_hex();
    Some(folder.join(format!("{}.bin", &name[..32])))
}

/// Contents of a file whose length and checksum are right.
fn get(path: &Path, length: usize) -> Option<Vec<u8>> {
    let mut file = path.is_file().then(|| fs::File::open(path).ok()).flatten()?;
    if file.metadata().ok()?.len() != (SUM + length) as u64 {
        return None;
    }
    let (mut sum, mut bytes) = ([0; SUM], vec![0; length]);
    file.read_exact(&mut sum).ok()?;
    file.read_exact(&mut bytes).ok()?;
    // The time of its last use.
    let _ = file.set_modified(SystemTime::now());
    (blake3::hash(&bytes) == sum).then_some(bytes)
}

fn put(path: &Path, bytes: &[u8]) -> Option<()> {
    let folder = path.parent()?;
    fs::create_dir_all(folder).ok()?;
    atomic::write(path, |file| {
        file.write_all(blake3::hash(bytes).as_bytes())?;
        file.write_all(bytes)
    })
    .ok()?;
    let mut files: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
    for entry in fs::read_dir(folder).ok()?.flatten() {
        let about = entry.metadata().ok()?;
        files.push((about.modified().ok()?, about.len(), entry.path()));
    }
    files.sort();
    let mut bytes_on_disk: u64 = files.iter().map(|(_, length, _)| length).sum();
    for (_, length, path) in files {
        if bytes_on_disk <= MAX_BYTES {
            break;
        }
        bytes_on_disk -= length;
        fs::remove_file(path).ok()?;
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_made_once_and_large_or_old_ones_make_room() {
        let mut calls = 0;
        for _ in 0..2 {
            let bytes = cached("made once", 3, || {
                calls += 1;
                vec![7; 3]
            });
            assert_eq!(bytes, [7; 3]);
        }
        assert_eq!(calls, 1);
        let mut recent = Recent(VecDeque::new());
        recent.put("huge", &vec![0; MAX_BYTES_IN_MEMORY / 2 + 1]);
        assert_eq!(recent.get("huge"), None);
        let third = vec![0; MAX_BYTES_IN_MEMORY / 3];
        ["a", "b", "c"].into_iter().for_each(|key| recent.put(key, &third));
        assert!(recent.get("a").is_some());
        recent.put("d", &third);
        let kept = ["a", "b", "c", "d"].map(|key| recent.get(key).is_some());
        assert_eq!(kept, [true, false, true, true]);
    }

    #[test]
    fn only_sound_files_of_this_program_are_used() {
        let folder = tempfile::tempdir().unwrap();
        let file = path(folder.path(), "a").unwrap();
        assert_ne!(file, path(folder.path(), "b").unwrap());
        assert_eq!(get(&file, 4), None);
        put(&file, b"abcd").unwrap();
        assert_eq!(get(&file, 4), Some(b"abcd".to_vec()));
        assert_eq!(get(&file, 5), None);
        let mut bytes = fs::read(&file).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        fs::write(&file, bytes).unwrap();
        assert_eq!(get(&file, 4), None);
    }

    #[test]
    fn files_unused_for_longest_make_room() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["old", "new", "last"].map(|key| path(folder.path(), key).unwrap());
        for (age, name) in [(2, &names[0]), (1, &names[1])] {
            put(name, b"x").unwrap();
            let file = fs::File::options().write(true).open(name).unwrap();
            // Sparse: takes no room on the disk.
            file.set_len(MAX_BYTES / 2).unwrap();
            let then = SystemTime::now() - std::time::Duration::from_secs(3600 * age);
            file.set_modified(then).unwrap();
        }
        put(&names[2], b"x").unwrap();
        assert_eq!(names.map(|name| name.exists()), [false, true, true]);
    }
}
