//! Cache of measured costs in the user's cache folder: one file for each machine, program version and measured item.

use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use insonify_base::cache::folder;
use insonify_base::document::InvalidFile;
use insonify_base::output::{OutputError, atomic, place};

/// Maximum size of a file, bytes; a file of costs has a few thousand.
const MAX_BYTES: u64 = 1 << 20;

/// Version of the files; those of others are not read.
const FORMAT: &str = "2";

/// A cache folder of measured costs.
#[derive(Clone, Debug)]
pub struct Cache {
    /// Folder; `None` where the system has no place for it.
    folder: Option<PathBuf>,
    machine: String,
}

impl Cache {
    /// The user's cache. `machine` distinguishes machines that share it.
    pub fn of_user(machine: &str) -> Self {
        Cache {
            folder: folder(),
            machine: machine.to_owned(),
        }
    }

    /// Cache in the given folder.
    pub fn at(folder: &Path, machine: &str) -> Self {
        Cache {
            folder: Some(folder.to_owned()),
            machine: machine.to_owned(),
        }
    }

    /// Returns the value stored for `thing` on this machine by this version, if any.
    ///
    /// # Errors
    /// [`InvalidFile`] if a file cannot be read, or its contents are not `sound`.
    pub fn get<T: DeserializeOwned>(
        &self,
        thing: &[&str],
        sound: impl Fn(&T) -> bool,
    ) -> Result<Option<T>, InvalidFile> {
        let Some(path) = self.path(thing) else { return Ok(None) };
        let mut text = String::new();
        let read = File::open(&path).and_then(|file| file.take(MAX_BYTES).read_to_string(&mut text));
        let reason = match read.map(|_| serde_json::from_str(&text)) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
            Ok(Ok(costs)) if sound(&costs) => return Ok(Some(costs)),
            Ok(Ok(_)) => "it holds values that no measurement gives".to_owned(),
            Ok(Err(cause)) => cause.to_string(),
            Err(cause) => cause.to_string(),
        };
        Err(InvalidFile::Syntax(format!("{}: {reason}", path.display())))
    }

    /// Creates the folder and checks that costs can be stored in it.
    ///
    /// # Errors
    /// [`OutputError`] if they cannot be stored.
    pub fn check(&self, thing: &[&str]) -> Result<(), OutputError> {
        match self.with_folder(thing)? {
            Some(path) => place::check(&[&path], &[], true, &[]),
            None => Ok(()),
        }
    }

    /// Stores a measurement.
    ///
    /// # Errors
    /// [`OutputError`] if the file cannot be written.
    pub fn put<T: Serialize>(&self, thing: &[&str], costs: &T) -> Result<(), OutputError> {
        let Some(path) = self.with_folder(thing)? else {
            return Ok(());
        };
        atomic::write(&path, |file| {
            let text = serde_json::to_string_pretty(costs)?;
            writeln!(file, "{text}")
        })
    }

    /// Path of an item, in a folder that is created.
    fn with_folder(&self, thing: &[&str]) -> Result<Option<PathBuf>, OutputError> {
        let path = self.path(thing);
        if let Some(folder) = path.as_deref().and_then(Path::parent) {
            std::fs::create_dir_all(folder).map_err(|cause| OutputError::write(folder, cause))?;
        }
        Ok(path)
    }

    /// Path of an item.
    fn path(&self, thing: &[&str]) -> Option<PathBuf> {
        let mut hasher = blake3::Hasher::new();
        for part in [insonify_base::VERSION, FORMAT, &self.machine].iter().chain(thing) {
            hasher.update(&(part.len() as u64).to_le_bytes());
            hasher.update(part.as_bytes());
        }
        let name = hasher.finalize().to_hex();
        Some(self.folder.as_ref()?.join(format!("costs-{}.json", &name[..32])))
    }
}
