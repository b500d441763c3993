//! Sample mesh common to the format tests.

use std::path::Path;

use crate::TetMesh;
use crate::file::{MeshFile, MeshFileError, ReadOptions, read_mesh_bytes};

pub(super) fn read(bytes: &[u8]) -> Result<MeshFile, MeshFileError> {
    read_mesh_bytes(bytes, Path::new("mesh.vtk"), &ReadOptions::default())
}

/// Returns a box of tetrahedra in three regions, with displacements that no short decimal represents.
pub(super) fn sample() -> (TetMesh, Vec<[f64; 3]>) {
    let lattice = TetMesh::over_box([-1.0, 0.1, 7.0], [4.0, 3.0, 9.5], 30).unwrap();
    let regions = (0..lattice.elements().len() as i32).map(|n| n % 3 - 1).collect();
    let mesh = TetMesh::new(lattice.nodes().to_vec(), lattice.elements().to_vec(), regions).unwrap();
    let displacements = mesh.nodes().iter().map(|n| [n[1] / 3.0, -n[0] * 1e-7, 0.1]).collect();
    (mesh, displacements)
}

/// Returns the expected result of reading the sample.
pub(super) fn expected() -> MeshFile {
    let (mesh, displacements) = sample();
    MeshFile {
        mesh,
        displacements: Some(displacements),
        skipped_cells: 0,
        region_names: Default::default(),
        region_hint: None,
        warnings: Vec::new(),
    }
}
