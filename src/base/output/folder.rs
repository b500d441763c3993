//! Output folders of runs: the files of a run are installed together when it is complete, and replace those of the
//! previous run, which are listed in a manifest in the folder; files of other origin are kept.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Write};
use std::path::{Component, Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::error::without_temporary_name;
use super::{OutputError, atomic};

use super::staged::{self, Live, StagedFolder};
use crate::text::head;

/// File name of the manifest in the folder.
pub const MANIFEST: &str = "insonify.json";

/// Contents of the manifest.
#[derive(Debug, Serialize, Deserialize)]
struct Manifest {
    program: String,
    version: String,
    command: String,
    /// Description of the run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    run: Option<Value>,
    files: BTreeSet<String>,
}

/// File name, in the folder of a run that is not complete, of its description.
const RUN: &str = "insonify-run.json";

/// Output folder of a run. Until [`Folder::install`] the files are in a hidden subfolder, which is removed if the run
/// fails.
#[derive(Debug)]
pub struct Folder {
    target: PathBuf,
    command: &'static str,
    force: bool,
    /// Files of the previous run, relative to the folder.
    before: BTreeSet<String>,
    /// Description of the previous run.
    run_before: Option<Value>,
    /// Description of this run.
    run: Option<Value>,
    /// Hidden subfolder; `None` after installation.
    staged: Option<StagedFolder>,
    /// Set if the folder was created for this run: it is removed if the run fails.
    created: Option<Live>,
}

/// Extensions of numbered files that runs write.
const WRITTEN: [&str; 3] = [".png", ".json", ".vtu"];

impl Folder {
    /// Creates the folder if it is missing, and checks that a run of `command` can write to it. `names` are files that
    /// it will write, relative to the folder; one that ends in `_` stands for numbered files with this prefix. `inputs`
    /// are files that it reads.
    ///
    /// # Errors
    /// [`OutputError`] if the folder cannot be created; without `force`, if a file of these names exists that no
    /// previous run listed, or that is an input.
    pub fn open(
        target: &Path,
        command: &'static str,
        names: &[&str],
        inputs: &[PathBuf],
        force: bool,
    ) -> Result<Self, OutputError> {
        let mut folder = Self::check_only(target, command, names, inputs, force)?;
        staged::clear_leftovers(target);
        folder.stage(StagedFolder::within)?;
        Ok(folder)
    }

    /// Makes the checks of [`Folder::open`]; files can be written after [`Folder::begin`].
    ///
    /// # Errors
    /// Those of [`Folder::open`].
    pub fn check_only(
        target: &Path,
        command: &'static str,
        names: &[&str],
        inputs: &[PathBuf],
        force: bool,
    ) -> Result<Self, OutputError> {
        let wrong = |expected| OutputError::Kind {
            path: target.to_owned(),
            expected,
        };
        if target.exists() && !target.is_dir() {
            return Err(wrong("a folder"));
        }
        // Noted before it is made, so that an interrupt at any moment removes the empty folder.
        let created = (!target.exists()).then(|| Live::new(target));
        fs::create_dir_all(target).map_err(|cause| match cause.kind() {
            io::ErrorKind::NotADirectory | io::ErrorKind::AlreadyExists => {
                wrong("a folder; the path leads through a file")
            }
            _ => OutputError::Folder {
                path: target.to_owned(),
                cause,
            },
        })?;
        let mut folder = Self {
            target: target.to_owned(),
            command,
            force,
            before: BTreeSet::new(),
            run_before: None,
            run: None,
            staged: None,
            created,
        };
        folder.before = folder.listed()?;
        if !force {
            folder.check(names, inputs)?;
        }
        Ok(folder)
    }

    fn stage(&mut self, make: impl FnOnce(&Path) -> io::Result<StagedFolder>) -> Result<(), OutputError> {
        // In the folder itself: files from another file system are copied, not renamed, and may stay
        // incomplete.
        let staged = make(&self.target).map_err(|cause| OutputError::Folder {
            path: self.target.clone(),
            cause: without_temporary_name(cause),
        })?;
        self.staged = Some(staged);
        Ok(())
    }

    /// Begins a run with a description, by which another can go on with it. With `resume` files of such a run that was
    /// cut off are in [`Folder::path`], and those of this one stay if it is cut off. Returns `false` if the folder has
    /// all files of a finished run with this description, so that there is nothing to do.
    ///
    /// # Errors
    /// [`OutputError::OtherRun`] if the run to go on with has another description.
    pub fn begin(&mut self, run: Value, resume: bool) -> Result<bool, OutputError> {
        let other = |text| OutputError::OtherRun {
            path: self.target.clone(),
            text,
        };
        let mut left = None;
        if resume {
            for folder in staged::leftovers(&self.target) {
                let text = fs::read_to_string(folder.join(RUN)).ok();
                let Some(found) = text.and_then(|text| serde_json::from_str(&text).ok()) else {
                    continue;
                };
                differences(&found, &run).map_or(Ok(()), |text| Err(other(text)))?;
                left = Some(folder);
                break;
            }
            let finished = self.run_before.as_ref().filter(|_| left.is_none());
            if let Some(found) = finished {
                differences(found, &run).map_or(Ok(()), |text| Err(other(text)))?;
                if self.before.iter().all(|name| self.target.join(name).is_file()) {
                    return Ok(false);
                }
            }
        }
        match left {
            Some(left) => self.stage(|_| StagedFolder::taken_over(&left))?,
            None if resume => self.stage(StagedFolder::lasting_within)?,
            None => self.stage(StagedFolder::within)?,
        }
        staged::clear_leftovers(&self.target);
        let path = self.path().join(RUN);
        atomic::write(&path, |file| Ok(serde_json::to_writer(file, &run)?))?;
        self.run = Some(run);
        Ok(true)
    }

    /// Folder to write to.
    pub fn path(&self) -> &Path {
        self.staged.as_ref().map_or(&self.target, StagedFolder::path)
    }

    /// Final path of a file written to [`Folder::path`].
    pub fn place(&self, file: &Path) -> PathBuf {
        match file.strip_prefix(self.path()) {
            Ok(name) => self.target.join(name),
            Err(_) => file.to_owned(),
        }
    }

    /// Files of the previous run from the manifest. Names that lead out of the folder are ignored.
    fn listed(&mut self) -> Result<BTreeSet<String>, OutputError> {
        let path = self.target.join(MANIFEST);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(BTreeSet::new()),
            Err(cause) if cause.kind() != io::ErrorKind::InvalidData => {
                return Err(OutputError::write(&path, cause));
            }
            Err(_) => String::new(),
        };
        let manifest: Manifest = match serde_json::from_str(&text) {
            Ok(manifest) => manifest,
            Err(_) if self.force => return Ok(BTreeSet::new()),
            Err(_) => return Err(OutputError::Taken { path }),
        };
        self.run_before = manifest.run;
        let root = fs::canonicalize(&self.target).map_err(|cause| OutputError::write(&self.target, cause))?;
        let within = |name: &String| {
            let plain = Path::new(name)
                .components()
                .all(|part| matches!(part, Component::Normal(_)));
            let folder = self.target.join(name);
            let folder = folder.parent().map(fs::canonicalize);
            plain && folder.is_none_or(|folder| folder.is_ok_and(|folder| folder.starts_with(&root)))
        };
        Ok(manifest.files.into_iter().filter(within).collect())
    }

    fn check(&self, names: &[&str], inputs: &[PathBuf]) -> Result<(), OutputError> {
        let wanted = |name: &str| {
            names.iter().any(|wanted| {
                if wanted.ends_with('_') {
                    name.starts_with(wanted) && WRITTEN.iter().any(|ending| name.ends_with(ending))
                } else {
                    name == *wanted
                }
            })
        };
        for folder in names.iter().map(|name| parent(name)).collect::<BTreeSet<_>>() {
            let entries = fs::read_dir(self.target.join(folder)).into_iter().flatten().flatten();
            for entry in entries {
                let name = Path::new(folder).join(entry.file_name());
                let Some(name) = name.to_str() else { continue };
                if wanted(name) && !self.before.contains(name) {
                    return Err(OutputError::Taken { path: entry.path() });
                }
            }
        }
        // An input inside the folder would be moved away or written over before it is read again.
        let Ok(root) = fs::canonicalize(&self.target) else {
            return Ok(());
        };
        let ours = |input: &&PathBuf| {
            let whole = fs::canonicalize(input).ok();
            let name = whole
                .as_deref()
                .and_then(|whole| whole.strip_prefix(&root).ok()?.to_str());
            name.is_some_and(|name| wanted(name) || self.before.contains(name))
        };
        match inputs.iter().find(ours) {
            Some(input) => Err(OutputError::Input { path: input.clone() }),
            None => Ok(()),
        }
    }

    /// Moves the files to their final places, removes those of the previous run that are not replaced, and updates the
    /// manifest. Files of other origin are never removed and, without `force`, never replaced.
    ///
    /// # Errors
    /// [`OutputError::Kept`]; the written files are then kept, and the error names their folder.
    pub fn install(mut self) -> Result<(), OutputError> {
        let Some(staged) = self.staged.take() else {
            return Ok(());
        };
        self.created = None;
        let mut moved = 0;
        let _ = fs::remove_file(staged.path().join(RUN));
        let result = files_in(staged.path())
            .map_err(|cause| OutputError::write(&self.target, cause))
            .and_then(|files| self.move_all(staged.path(), &files, &mut moved));
        match result {
            Ok(()) => {
                staged.remove();
                Ok(())
            }
            Err(cause) => Err(OutputError::Kept {
                path: staged.keep(),
                moved,
                cause: Box::new(cause),
            }),
        }
    }

    fn move_all(&self, from: &Path, files: &BTreeSet<String>, moved: &mut usize) -> Result<(), OutputError> {
        for name in files {
            let path = self.target.join(name);
            let foreign = !self.force && !self.before.contains(name) && name != MANIFEST;
            if path.is_dir() || (foreign && path.symlink_metadata().is_ok()) {
                return Err(OutputError::Taken { path });
            }
        }
        let _held = staged::hold();
        // First, so that a run that ends here leaves no file unknown to the next one.
        self.list(from, files.union(&self.before).cloned().collect())?;
        for name in files {
            let path = self.target.join(name);
            let subfolder = path.parent().map_or(Ok(()), fs::create_dir_all);
            subfolder
                .and_then(|()| fs::rename(from.join(name), &path))
                .map_err(|cause| OutputError::write(&path, cause))?;
            *moved += 1;
        }
        for name in self.before.difference(files) {
            let path = self.target.join(name);
            match fs::remove_file(&path) {
                Err(cause) if cause.kind() != io::ErrorKind::NotFound => {
                    return Err(OutputError::write(&path, cause));
                }
                _ => {}
            }
            // Folders that become empty are removed.
            let mut folder = parent(name);
            while !folder.is_empty() && fs::remove_dir(self.target.join(folder)).is_ok() {
                folder = parent(folder);
            }
        }
        self.list(from, files.clone())
    }

    fn list(&self, staged: &Path, files: BTreeSet<String>) -> Result<(), OutputError> {
        let manifest = Manifest {
            program: "insonify".to_owned(),
            version: crate::VERSION.to_owned(),
            command: self.command.to_owned(),
            run: self.run.clone(),
            files,
        };
        let [from, to] = [staged, &self.target].map(|folder| folder.join(MANIFEST));
        let written = serde_json::to_string_pretty(&manifest)
            .map_err(io::Error::from)
            .and_then(|text| {
                let mut file = fs::File::create(&from)?;
                writeln!(file, "{text}")?;
                file.sync_all()?;
                fs::rename(&from, &to)
            });
        written.map_err(|cause| OutputError::write(&to, cause))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Without a frame there is nothing to go on with.
        let is_empty = |staged: &StagedFolder| files_in(staged.path()).is_ok_and(|files| files.len() <= 1);
        if let Some(staged) = self.staged.take_if(|staged| is_empty(staged)) {
            staged.remove();
        }
        drop(self.staged.take());
        if self.created.is_some() {
            // Only if empty: anything else in it does not belong to this run.
            let _ = fs::remove_dir(&self.target);
        }
    }
}

