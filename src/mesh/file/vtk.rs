//! VTK files of unstructured grids, legacy (`.vtk`) and XML (`.vtu`), and of poly-data (`.vtk`, `.vtp`).
//!
//! Formats as in "VTK File Formats" (Kitware, VTK documentation): legacy versions up to 5.1, ASCII and binary; XML with
//! ascii, base64 and appended (raw or base64) arrays, uncompressed or compressed by zlib.

mod grid;
mod legacy;
mod poly;
mod write;
mod xml;

pub use poly::{Poly, write_vtp};
pub use write::{Values, write_vtu, write_vtu_with};

use std::io::Write;
use std::path::Path;

use super::error::{Fault, MeshFileError, quote};
use super::surface::{SurfaceFile, stated_axes};
use super::{Cursor, Format, Parts, ReadOptions};
use insonify_base::output::atomic;
use insonify_base::output::place::Written;
use insonify_base::text::escape;

/// First bytes of a legacy file.
const LEGACY: &[u8] = b"# vtk DataFile";

/// The format.
pub(super) const FORMAT: Format = Format {
    name: "VTK (.vtk, .vtu)",
    start: "`# vtk DataFile` (legacy VTK), an XML VTKFile of type UnstructuredGrid",
    read,
    written: &[Written {
        ending: ".vtu",
        marks: &[b"<VTKFile"],
    }],
};

/// Returns the tetrahedra of a VTK file, or `None` where the contents are not a VTK file.
fn read(bytes: &[u8], options: &ReadOptions) -> Option<Result<Parts, Fault>> {
    let wanted = |of_points: bool, arrays: &[grid::Array]| grid::wanted(of_points, arrays, options);
    let grid = parse(bytes, false, wanted)?;
    Some(grid.and_then(|grid| grid.select(options)))
}

/// Returns the triangles of a VTK file, or `None` where the contents are not a VTK file.
pub(super) fn surface(bytes: &[u8]) -> Option<Result<SurfaceFile, Fault>> {
    let grid = parse(bytes, true, |_, _| Vec::new())?;
    Some(grid.and_then(|grid| grid.triangles()))
}

/// Reads a file into a grid; with poly-data if surfaces are allowed.
fn parse(
    bytes: &[u8],
    with_surfaces: bool,
    wanted: impl Fn(bool, &[grid::Array]) -> Vec<usize>,
) -> Option<Result<grid::Grid, Fault>> {
    if bytes.starts_with(LEGACY) {
        Some(legacy::parse(bytes, with_surfaces))
    } else if bytes.trim_ascii_start().starts_with(b"<") {
        Some(xml::parse(bytes, with_surfaces, wanted))
    } else {
        None
    }
}

/// Number type.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    F32,
    F64,
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
}

impl Kind {
    fn is_whole(self) -> bool {
        !matches!(self, Kind::F32 | Kind::F64)
    }

    /// Returns the size of a value, bytes.
    pub(crate) fn size(self) -> usize {
        match self {
            Kind::I8 | Kind::U8 => 1,
            Kind::I16 | Kind::U16 => 2,
            Kind::F32 | Kind::I32 | Kind::U32 => 4,
            Kind::F64 | Kind::I64 | Kind::U64 => 8,
        }
    }

    /// Returns the value whose bytes are the low ones of `word`.
    pub(crate) fn value(self, word: u64) -> f64 {
        match self {
            Kind::F32 => f64::from(f32::from_bits(word as u32)),
            Kind::F64 => f64::from_bits(word),
            Kind::I8 => f64::from(word as i8),
            Kind::I16 => f64::from(word as i16),
            Kind::I32 => f64::from(word as i32),
            Kind::I64 => word as i64 as f64,
            Kind::U8 | Kind::U16 | Kind::U32 | Kind::U64 => word as f64,
        }
    }
}

/// Reads an unsigned word of up to eight bytes.
fn word(bytes: &[u8], big_endian: bool) -> u64 {
    let shift = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
    if big_endian {
        bytes.iter().fold(0, shift)
    } else {
        bytes.iter().rev().fold(0, shift)
    }
}

/// Writes a time series: the time of each file (any unit, finite) and its name, relative to the folder of `path`.
///
/// # Errors
/// [`MeshFileError::Time`] for a time that is not finite; [`MeshFileError::Write`].
pub fn write_pvd(path: &Path, files: &[(f64, String)]) -> Result<(), MeshFileError> {
    if let Some((time, file)) = files.iter().find(|(time, _)| !time.is_finite()) {
        return Err(MeshFileError::Time {
            path: path.to_owned(),
            file: file.clone(),
            time: *time,
        });
    }
    atomic::write(path, |out| {
        writeln!(
            out,
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n<Collection>"
        )?;
        for (time, file) in files {
            writeln!(
                out,
                "<DataSet timestep=\"{time:?}\" part=\"0\" file=\"{}\"/>",
                escape(file)
            )?;
        }
        writeln!(out, "</Collection>\n</VTKFile>")
    })?;
    Ok(())
}

#[cfg(test)]
mod tests;
