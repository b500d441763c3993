//! VTK files of unstructured grids, legacy (`.vtk`) and XML (`.vtu`); poly-data (`.vtp`), written only.
//!
//! Formats as in "VTK File Formats" (Kitware, VTK documentation): legacy versions up to 5.1, ASCII and binary; XML with
//! ascii, base64 and appended (raw or base64) arrays, uncompressed or compressed by zlib.

mod grid;
mod kind;
mod legacy;
mod poly;
mod pvd;
mod write;
mod xml;

use super::cursor::Cursor;
use super::error::{Fault, MeshFileError, quote};
use super::{Parts, ReadOptions};
pub use poly::{Poly, write_vtp};
pub use pvd::write_pvd;
#[cfg(any(test, feature = "internals"))]
pub use write::write_vtu;
pub use write::{Values, write_vtu_with};

/// First bytes of a legacy file.
const LEGACY: &[u8] = b"# vtk DataFile";

/// Returns the tetrahedra of a VTK file, or `None` where the contents are not a VTK file.
pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Option<Result<Parts, Fault>> {
    let grid = if bytes.starts_with(LEGACY) {
        legacy::parse(bytes)
    } else if bytes.trim_ascii_start().starts_with(b"<") {
        xml::parse(bytes, |of_points, name| grid::is_wanted(of_points, name, options))
    } else {
        return None;
    };
    Some(grid.and_then(|grid| grid.select(options)))
}

#[cfg(test)]
mod tests;
