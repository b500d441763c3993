//! Destinations of a command's output, checked before the computation.

use std::ffi::OsStr;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use insonify_anatomy::volume;
use insonify_base::output::folder::Folder;
use insonify_base::output::{atomic, place};
use insonify_report::plot::Plot;

use super::failure::{Error, usage};

/// Maximum nesting of named documents: a scenario names a scene, which names no further ones.
const DEEPEST: usize = 2;
/// Largest document searched for names of files, bytes.
const LARGEST: u64 = 1 << 26;

/// Policy for existing files at the destination.
#[derive(Args, Clone, Copy, Default)]
pub(crate) struct Force {
    /// Replace existing files of another kind, files that no earlier run listed, and files that the run reads
    #[arg(long)]
    force: bool,
}

impl Force {
    pub(crate) fn is_given(self) -> bool {
        self.force
    }

    /// Refuses output files that cannot be written, before the computation; `inputs` are files that the run reads.
    pub(crate) fn check(self, files: &[&Path], inputs: &[PathBuf]) -> Result<(), Error> {
        let formats: Vec<_> = volume::written().chain(insonify_mesh::file::written()).collect();
        Ok(place::check(files, inputs, self.force, &formats)?)
    }

    /// Refuses output files (or an optional one) that cannot be written or lack the required extension; `what`
    /// describes their contents in the error.
    pub(crate) fn check_ending<'a>(
        self,
        files: impl IntoIterator<Item = &'a PathBuf>,
        ending: &str,
        what: &str,
        inputs: &[PathBuf],
    ) -> Result<(), Error> {
        for file in files {
            let has_ending = |extension: &OsStr| extension.eq_ignore_ascii_case(ending);
            if !file.extension().is_some_and(has_ending) {
                return Err(usage(
                    format!("{}: {what} are written as .{ending}", file.display()),
                    format!("name the output with the ending .{ending}"),
                ));
            }
            self.check(&[file], inputs)?;
        }
        Ok(())
    }

    /// Opens a folder for the files of a command: see [`Folder::open`].
    pub(crate) fn folder(
        self,
        target: &Path,
        command: &'static str,
        names: &[&str],
        inputs: &[PathBuf],
    ) -> Result<Folder, Error> {
        check_named(target)?;
        Ok(Folder::open(target, command, names, inputs, self.force)?)
    }

    /// Checks a folder for the files of a run, which [`Folder::begin`] begins.
    pub(crate) fn folder_to_begin(
        self,
        target: &Path,
        command: &'static str,
        names: &[&str],
        inputs: &[PathBuf],
    ) -> Result<Folder, Error> {
        check_named(target)?;
        Ok(Folder::check_only(target, command, names, inputs, self.force)?)
    }

    /// Opens a folder if one is requested.
    pub(crate) fn requested_folder(
        self,
        target: &Option<PathBuf>,
        command: &'static str,
        names: &[&str],
        inputs: &[PathBuf],
    ) -> Result<Option<Folder>, Error> {
        let target = target.as_ref();
        target
            .map(|target| self.folder(target, command, names, inputs))
            .transpose()
    }
}

/// A TOML file and the files that it names.
pub(crate) fn inputs(document: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    add_inputs(document, DEEPEST, &mut files);
    files
}

fn add_inputs(document: &Path, depth: usize, files: &mut Vec<PathBuf>) {
    files.push(document.to_owned());
    // A pipe can be read only once, by its reader.
    let small = fs::metadata(document).is_ok_and(|metadata| metadata.is_file() && metadata.len() <= LARGEST);
    let text = small.then(|| fs::read_to_string(document).ok()).flatten();
    let table = text.and_then(|text| text.parse().ok());
    let folder = document.parent().unwrap_or(Path::new(""));
    let mut values: Vec<toml::Value> = table.map(toml::Value::Table).into_iter().collect();
    while let Some(value) = values.pop() {
        match value {
            toml::Value::Table(table) => values.extend(table.into_iter().map(|(_, value)| value)),
            toml::Value::Array(array) => values.extend(array),
            toml::Value::String(name) if folder.join(&name).is_file() => {
                if name.ends_with(".toml") && depth > 0 {
                    add_inputs(&folder.join(name), depth - 1, files)
                } else {
                    files.push(folder.join(name))
                }
            }
            _ => {}
        }
    }
}

/// Writes a text file atomically.
pub(crate) fn text(path: &Path, text: &str) -> Result<(), Error> {
    Ok(atomic::write(path, |file| file.write_all(text.as_bytes()))?)
}

/// Writes a plot atomically.
pub(crate) fn plot(path: &Path, plot: &Plot) -> Result<(), Error> {
    text(path, &plot.svg()?)
}

/// Writes plots into a folder, each under its name.
pub(crate) fn plots(folder: &Path, plots: impl IntoIterator<Item = (impl AsRef<Path>, Plot)>) -> Result<(), Error> {
    let mut plots = plots.into_iter();
    plots.try_for_each(|(name, drawn)| plot(&folder.join(name).with_extension("svg"), &drawn))
}

/// Makes a text and writes it atomically, if a file is requested.
pub(crate) fn requested<E: Into<Error>>(
    file: &Option<PathBuf>,
    content: impl FnOnce() -> Result<String, E>,
) -> Result<(), Error> {
    let file = file.as_ref();
    file.map_or(Ok(()), |file| text(file, &content().map_err(Into::into)?))
}

/// Refuses an empty name of a folder.
fn check_named(target: &Path) -> Result<(), Error> {
    if target.as_os_str().is_empty() {
        return Err(usage("-o names no folder", "name a folder"));
    }
    Ok(())
}
