//! Tetrahedral meshes in VTK files: unstructured grids, legacy (`.vtk`) and XML (`.vtu`).
//!
//! Formats as in "VTK File Formats" (Kitware, VTK documentation): legacy versions up to 5.1, ASCII and binary; XML with
//! ascii, base64 and appended (raw or base64) arrays, uncompressed or compressed by zlib. Coordinates are taken as
//! millimetres.

mod grid;
mod legacy;
mod write;
mod xml;

use std::path::{Path, PathBuf};

use super::{InvalidMesh, TetMesh};
pub use write::{legacy_ascii, write_legacy};

/// The point array that is taken for the displacement where no other is named.
pub const DISPLACEMENT: &str = "displacement";

/// Which arrays to read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions<'a> {
    /// Name of the point array with the displacements (mm, three components). It must be there. Without a name, the array
    /// [`DISPLACEMENT`] is read if the file has one.
    pub displacement: Option<&'a str>,
    /// Name of the cell array with the region numbers. It must be there. Without a name, the first of `region`, `label`,
    /// `material`, `medit:ref`, `gmsh:physical` and `CellEntityIds` is read if the file has one; else all regions are 0.
    pub region: Option<&'a str>,
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

/// Why a mesh file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// The file cannot be opened or read.
    #[error("{}: cannot read the mesh: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file cannot be written.
    #[error("{}: cannot write the mesh: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The contents break the format.
    #[error("{}: line {line} (byte {offset}): found {found}; expected {expected}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Line, from 1 (line ends inside binary data count too).
        line: usize,
        /// Byte offset, from 0.
        offset: usize,
        /// What stands there.
        found: String,
        /// What should stand there.
        expected: String,
    },
    /// The file is well formed, but what it describes is not a tetrahedral mesh.
    #[error("{}: {found}; expected {expected}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What it holds.
        found: String,
        /// What is needed.
        expected: String,
    },
    /// The cells do not make a valid mesh.
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with them.
        source: InvalidMesh,
    },
}

impl MeshFileError {
    /// Whether the machine is at fault (the output cannot be written) rather than the input.
    pub fn is_machine(&self) -> bool {
        matches!(self, MeshFileError::Write { .. })
    }
}

/// A fault at a byte offset, or in the whole.
#[derive(Debug, PartialEq)]
struct Fault {
    offset: Option<usize>,
    found: String,
    expected: String,
}

impl Fault {
    fn at(offset: usize, found: impl Into<String>, expected: impl Into<String>) -> Fault {
        Fault {
            offset: Some(offset),
            found: found.into(),
            expected: expected.into(),
        }
    }

    fn whole(found: impl Into<String>, expected: impl Into<String>) -> Fault {
        Fault {
            offset: None,
            found: found.into(),
            expected: expected.into(),
        }
    }
}

/// Reads a tetrahedral mesh, with its displacements if it carries any, from a `.vtk` or `.vtu` file. The format is told by the
/// contents.
///
/// # Errors
/// [`MeshFileError`], with the line and byte offset where the contents break the format.
pub fn read_mesh(path: &Path, options: &ReadOptions) -> Result<MeshFile, MeshFileError> {
    let bytes = std::fs::read(path).map_err(|source| MeshFileError::Read {
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
    let grid = if bytes.starts_with(b"# vtk DataFile") {
        legacy::parse(bytes)
    } else if bytes.trim_ascii_start().starts_with(b"<") {
        xml::parse(bytes)
    } else {
        let found = grid::quote(&bytes[..bytes.len().min(24)]);
        Err(Fault::at(
            0,
            found,
            "`# vtk DataFile` (legacy VTK) or an XML VTKFile of type UnstructuredGrid",
        ))
    };
    let parts = grid
        .and_then(|grid| grid.select(options))
        .map_err(|fault| locate(fault, bytes, path))?;
    let mesh = TetMesh::new(parts.nodes, parts.elements, parts.regions).map_err(|source| MeshFileError::Mesh {
        path: path.to_owned(),
        source,
    })?;
    Ok(MeshFile {
        mesh,
        displacements: parts.displacements,
        skipped_cells: parts.skipped_cells,
    })
}

fn locate(fault: Fault, bytes: &[u8], path: &Path) -> MeshFileError {
    let Fault {
        offset,
        found,
        expected,
    } = fault;
    let path = path.to_owned();
    match offset {
        None => MeshFileError::Content { path, found, expected },
        Some(offset) => {
            let line = 1 + bytes[..offset.min(bytes.len())].iter().filter(|b| **b == b'\n').count();
            MeshFileError::Syntax {
                path,
                line,
                offset,
                found,
                expected,
            }
        }
    }
}

#[cfg(test)]
mod tests;
