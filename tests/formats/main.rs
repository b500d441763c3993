//! Every real image and mesh file in the shared data loads as its manifest says or fails with a clear message, and no file,
//! however broken, makes a parser panic or take memory that its data do not fill.

mod broken;
#[cfg(unix)]
mod hostile;
mod meshes;
mod sequences;
mod volumes;

use std::path::PathBuf;

/// A file of the shared data; none, said aloud, where this checkout has no such folder.
fn data(name: &str) -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    if folder.is_dir() {
        Some(folder.join(name))
    } else {
        eprintln!("SKIPPED: {name} needs {}", folder.display());
        None
    }
}
