//! Plots that a subcommand is asked to write.

use std::io::{self, Write};
use std::path::Path;

use insonify::output::atomic::{self, WriteError};
use insonify::study::plot::Plot;

use super::failure::Failure;

/// Refuses an output that cannot be written before long work is done for it.
pub fn check(output: &Path) -> Result<(), Failure> {
    let named = output
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("svg"));
    if !named {
        let found = format!("{}: plots are written as .svg", output.display());
        return Err(Failure::usage(found, "name the output with the ending .svg"));
    }
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty());
    match folder {
        Some(folder) if !folder.is_dir() => {
            let cause = io::Error::from(io::ErrorKind::NotFound);
            Err(WriteError::new(output, cause).into())
        }
        _ => Ok(()),
    }
}

/// Writes a plot, whole or not at all.
pub fn write(output: &Path, plot: &Plot) -> Result<(), Failure> {
    let text = plot.svg()?;
    atomic::write(output, |file| file.write_all(text.as_bytes()))?;
    Ok(())
}
