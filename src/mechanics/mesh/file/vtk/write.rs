//! Legacy ASCII VTK out: a mesh, its regions and its displacements.

use std::path::Path;

use super::MeshFileError;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::file::DISPLACEMENT;

/// The mesh as a legacy ASCII VTK file (version 4.2): reference nodes, tetrahedra, the cell array `region` and, if given, the
/// point array [`DISPLACEMENT`] (mm, one vector a node).
pub fn legacy_ascii(mesh: &TetMesh, displacements: Option<&[[f64; 3]]>) -> String {
    let mut text = String::from("# vtk DataFile Version 4.2\ninsonify\nASCII\nDATASET UNSTRUCTURED_GRID\n");
    let (nodes, cells) = (mesh.nodes(), mesh.elements().len());
    text += &format!("POINTS {} double\n", nodes.len());
    vectors(&mut text, nodes);
    text += &format!("CELLS {cells} {}\n", 5 * cells);
    for [a, b, c, d] in mesh.elements() {
        text += &format!("4 {a} {b} {c} {d}\n");
    }
    text += &format!("CELL_TYPES {cells}\n");
    text += &"10\n".repeat(cells);
    text += &format!("CELL_DATA {cells}\nSCALARS region int 1\nLOOKUP_TABLE default\n");
    for region in mesh.regions() {
        text += &format!("{region}\n");
    }
    if let Some(displacements) = displacements {
        text += &format!("POINT_DATA {}\nVECTORS {DISPLACEMENT} double\n", displacements.len());
        vectors(&mut text, displacements);
    }
    text
}

/// Writes [`legacy_ascii`] to a file, whole or not at all.
///
/// # Errors
/// [`MeshFileError::Write`].
pub fn write_legacy(path: &Path, mesh: &TetMesh, displacements: Option<&[[f64; 3]]>) -> Result<(), MeshFileError> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    let write = || -> std::io::Result<()> {
        let mut file = tempfile::NamedTempFile::new_in(folder)?;
        std::io::Write::write_all(&mut file, legacy_ascii(mesh, displacements).as_bytes())?;
        file.persist(path)?;
        Ok(())
    };
    write().map_err(|source| MeshFileError::Write {
        path: path.to_owned(),
        source,
    })
}

fn vectors(text: &mut String, vectors: &[[f64; 3]]) {
    for [x, y, z] in vectors {
        *text += &format!("{x:?} {y:?} {z:?}\n");
    }
}
