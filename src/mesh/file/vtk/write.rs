//! Writer of XML VTK files (`.vtu`): a mesh with its regions, displacements and any other arrays.
//!
//! Arrays are inline, base64 over zlib blocks. Raw appended data would be faster to write, but produces a file that is
//! not XML and that several readers reject; inline arrays are read by ParaView, VTK, meshio and vtkio, and compression
//! compensates for the third that base64 adds.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;

use super::MeshFileError;
use super::grid::TETRA;
use crate::TetMesh;
use insonify_base::output::atomic;
use insonify_base::text::escape;

/// Name of the cell array of region numbers.
pub(super) const REGION: &str = "region";
/// Name of the field array of region names: strings such as `5 liver`.
pub(super) const REGION_NAMES: &str = "region_names";

/// Attributes of every file.
pub(super) const HEAD: &str =
    "version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"";

/// VTK's own size of uncompressed blocks, bytes.
const BLOCK: usize = 32_768;

/// Values of a named array, one entry per node or element.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Values<'a> {
    /// One number per entry.
    Scalars(&'a [f64]),
    /// One vector per entry.
    Vectors(&'a [[f64; 3]]),
    /// One symmetric tensor per entry: xx, yy, zz, xy, yz and xz, the order of ParaView.
    Symmetric(&'a [[f64; 6]]),
    /// One whole number per entry.
    Integers(&'a [i32]),
}

impl Values<'_> {
    fn len(&self) -> usize {
        match self {
            Values::Scalars(values) => values.len(),
            Values::Vectors(values) => values.len(),
            Values::Symmetric(values) => values.len(),
            Values::Integers(values) => values.len(),
        }
    }
}

/// Writes a mesh as a `.vtu` file, atomically: reference nodes, tetrahedra, the cell array `REGION` and, if given,
/// the point array [`DISPLACEMENT`](super::super::DISPLACEMENT) (mm, one vector per node).
/// [`read_mesh`](super::super::read_mesh) restores the same bits.
///
/// # Errors
/// As [`write_vtu_with`].
pub fn write_vtu(path: &Path, mesh: &TetMesh, displacements: Option<&[[f64; 3]]>) -> Result<(), MeshFileError> {
    let displacements = displacements.map(|all| (super::super::DISPLACEMENT, Values::Vectors(all)));
    write_vtu_with(path, mesh, &BTreeMap::new(), displacements.as_slice(), &[])
}

/// Writes a mesh as [`write_vtu`] does, with names of regions and any named arrays: `point_arrays` have an entry for
/// each node, `cell_arrays` for each element.
///
/// # Errors
/// [`MeshFileError::Array`] where an array has the wrong length, no name or a name in use; [`MeshFileError::Write`].
pub fn write_vtu_with(
    path: &Path,
    mesh: &TetMesh,
    region_names: &BTreeMap<i32, String>,
    point_arrays: &[(&str, Values)],
    cell_arrays: &[(&str, Values)],
) -> Result<(), MeshFileError> {
    let regions = [(REGION, Values::Integers(mesh.regions()))];
    let cell_arrays = [&regions[..], cell_arrays].concat();
    check(path, "nodes", mesh.nodes().len(), point_arrays)?;
    check(path, "tetrahedra", mesh.elements().len(), &cell_arrays)?;
    Ok(atomic::write(path, |out| {
        vtu(out, mesh, region_names, point_arrays, &cell_arrays)
    })?)
}

pub(super) fn check(
    path: &Path,
    items: &'static str,
    expected: usize,
    arrays: &[(&str, Values)],
) -> Result<(), MeshFileError> {
    for (index, (name, values)) in arrays.iter().enumerate() {
        let is_repeated = arrays[..index].iter().any(|(other, _)| other == name);
        // XML cannot contain control characters at all.
        let problem = if is_repeated {
            "its name is taken".to_owned()
        } else if name.is_empty() || name.chars().any(char::is_control) {
            "a name needs at least one character, and none that cannot be printed".to_owned()
        } else if values.len() != expected {
            format!("it has {} entries for {expected} {items}", values.len())
        } else {
            continue;
        };
        return Err(MeshFileError::Array {
            path: path.to_owned(),
            name: (*name).to_owned(),
            problem,
        });
    }
    Ok(())
}

fn vtu(
    out: &mut impl Write,
    mesh: &TetMesh,
    region_names: &BTreeMap<i32, String>,
    point_arrays: &[(&str, Values)],
    cell_arrays: &[(&str, Values)],
) -> io::Result<()> {
    let (nodes, cells) = (mesh.nodes(), mesh.elements());
    let corners = cells.as_flattened().iter().map(|node| i64::from(*node));
    let ends = (1..=cells.len() as i64).map(|cell| 4 * cell);
    write!(
        out,
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" {HEAD}>\n<UnstructuredGrid>\n"
    )?;
    if !region_names.is_empty() {
        write!(
            out,
            "<FieldData>\n<Array type=\"String\" Name=\"{REGION_NAMES}\" NumberOfTuples=\"{}\" format=\"ascii\">\n",
            region_names.len()
        )?;
        for (region, name) in region_names {
            // A zero ends a string in this encoding: one in a name would cut it in two.
            for code in format!("{region} {name}").bytes().filter(|code| *code != 0) {
                write!(out, "{code} ")?;
            }
            writeln!(out, "0")?;
        }
        writeln!(out, "</Array>\n</FieldData>")?;
    }
    write!(
        out,
        "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{}\">\n<Points>\n",
        nodes.len(),
        cells.len()
    )?;
    named(out, "Points", Values::Vectors(nodes))?;
    writeln!(out, "</Points>\n<Cells>")?;
    array(out, "Int64", "connectivity", 1, bytes(corners, i64::to_le_bytes))?;
    array(out, "Int64", "offsets", 1, bytes(ends, i64::to_le_bytes))?;
    array(out, "UInt8", "types", 1, vec![TETRA as u8; cells.len()])?;
    writeln!(out, "</Cells>")?;
    for (section, arrays) in [("PointData", point_arrays), ("CellData", cell_arrays)] {
        writeln!(out, "<{section}>")?;
        for (name, values) in arrays {
            named(out, name, *values)?;
        }
        writeln!(out, "</{section}>")?;
    }
    writeln!(out, "</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

pub(super) fn named(out: &mut impl Write, name: &str, values: Values) -> io::Result<()> {
    let floats = |values: &[f64]| bytes(values.iter().copied(), f64::to_le_bytes);
    match values {
        Values::Scalars(values) => array(out, "Float64", name, 1, floats(values)),
        Values::Vectors(values) => array(out, "Float64", name, 3, floats(values.as_flattened())),
        Values::Symmetric(values) => array(out, "Float64", name, 6, floats(values.as_flattened())),
        Values::Integers(values) => array(out, "Int32", name, 1, bytes(values.iter().copied(), i32::to_le_bytes)),
    }
}

pub(super) fn bytes<T, const N: usize>(values: impl Iterator<Item = T>, each: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    values.flat_map(each).collect()
}

/// Writes one array: in base64 the number of blocks, their size, that of the last where it differs, and their
/// compressed sizes; then, in a separate base64 string, the blocks.
pub(super) fn array(out: &mut impl Write, kind: &str, name: &str, components: usize, data: Vec<u8>) -> io::Result<()> {
    let mut packed = Vec::new();
    let mut header = [data.len().div_ceil(BLOCK), BLOCK, data.len() % BLOCK].to_vec();
    for block in data.chunks(BLOCK) {
        let start = packed.len();
        let mut encoder = ZlibEncoder::new(packed, Compression::default());
        encoder.write_all(block)?;
        packed = encoder.finish()?;
        header.push(packed.len() - start);
    }
    let header = bytes(header.into_iter(), |word| (word as u64).to_le_bytes());
    // One component is the default, and readers distinguish a list of numbers from a matrix of one column by its
    // absence.
    let components = match components {
        1 => String::new(),
        6 => (0..)
            .zip(["xx", "yy", "zz", "xy", "yz", "xz"])
            .fold(" NumberOfComponents=\"6\"".to_owned(), |text, (number, name)| {
                format!("{text} ComponentName{number}=\"{name}\"")
            }),
        count => format!(" NumberOfComponents=\"{count}\""),
    };
    writeln!(
        out,
        "<DataArray type=\"{kind}\" Name=\"{}\"{components} format=\"binary\">\n{}{}\n</DataArray>",
        escape(name),
        STANDARD.encode(header),
        STANDARD.encode(packed)
    )
}

#[cfg(test)]
mod tests;
