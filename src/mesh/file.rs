//! Tetrahedral mesh files. The format is recognised from the contents; coordinates are millimetres unless another
//! [`Unit`] is given.
//!
//! A format is a file of this folder with its `Format`, and a line of `formats!`.

mod error;
mod surface;

pub use error::MeshFileError;
pub use surface::{SURFACES, SurfaceFile};
pub use vtk::{Poly, Values, write_pvd, write_vtp, write_vtu, write_vtu_with};

use std::collections::BTreeMap;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::TetMesh;
use error::{Fault, quote};
use insonify_base::foreign::Foreign;
use insonify_base::matrix::FARTHEST_MM;
use insonify_base::output::place::Written;
use insonify_base::{memory, read};

/// A file format.
struct Format {
    /// Name and endings, for messages.
    name: &'static str,
    /// How a file starts, for messages.
    start: &'static str,
    /// Reads the tetrahedra; `None` where the contents are not those of such a file.
    read: fn(&[u8], &ReadOptions) -> Option<Result<Parts, Fault>>,
    /// Files that are written.
    written: &'static [Written],
}

/// Declares the formats by their modules.
macro_rules! formats {
    ($($module:ident;)+) => {
        $(mod $module;)+

        /// All formats. At most one reads a file.
        const FORMATS: &[&Format] = &[$(&$module::FORMAT),+];
    };
}

formats! {
    vtk;
    gmsh;
}

/// Mesh files that are written.
pub fn written() -> impl Iterator<Item = Written> {
    FORMATS.iter().flat_map(|format| format.written).copied()
}

/// Default name of the point array with the displacements.
pub const DISPLACEMENT: &str = "displacement";

/// Approximate memory per element for a mesh and its derived data, in addition to its part of the file, bytes.
const BYTES_PER_ELEMENT: u64 = 256;

/// Unit of length of the coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
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
    /// Returns the unit in millimetres.
    pub const fn mm(self) -> f64 {
        match self {
            Unit::Mm => 1.0,
            Unit::Cm => 10.0,
            Unit::M => 1000.0,
        }
    }
}

/// Longest side of a mesh, read as millimetres, below which it is assumed to be in metres, mm.
const METRES: f64 = 1.0;

/// Names of the arrays to read, and the unit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions<'a> {
    /// Name of the point array with the displacements (mm, three components), which must exist. Without a name, the
    /// array [`DISPLACEMENT`] is read if the file has one.
    pub displacement: Option<&'a str>,
    /// Name of the cell array with the region numbers, which must exist. Without a name, the first of `region`,
    /// `label`, `material`, `medit:ref`, `gmsh:physical` and `CellEntityIds` in the file is read, or else the only one
    /// of a few whole numbers; without any, all regions are 0. In a Gmsh file the names are `gmsh:physical` (the first
    /// physical group, or the volume where there is none; also the default) and `gmsh:geometrical` (the volume).
    pub region: Option<&'a str>,
    /// Unit of coordinates and displacements.
    pub unit: Unit,
}

/// Contents of a mesh file.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// The mesh with the node positions of the file: its reference state.
    pub mesh: TetMesh,
    /// Displacement of each node, mm.
    pub displacements: Option<Vec<[f64; 3]>>,
    /// Number of ignored cells of lower dimension (vertices, lines, surfaces).
    pub skipped_cells: usize,
    /// Names of regions, where the file has any (physical groups of Gmsh).
    pub region_names: BTreeMap<i32, String>,
    /// Cell arrays of the file that could give the regions, where nothing does.
    pub region_hint: Option<String>,
    /// Warnings for the user: where regions differ from what might be expected.
    pub warnings: Vec<String>,
}

impl MeshFile {
    /// Returns the current positions of the nodes (mm): reference plus displacement.
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
    region_hint: Option<String>,
    /// Axes stated by the title: RAS (true) or LPS (false).
    is_ras: Option<bool>,
    /// Number of tetrahedra that have nodes beside their corners.
    curved: usize,
    warnings: Vec<String>,
}

