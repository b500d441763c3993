//! Writer of XML poly-data (`.vtp`): points joined by vertices, lines and polygons.

use std::io::{self, Write};
use std::path::Path;

use super::MeshFileError;
use super::write::{HEAD, Values, array, bytes, check, named};
use insonify_base::output::atomic;

/// Points and the cells that join them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Poly {
    /// Positions, mm.
    pub points: Vec<[f64; 3]>,
    /// Single points.
    pub vertices: Vec<u32>,
    /// Polylines.
    pub lines: Vec<Vec<u32>>,
    /// Polygons.
    pub polygons: Vec<Vec<u32>>,
}

/// Writes a `.vtp` file, atomically, with named arrays: `point_arrays` have an entry for each point, `cell_arrays` for
/// each cell, vertices before lines before polygons.
///
/// # Errors
/// [`MeshFileError::Array`] where an array has the wrong length, no name or a name in use; [`MeshFileError::Write`].
pub fn write_vtp(
    path: &Path,
    poly: &Poly,
    point_arrays: &[(&str, Values)],
    cell_arrays: &[(&str, Values)],
) -> Result<(), MeshFileError> {
    let cells = poly.vertices.len() + poly.lines.len() + poly.polygons.len();
    check(path, "points", poly.points.len(), point_arrays)?;
    check(path, "cells", cells, cell_arrays)?;
    Ok(atomic::write(path, |out| vtp(out, poly, point_arrays, cell_arrays))?)
}

fn vtp(
    out: &mut impl Write,
    poly: &Poly,
    point_arrays: &[(&str, Values)],
    cell_arrays: &[(&str, Values)],
) -> io::Result<()> {
    let [vertices, lines, polygons] = [poly.vertices.len(), poly.lines.len(), poly.polygons.len()];
    write!(
        out,
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" {HEAD}>\n<PolyData>\n<Piece NumberOfPoints=\"{}\" \
         NumberOfVerts=\"{vertices}\" NumberOfLines=\"{lines}\" NumberOfStrips=\"0\" NumberOfPolys=\"{polygons}\">\n<Points>\n",
        poly.points.len()
    )?;
    named(out, "Points", Values::Vectors(&poly.points))?;
    writeln!(out, "</Points>")?;
    let vertices: Vec<Vec<u32>> = poly.vertices.iter().map(|point| vec![*point]).collect();
    for (section, cells) in [("Verts", &vertices), ("Lines", &poly.lines), ("Polys", &poly.polygons)] {
        let mut end = 0;
        let ends = cells.iter().map(|cell| {
            end += cell.len() as i64;
            end
        });
        let corners = cells.iter().flatten().map(|point| i64::from(*point));
        writeln!(out, "<{section}>")?;
        array(out, "Int64", "connectivity", 1, bytes(corners, i64::to_le_bytes))?;
        array(out, "Int64", "offsets", 1, bytes(ends, i64::to_le_bytes))?;
        writeln!(out, "</{section}>")?;
    }
    for (section, arrays) in [("PointData", point_arrays), ("CellData", cell_arrays)] {
        writeln!(out, "<{section}>")?;
        for (name, values) in arrays {
            named(out, name, *values)?;
        }
        writeln!(out, "</{section}>")?;
    }
    writeln!(out, "</Piece>\n</PolyData>\n</VTKFile>")
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use base64::Engine;
    use base64::engine::general_purpose::STANDARD;
    use flate2::read::ZlibDecoder;

    use super::*;

    /// Unpacks an array of one block: 32 bytes of header are 44 characters.
    fn unpacked(text: &str, name: &str, nth: usize) -> Vec<u8> {
        let tag = format!("Name=\"{name}\"");
        let (_, after) = text.split_once(&tag).expect("the array");
        let after = (0..nth).fold(after, |after, _| after.split_once(&tag).expect("the array").1);
        let line = after.lines().nth(1).expect("a line");
        let mut bytes = Vec::new();
        let packed = STANDARD.decode(&line[44..]).expect("base64");
        ZlibDecoder::new(&packed[..]).read_to_end(&mut bytes).expect("zlib");
        bytes
    }

    #[test]
    fn cells_and_arrays_are_written_in_order() {
        let poly = Poly {
            points: vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 2.0, 0.1], [0.0, 1.0, 0.0]],
            vertices: vec![3],
            lines: vec![vec![0, 1], vec![1, 2, 3]],
            polygons: vec![vec![0, 1, 2, 3]],
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtp");
        let force = [1.0, 2.0, 3.0, 4.0];
        write_vtp(&path, &poly, &[], &[("force", Values::Scalars(&force))]).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(
            text.contains("NumberOfPoints=\"4\" NumberOfVerts=\"1\" NumberOfLines=\"2\""),
            "{text}"
        );
        let floats = |name| {
            let bytes = unpacked(&text, name, 0);
            bytes
                .as_chunks::<8>()
                .0
                .iter()
                .map(|word| f64::from_le_bytes(*word))
                .collect::<Vec<_>>()
        };
        let whole = |name, nth| {
            let bytes = unpacked(&text, name, nth);
            bytes
                .as_chunks::<8>()
                .0
                .iter()
                .map(|word| i64::from_le_bytes(*word))
                .collect::<Vec<_>>()
        };
        assert_eq!(floats("Points"), poly.points.as_flattened());
        assert_eq!(floats("force"), force);
        assert_eq!((whole("connectivity", 0), whole("offsets", 0)), (vec![3], vec![1]));
        assert_eq!(
            (whole("connectivity", 1), whole("offsets", 1)),
            (vec![0, 1, 1, 2, 3], vec![2, 5])
        );
        assert_eq!(
            (whole("connectivity", 2), whole("offsets", 2)),
            (vec![0, 1, 2, 3], vec![4])
        );
        let error = write_vtp(&path, &poly, &[], &[("force", Values::Scalars(&force[1..]))]).unwrap_err();
        assert!(error.to_string().contains("3 entries for 4 cells"), "{error}");
    }
}
