//! Mesh files that a subcommand is asked to write.

use std::io;
use std::path::Path;

use insonify::output::atomic::WriteError;

use super::failure::Failure;

/// Refuses an output that cannot be written before long work is done for it.
pub fn check(output: &Path) -> Result<(), Failure> {
    let named = output
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("vtu"));
    if !named {
        let found = format!("{}: meshes are written as .vtu", output.display());
        return Err(Failure::usage(found, "name the output with the ending .vtu"));
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