impl Parts {
    /// Refuses nodes that lie too far for their products to be finite, and displacements that are not finite or as far.
    /// Nodes that are not finite are for [`TetMesh::new`] to refuse.
    fn check_size(&self) -> Result<(), Fault> {
        let is_within = |vector: &[f64; 3]| vector.iter().all(|x| x.abs() <= FARTHEST_MM);
        let is_finite = |vector: &[f64; 3]| vector.iter().all(|x| x.is_finite());
        let far = self.nodes.iter().position(|node| is_finite(node) && !is_within(node));
        let moved = self.displacements.iter().flatten().position(|by| !is_within(by));
        let (what, number, vector) = match (far, moved, &self.displacements) {
            (Some(node), _, _) => ("node", node, self.nodes[node]),
            (None, Some(node), Some(all)) => ("displacement of node", node, all[node]),
            _ => return Ok(()),
        };
        Err(Fault::of_file(
            format!("{what} {number}: {vector:?} mm"),
            format!("finite numbers up to {FARTHEST_MM:e} mm"),
        ))
    }

    /// Leaves out the nodes that curved tetrahedra have beside their corners.
    fn straighten(&mut self) {
        if self.curved == 0 {
            return;
        }
        let kept = renumber(self.elements.as_flattened_mut(), self.nodes.len());
        self.warnings.push(format!(
            "{} tetrahedra of second or higher order are read by their corners: {} of {} nodes are left out, the others are \
             numbered in their order",
            self.curved,
            self.nodes.len() - kept.len(),
            self.nodes.len()
        ));
        self.nodes = kept.iter().map(|node| self.nodes[*node]).collect();
        if let Some(all) = &mut self.displacements {
            *all = kept.iter().map(|node| all[*node]).collect();
        }
    }
}

/// Numbers nodes anew without gaps, in their order; returns the old number of each. All are below `count`.
fn renumber(nodes: &mut [u32], count: usize) -> Vec<usize> {
    let mut numbers = vec![None; count];
    nodes.iter().for_each(|node| numbers[*node as usize] = Some(0));
    let kept: Vec<usize> = (0..count).filter(|node| numbers[*node].is_some()).collect();
    (0u32..)
        .zip(&kept)
        .for_each(|(number, node)| numbers[*node] = Some(number));
    for node in nodes {
        *node = numbers[*node as usize].unwrap_or_default();
    }
    kept
}

/// Error for a file of another kind, which names it and what to do with it.
fn foreign(bytes: &[u8]) -> Option<Fault> {
    let kind = Foreign::of(bytes)?;
    let instead = kind.mesh?;
    let names: Vec<&str> = FORMATS.iter().map(|format| format.name).collect();
    Some(Fault::of_file(kind.name, format!("{}: {instead}", names.join(" or "))))
}

/// Reads a tetrahedral mesh, with its displacements if there are any.
///
/// ```
/// use insonify_mesh::TetMesh;
/// use insonify_mesh::file::{ReadOptions, Unit, read_mesh, read_mesh_bytes, write_vtu};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("block.vtu");
/// let mesh = TetMesh::over_box([0.0; 3], [40.0, 30.0, 20.0], 60)?;
/// let lifted = vec![[0.0, 0.0, 1.5]; mesh.nodes().len()];
/// write_vtu(&path, &mesh, Some(&lifted))?;
///
/// let file = read_mesh(&path, &ReadOptions::default())?;
/// assert_eq!(file.mesh, mesh);
/// assert_eq!(file.current()[0][2], mesh.nodes()[0][2] + 1.5);
///
/// // The same numbers as metres, from memory.
/// let in_metres = ReadOptions { unit: Unit::M, ..ReadOptions::default() };
/// let file = read_mesh_bytes(&std::fs::read(&path)?, &path, &in_metres)?;
/// assert_eq!(file.mesh.bounds()[1], [40e3, 30e3, 20e3]);
///
/// let error = read_mesh_bytes(b"solid block", "block.stl".as_ref(), &in_metres).unwrap_err();
/// assert!(error.to_string().contains("block.stl"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`MeshFileError`], with the line and byte offset where the contents violate the format.
pub fn read_mesh(path: &Path, options: &ReadOptions) -> Result<MeshFile, MeshFileError> {
    let bytes = read::bytes(path, read::MESH).map_err(|source| MeshFileError::Read {
        path: path.to_owned(),
        source,
    })?;
    read_mesh_bytes(&bytes, path, options)
}

