//! Rigid motions left free by the prescribed displacements, by part of the mesh.
//!
//! Tetrahedra that share a face can only move rigidly together: they form a part, with six rigid motions. Each
//! prescribed displacement removes one combination of them; each node that two parts share without sharing a face there
//! couples three motions of one to three of the other. The remaining motions are the null space of a small matrix, and
//! of the stiffness matrix.

mod motion;
mod parts;

use crate::tissue::error::LinearError;
use std::collections::BTreeMap;

use nalgebra::{DMatrix, Vector3};

use super::dofs::{Dofs, NO_DOF};
use insonify_mesh::TetMesh;
pub use motion::Motion;
use parts::Parts;

/// Smallest restraint of a motion, relative to the most restrained one, that is distinguishable from none: stiffness
/// scales with its square, and the square is the rounding unit.
const HELD: f64 = 1.490_116_119_384_765_6e-8;

/// Most unrestrained parts hinged to each other whose joint motion is examined. Beyond, the dense matrix grows too
/// large, and the factorisation is left to fail.
const MAX_HINGED: usize = 64;

/// Part of the mesh that can still move.
#[derive(Clone, Debug, PartialEq)]
pub struct FreePart {
    /// Regions of its tetrahedra, ascending.
    pub regions: Vec<i32>,
    /// Number of nodes.
    pub nodes: usize,
    /// Volume, ml.
    pub volume_ml: f64,
    /// Lowest node index.
    pub example: u32,
    /// Linearly independent free motions.
    pub motions: Vec<Motion>,
}

/// Most items of a list in a message.
const NAMED: usize = 8;
/// Most parts in a message; larger than [`NAMED`], as each part needs nodes to fix it.
const PARTS: usize = 32;

pub(super) fn numbers(nodes: &[u32]) -> String {
    let mut named: Vec<String> = nodes.iter().take(NAMED).map(u32::to_string).collect();
    if nodes.len() > NAMED {
        named.push(format!("and {} more", nodes.len() - NAMED));
    }
    named.join(", ")
}

pub(super) fn sentences(parts: &[FreePart], names: &BTreeMap<i32, String>) -> String {
    let mut named: Vec<String> = parts.iter().take(PARTS).map(|part| part.sentence(names)).collect();
    if parts.len() > PARTS {
        named.push(format!("and {} parts more", parts.len() - PARTS));
    }
    let count = match parts.len() {
        1 => "a part of the mesh".to_owned(),
        count => format!("{count} parts of the mesh"),
    };
    format!(
        "the fixed nodes leave rigid motion free in {count}: {}",
        named.join("; ")
    )
}

impl FreePart {
    fn sentence(&self, names: &BTreeMap<i32, String>) -> String {
        let region = |region: &i32| match names.get(region) {
            Some(name) => format!("region {region} \"{name}\""),
            None => format!("region {region}"),
        };
        let regions: Vec<String> = self.regions.iter().take(NAMED).map(region).collect();
        let ellipsis = if self.regions.len() > NAMED { ", ..." } else { "" };
        // All six rigid motions need no list.
        let motions = match self.motions.len() {
            6 => "any translation or rotation".to_owned(),
            _ => self
                .motions
                .iter()
                .map(Motion::to_string)
                .collect::<Vec<_>>()
                .join(", "),
        };
        format!(
            "{}{ellipsis} ({} nodes, {:.3} ml, node {}), {motions}",
            regions.join(", "),
            self.nodes,
            self.volume_ml,
            self.example
        )
    }
}

/// Checks that the prescribed displacements prevent all rigid motions.
///
/// # Errors
/// [`LinearError`] with the nodes of no element, or with all movable parts and their motions.
///
/// # Panics
/// If the mesh and the degrees of freedom do not have the same number of nodes.
pub fn check(mesh: &TetMesh, dofs: &Dofs) -> Result<(), LinearError> {
    assert_eq!(mesh.nodes().len(), dofs.nodes(), "degrees of freedom of another mesh");
    let parts = Parts::of(mesh);
    let loose: Vec<u32> = parts
        .loose_nodes()
        .filter(|&node| dofs.of(node) != [NO_DOF; 3])
        .collect();
    if !loose.is_empty() {
        return Err(LinearError::LooseNodes { nodes: loose });
    }
    let mut supported = vec![false; parts.len()];
    while hold_more(mesh, dofs, &parts, &mut supported) {}
    let mut free = Vec::new();
    for group in parts.groups(|part| !supported[part]) {
        if group.len() <= MAX_HINGED {
            free.extend(free_parts(mesh, dofs, &parts, &supported, &group));
        }
    }
    if free.is_empty() {
        return Ok(());
    }
    free.sort_by_key(|(part, _)| *part);
    Err(LinearError::FreeParts {
        parts: free.into_iter().map(|(_, free)| free).collect(),
        names: BTreeMap::new(),
    })
}

