//! Tetrahedral meshes in files. The format is told by the contents; coordinates are millimetres unless another [`Unit`] is given.
//!
//! | module | what it reads and writes |
//! |---|---|
//! | `gmsh` | Gmsh meshes (`.msh`), read only |
//! | [`vtk`] | unstructured grids of VTK, legacy (`.vtk`) and XML (`.vtu`) |

mod cursor;
mod error;
mod gmsh;
pub mod vtk;

use std::collections::BTreeMap;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::TetMesh;
use crate::{memory, read};
pub use error::MeshFileError;
use error::{Fault, quote};
pub use vtk::{Values, write_pvd, write_vtu, write_vtu_with};

/// The point array that is taken for the displacement where no other is named.
pub const DISPLACEMENT: &str = "displacement";

/// Memory for an element of a mesh and what is found out about it, beside its part of the file, about.
const BYTES_PER_ELEMENT: u64 = 256;

/// The length that a coordinate of 1 stands for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// A millimetre.
    #[default]
    Mm,
    /// A centimetre.
    Cm,
    /// A metre.
    M,
}

impl Unit {
    /// Millimetres in it.
    const fn mm(self) -> f64 {
        match self {
            Unit::Mm => 1.0,
            Unit::Cm => 10.0,
            Unit::M => 1000.0,
        }
    }
}

/// Longest side of a mesh in millimetres below which it is taken for one in metres, mm.
const METRES: f64 = 1.0;

/// Which arrays to read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions<'a> {
    /// Name of the point array with the displacements (mm, three components). It must be there. Without a name, the array
    /// [`DISPLACEMENT`] is read if the file has one.
    pub displacement: Option<&'a str>,
    /// Name of the cell array with the region numbers. It must be there. Without a name, the first of `region`, `label`,
    /// `material`, `medit:ref`, `gmsh:physical` and `CellEntityIds` is read if the file has one; else all regions are 0.
    /// Of a Gmsh file the names are `gmsh:physical` (the first physical group, and the volume where there is none; also taken
    /// without a name) and `gmsh:geometrical` (the volume).
    pub region: Option<&'a str>,
    /// The unit of coordinates and displacements.
    pub unit: Unit,
}

/// What a mesh file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// The mesh at the positions in the file: its reference state.
    pub mesh: TetMesh,
    /// A displacement for each node, mm.
    pub displacements: Option<Vec<[f64; 3]>>,
    /// Cells of lower dimension (vertices, lines, surfaces) that were left out.
    pub skipped_cells: usize,
    /// Names of regions, where the file has any (physical groups of Gmsh).
    pub region_names: BTreeMap<i32, String>,
    /// What the user should know: where regions are not what they may seem.
    pub warnings: Vec<String>,
}

impl MeshFile {
    /// Current positions of the nodes (mm): reference plus displacement.
    pub fn current(&self) -> Vec<[f64; 3]> {
        let nodes = self.mesh.nodes();
        match &self.displacements {
            None => nodes.to_vec(),
            Some(all) => nodes
                .iter()
                .zip(all)
                .map(|(n, u)| [n[0] + u[0], n[1] + u[1], n[2] + u[2]])
                .collect(),
        }
    }
}

/// The tetrahedra of a file, not yet a mesh.
#[derive(Debug)]
struct Parts {
    nodes: Vec<[f64; 3]>,
    elements: Vec<[u32; 4]>,
    regions: Vec<i32>,
    displacements: Option<Vec<[f64; 3]>>,
    skipped_cells: usize,
    region_names: BTreeMap<i32, String>,
    warnings: Vec<String>,
}

/// Reads a tetrahedral mesh, with its displacements if it carries any.
///
/// # Errors
/// [`MeshFileError`], with the line and byte offset where the contents break the format.
pub fn read_mesh(path: &Path, options: &ReadOptions) -> Result<MeshFile, MeshFileError> {
    let bytes = read::whole(path, read::MESH).map_err(|source| MeshFileError::Read {
        path: path.to_owned(),
        source,
    })?;
    read_mesh_bytes(&bytes, path, options)
}

/// As [`read_mesh`], from memory; `path` is only named in errors.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_bytes(bytes: &[u8], path: &Path, options: &ReadOptions) -> Result<MeshFile, MeshFileError> {
    let parts = vtk::read(bytes, options).or_else(|| gmsh::read(bytes, options));
    let parts = parts.unwrap_or_else(|| {
        Err(Fault::at(
            0,
            quote(&bytes[..bytes.len().min(24)]),
            "`# vtk DataFile` (legacy VTK), an XML VTKFile of type UnstructuredGrid, or `$MeshFormat` (Gmsh)",
        ))
    });
    let parts = parts.and_then(|parts| {
        memory::check(BYTES_PER_ELEMENT * parts.elements.len() as u64, "a mesh")?;
        Ok(parts)
    });
    let mut parts = parts.map_err(|fault| fault.locate(bytes, path))?;
    if options.unit != Unit::Mm {
        let vectors = parts.nodes.iter_mut().chain(parts.displacements.iter_mut().flatten());
        vectors.flatten().for_each(|x| *x *= options.unit.mm());
    }
    let mesh = TetMesh::new(parts.nodes, parts.elements, parts.regions).map_err(|source| MeshFileError::Mesh {
        path: path.to_owned(),
        source,
    })?;
    parts.warnings.extend(small(&mesh));
    Ok(MeshFile {
        mesh,
        displacements: parts.displacements,
        skipped_cells: parts.skipped_cells,
        region_names: parts.region_names,
        warnings: parts.warnings,
    })
}

/// A warning about a mesh whose coordinates seem to be metres.
fn small(mesh: &TetMesh) -> Option<String> {
    let [low, high] = mesh.bounds();
    let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    (longest < METRES).then(|| {
        format!("the mesh is {longest:.3} mm long at most; if its coordinates are metres, state the unit: `mesh_unit = \"m\"`")
    })
}