/// Longest text of differences.
const MOST_SHOWN: usize = 3;

/// Difference between the descriptions of two runs, as "KEY A, not B"; `None` if nothing does.
fn differences(found: &Value, wanted: &Value) -> Option<String> {
    let mut all = Vec::new();
    let mut open = vec![(String::new(), found, wanted)];
    while let Some((path, found, wanted)) = open.pop() {
        let inner = |key: &str| {
            if path.is_empty() {
                key.to_owned()
            } else {
                format!("{path}.{key}")
            }
        };
        match (found, wanted) {
            (Value::Object(a), Value::Object(b)) => {
                let keys: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
                let pair = |key: &&String| (inner(key), &found[key.as_str()], &wanted[key.as_str()]);
                open.extend(keys.iter().rev().map(pair));
            }
            (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
                let pairs = a.iter().zip(b).enumerate().rev();
                open.extend(pairs.map(|(index, (a, b))| {
                    // A file is named by its path.
                    let name = a.get("path").map_or_else(|| index.to_string(), |path| path.to_string());
                    (format!("{path}[{name}]"), a, b)
                }));
            }
            _ if found == wanted => {}
            _ => {
                let [found, wanted] = [found, wanted].map(|value| head(&value.to_string(), 60));
                all.push(format!("{path} {found}, not {wanted}"));
            }
        }
    }
    let more = all.len().saturating_sub(MOST_SHOWN);
    all.truncate(MOST_SHOWN);
    let text = all.join("; ");
    match (more, text.is_empty()) {
        (_, true) => None,
        (0, _) => Some(text),
        _ => Some(format!("{text}; and {more} more")),
    }
}

/// Folder of a relative name, empty for the folder itself.
fn parent(name: &str) -> &str {
    name.rsplit_once('/').map_or("", |(folder, _)| folder)
}

/// Files below a folder, relative to it.
fn files_in(folder: &Path) -> io::Result<BTreeSet<String>> {
    let mut files = BTreeSet::new();
    let mut folders = vec![String::new()];
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(folder.join(&inner))? {
            let entry = entry?;
            let name = entry.file_name();
            let name = name.to_str().ok_or(io::ErrorKind::InvalidFilename)?;
            let name = match inner.as_str() {
                "" => name.to_owned(),
                inner => format!("{inner}/{name}"),
            };
            if entry.file_type()?.is_dir() {
                folders.push(name);
            } else {
                files.insert(name);
            }
        }
    }
    Ok(files)
}

#[cfg(test)]
mod tests;