/// Reads a mesh from memory as [`read_mesh`] does; `path` is used only in errors.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_bytes(bytes: &[u8], path: &Path, options: &ReadOptions) -> Result<MeshFile, MeshFileError> {
    let parts = match foreign(bytes) {
        Some(fault) => Some(Err(fault)),
        None => FORMATS.iter().find_map(|format| (format.read)(bytes, options)),
    };
    let parts = parts.unwrap_or_else(|| {
        let names: Vec<&str> = FORMATS.iter().map(|format| format.start).collect();
        Err(Fault::at(0, quote(&bytes[..bytes.len().min(24)]), names.join(", or ")))
    });
    let parts = parts.and_then(|parts| {
        memory::check(BYTES_PER_ELEMENT * parts.elements.len() as u64, "a mesh")?;
        Ok(parts)
    });
    let mut parts = parts.map_err(|fault| fault.locate(bytes, path))?;
    parts.straighten();
    if parts.is_ras == Some(true) {
        let vectors = parts.nodes.iter_mut().chain(parts.displacements.iter_mut().flatten());
        vectors.for_each(|[x, y, _]| (*x, *y) = (-*x, -*y));
        let told = "the file states its axes (SPACE=RAS): turned to LPS";
        parts.warnings.push(told.to_owned());
    }
    if options.unit != Unit::Mm {
        let vectors = parts.nodes.iter_mut().chain(parts.displacements.iter_mut().flatten());
        vectors.flatten().for_each(|x| *x *= options.unit.mm());
    }
    parts.check_size().map_err(|fault| fault.locate(bytes, path))?;
    let mesh = TetMesh::new(parts.nodes, parts.elements, parts.regions).map_err(|source| MeshFileError::Mesh {
        path: path.to_owned(),
        source,
    })?;
    parts.warnings.extend(parts.region_hint.clone());
    parts.warnings.extend(small(&mesh));
    Ok(MeshFile {
        mesh,
        displacements: parts.displacements,
        skipped_cells: parts.skipped_cells,
        region_names: parts.region_names,
        region_hint: parts.region_hint,
        warnings: parts.warnings,
    })
}

/// Returns a warning about a mesh whose coordinates seem to be metres.
fn small(mesh: &TetMesh) -> Option<String> {
    let [low, high] = mesh.bounds();
    let longest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    (longest < METRES).then(|| {
        format!("the mesh is {longest:.3} mm long at most; if its coordinates are metres, state the unit: `mesh_unit = \"m\"` or --unit m")
    })
}

/// Reader of words and lines, each with its byte offset.
struct Cursor<'a> {
    pub bytes: &'a [u8],
    pub at: usize,
}

impl<'a> Cursor<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Cursor<'a> {
        Cursor { bytes, at: 0 }
    }

    /// Returns the unread bytes.
    pub(crate) fn rest(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    /// Reads the rest of the line, without its end.
    pub(crate) fn line(&mut self) -> &'a [u8] {
        let rest = self.rest();
        let end = rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        self.at += (end + 1).min(rest.len());
        &rest[..end]
    }

    /// Returns the next word and its offset without consuming it; empty at the end.
    pub(crate) fn peek(&self) -> (usize, &'a [u8]) {
        let rest = self.rest();
        let start = rest.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rest.len());
        let end = rest[start..]
            .iter()
            .position(u8::is_ascii_whitespace)
            .map_or(rest.len(), |n| start + n);
        (self.at + start, &rest[start..end])
    }

    /// Reads the next word and its offset; empty at the end.
    pub(crate) fn word(&mut self) -> (usize, &'a [u8]) {
        let (start, word) = self.peek();
        self.at = start + word.len();
        (start, word)
    }

    /// Reads the next word as a number; `expected` describes it.
    pub(crate) fn number<T: std::str::FromStr>(&mut self, expected: impl FnOnce() -> String) -> Result<T, Fault> {
        let (start, word) = self.word();
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| Fault::at(start, quote(word), expected()))
    }

    pub(crate) fn count(&mut self) -> Result<usize, Fault> {
        self.number(|| "a count".to_owned())
    }

    /// Reads the next `count` bytes.
    pub(crate) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let bytes = self.rest().get(..count)?;
        self.at += count;
        Some(bytes)
    }
}
