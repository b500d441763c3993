//! Costs that were measured, kept in the user's cache folder: a file for each machine, version of the program and thing measured.

use std::env;
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::output::atomic::{self, WriteError};

/// Environment variable that names the folder in place of the user's own.
pub const FOLDER_VARIABLE: &str = "INSONIFY_CACHE";

/// A folder of costs.
#[derive(Clone, Debug)]
pub struct Cache {
    /// None where there is no place for it.
    folder: Option<PathBuf>,
    machine: String,
}

impl Cache {
    /// The user's: `$INSONIFY_CACHE`, or `insonify` in the folder that the system has for such things. `machine` tells one machine that
    /// shares it from another.
    pub fn of_user(machine: &str) -> Self {
        let of = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let usual = || {
            let folder = match env::consts::OS {
                "windows" => of("LOCALAPPDATA"),
                "macos" => of("HOME").map(|home| home.join("Library/Caches")),
                _ => of("XDG_CACHE_HOME")
                    .filter(|folder| folder.is_absolute())
                    .or_else(|| of("HOME").map(|home| home.join(".cache"))),
            };
            folder.map(|folder| folder.join("insonify"))
        };
        Cache {
            folder: of(FOLDER_VARIABLE).or_else(usual),
            machine: machine.to_owned(),
        }
    }

    /// Some folder.
    pub fn at(folder: &Path, machine: &str) -> Self {
        Cache {
            folder: Some(folder.to_owned()),
            machine: machine.to_owned(),
        }
    }

    /// What was kept of a thing on this machine by this version. What cannot be read counts as not there.
    pub fn get<T: DeserializeOwned>(&self, thing: &[&str]) -> Option<T> {
        let text = std::fs::read_to_string(self.path(thing)?).ok()?;
        serde_json::from_str(&text).ok()
    }

    /// Keeps what was measured.
    ///
    /// # Errors
    /// [`WriteError`]; a folder that cannot be made shows when the file is written.
    pub fn put<T: Serialize>(&self, thing: &[&str], costs: &T) -> Result<(), WriteError> {
        let Some(path) = self.path(thing) else { return Ok(()) };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|cause| WriteError::new(folder, cause))?;
        }
        atomic::write(&path, |file| {
            let text = serde_json::to_string_pretty(costs)?;
            writeln!(file, "{text}")
        })
    }

    /// Where a thing is kept.
    fn path(&self, thing: &[&str]) -> Option<PathBuf> {
        let mut hasher = blake3::Hasher::new();
        for part in [env!("CARGO_PKG_VERSION"), &self.machine].iter().chain(thing) {
            hasher.update(&(part.len() as u64).to_le_bytes());
            hasher.update(part.as_bytes());
        }
        let name = hasher.finalize().to_hex();
        Some(self.folder.as_ref()?.join(format!("costs-{}.json", &name[..32])))
    }
}