/// Marks the parts fixed by their own prescribed displacements and by fixed parts around them; returns whether there
/// were any.
fn hold_more(mesh: &TetMesh, dofs: &Dofs, parts: &Parts, supported: &mut [bool]) -> bool {
    let before = supported.to_vec();
    for part in 0..parts.len() {
        supported[part] = supported[part]
            || Frame::of(mesh, parts, &[part])
                .null_space(mesh, dofs, parts, &before, &[part])
                .ncols()
                == 0;
    }
    *supported != *before
}

/// Returns the parts of a hinged group that can move, with their indices.
fn free_parts(
    mesh: &TetMesh,
    dofs: &Dofs,
    parts: &Parts,
    supported: &[bool],
    group: &[usize],
) -> Vec<(usize, FreePart)> {
    let frame = Frame::of(mesh, parts, group);
    let null = frame.null_space(mesh, dofs, parts, supported, group);
    let mut free = Vec::new();
    for (index, &part) in group.iter().enumerate() {
        let motions = motion::simplest(null.rows(6 * index, 6).into_owned(), frame.centre, frame.size);
        if !motions.is_empty() {
            let nodes = parts.nodes(part);
            free.push((
                part,
                FreePart {
                    regions: parts.regions(mesh, part),
                    nodes: nodes.len(),
                    volume_ml: 1e-3 * parts.volume_mm3(mesh, part),
                    example: nodes[0],
                    motions,
                },
            ));
        }
    }
    free
}

/// Centre of rotation and unit of length. Scaled to the unit ball about the origin, rotations and translations have
/// equal weight.
struct Frame {
    centre: Vector3<f64>,
    size: f64,
}

impl Frame {
    fn of(mesh: &TetMesh, parts: &Parts, group: &[usize]) -> Frame {
        let positions = || {
            let nodes = group.iter().flat_map(|&part| parts.nodes(part));
            nodes.map(|&node| Vector3::from(mesh.nodes()[node as usize]))
        };
        let centre = positions().sum::<Vector3<f64>>() / positions().count() as f64;
        let size = positions()
            .map(|position| (position - centre).norm())
            .fold(0.0, f64::max);
        Frame { centre, size }
    }

    /// Returns the unconstrained combinations of the group's rigid motions as orthonormal columns. Each part has six
    /// rows: its translation, and its rotation about the centre times the size.
    fn null_space(
        &self,
        mesh: &TetMesh,
        dofs: &Dofs,
        parts: &Parts,
        supported: &[bool],
        group: &[usize],
    ) -> DMatrix<f64> {
        let mut rows: Vec<f64> = Vec::new();
        let width = 6 * group.len();
        // Displacement of a node along an axis per unit of the six motions of its part.
        let displacement = |node: u32, axis: usize| {
            let arm = (Vector3::from(mesh.nodes()[node as usize]) - self.centre) / self.size;
            let direction = Vector3::ith(axis, 1.0);
            let turned = arm.cross(&direction);
            [direction.x, direction.y, direction.z, turned.x, turned.y, turned.z]
        };
        let mut row = |entries: &[(usize, f64)], node: u32, axis: usize| {
            let start = rows.len();
            rows.resize(start + width, 0.0);
            let displacement = displacement(node, axis);
            for &(index, sign) in entries {
                for (column, value) in displacement.iter().enumerate() {
                    rows[start + 6 * index + column] = sign * value;
                }
            }
        };
        for (index, &part) in group.iter().enumerate() {
            for &node in parts.nodes(part) {
                let tied = parts.sharing(node);
                let still = tied.iter().any(|&sharing| sharing != part && supported[sharing]);
                let next = tied.iter().filter(|&&sharing| sharing > part);
                let next = next
                    .filter_map(|sharing| group.iter().position(|member| member == sharing))
                    .min();
                for axis in 0..3 {
                    if still || dofs.of(node)[axis] == NO_DOF {
                        row(&[(index, 1.0)], node, axis);
                    } else if let Some(next) = next {
                        row(&[(index, 1.0), (next, -1.0)], node, axis);
                    }
                }
            }
        }
        null_space(DMatrix::from_row_slice(rows.len() / width, width, &rows))
    }
}

/// Returns orthonormal columns that a matrix maps to (nearly) zero.
fn null_space(matrix: DMatrix<f64>) -> DMatrix<f64> {
    let width = matrix.ncols();
    let height = matrix.nrows().max(width);
    let triangle = matrix.resize_vertically(height, 0.0).qr().unpack_r();
    let svd = triangle.svd(false, true);
    let largest = svd.singular_values.max();
    let columns: Vec<_> = svd
        .v_t
        .iter()
        .flat_map(|v_t| v_t.row_iter())
        .zip(svd.singular_values.iter())
        .filter(|(_, value)| **value <= HELD * largest)
        .map(|(row, _)| row.transpose())
        .collect();
    if columns.is_empty() {
        DMatrix::zeros(width, 0)
    } else {
        DMatrix::from_columns(&columns)
    }
}

#[cfg(test)]
mod tests;
