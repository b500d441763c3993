//! Studies as commands show them.

use std::path::Path;

use insonify::study::tradeoff::Study;

use super::failure::Failure;
use super::terminal;

/// Makes the folder that files of a study go to, before long work is done for them.
pub fn prepare(folder: Option<&Path>) -> Result<(), Failure> {
    let Some(folder) = folder else { return Ok(()) };
    std::fs::create_dir_all(folder).map_err(|cause| Failure::Folder {
        path: folder.to_owned(),
        cause,
    })
}

/// Writes the files of a study, where asked for, and prints it as text or JSON.
pub fn show(study: &Study, folder: Option<&Path>, json: bool, quiet: bool) -> Result<(), Failure> {
    if let Some(folder) = folder {
        let files = study.write(folder)?;
        if !quiet {
            terminal::say(format_args!("{}: {}", folder.display(), files.join(", ")));
        }
    }
    if json {
        terminal::emit_json(&study.json())
    } else {
        terminal::emit(&study.text())
    }
}
