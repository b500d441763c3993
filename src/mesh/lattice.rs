//! Lattice meshes over a box: cells split into six tetrahedra along their main diagonals.
//!
//! The split (H. Freudenthal, "Simplizialzerlegungen von beschraenkter Flachheit", 1942; H. W. Kuhn, 1960) is the same
//! in every cell and matches across cell faces, so the mesh conforms without any bookkeeping.

use nalgebra::{Matrix4, Point3, Vector3};

use super::{InvalidMesh, TetMesh};

/// Orders in which a walk along the cell's edges from its first to its last corner can take the three axes, each with
/// the sign of the permutation.
const WALKS: [([usize; 3], bool); 6] = [
    ([0, 1, 2], true),
    ([0, 2, 1], false),
    ([1, 0, 2], false),
    ([1, 2, 0], true),
    ([2, 0, 1], true),
    ([2, 1, 0], false),
];

impl TetMesh {
    /// Builds a mesh over the world-aligned box from `min` to `max` (mm) with about `target_nodes` nodes (at least 8),
    /// with cells as close to cubes as whole numbers of them allow.
    ///
    /// # Errors
    /// [`InvalidMesh::Box`] where the box has no volume or is not finite.
    pub fn over_box(min: [f64; 3], max: [f64; 3], target_nodes: usize) -> Result<TetMesh, InvalidMesh> {
        let mut box_to_world = Matrix4::identity();
        for axis in 0..3 {
            box_to_world[(axis, axis)] = max[axis] - min[axis];
            box_to_world[(axis, 3)] = min[axis];
        }
        TetMesh::over_affine_box(&box_to_world, target_nodes)
    }

    /// Builds a mesh over the image of the unit cube under `box_to_world` (affine, mm) with about `target_nodes` nodes
    /// (at least 8).
    ///
    /// # Errors
    /// [`InvalidMesh::Box`] where the box has no volume or is not finite.
    pub fn over_affine_box(box_to_world: &Matrix4<f64>, target_nodes: usize) -> Result<TetMesh, InvalidMesh> {
        let lengths: [f64; 3] = std::array::from_fn(|axis| box_to_world.fixed_view::<3, 1>(0, axis).norm());
        TetMesh::lattice(cells_for(lengths, target_nodes), box_to_world)
    }

    /// Builds a mesh of exactly `cells` lattice cells along the three edges of the image of the unit cube under
    /// `box_to_world`.
    ///
    /// # Errors
    /// [`InvalidMesh::Box`] where the box has no volume or is not finite, [`InvalidMesh::Cells`] for an axis without
    /// cells, [`InvalidMesh::TooMany`] where the nodes or elements outnumber 32-bit indices.
    pub fn lattice(cells: [usize; 3], box_to_world: &Matrix4<f64>) -> Result<TetMesh, InvalidMesh> {
        over_cells(cells, box_to_world, false)
    }

    /// Builds a mesh as [`TetMesh::lattice`] does, but with each cell the mirror image of its neighbours: the planes
    /// between cells are planes of symmetry, of which a lattice of equal cells has none, so that motion along them is
    /// not deflected by the mesh.
    ///
    /// # Errors
    /// As [`TetMesh::lattice`].
    pub fn mirrored_lattice(cells: [usize; 3], box_to_world: &Matrix4<f64>) -> Result<TetMesh, InvalidMesh> {
        over_cells(cells, box_to_world, true)
    }
}

fn over_cells(cells: [usize; 3], box_to_world: &Matrix4<f64>, mirrored: bool) -> Result<TetMesh, InvalidMesh> {
    let edges: [Vector3<f64>; 3] = std::array::from_fn(|axis| box_to_world.fixed_view::<3, 1>(0, axis).into_owned());
    let volume = edges[0].dot(&edges[1].cross(&edges[2]));
    let scale = edges[0].norm() * edges[1].norm() * edges[2].norm();
    let finite = box_to_world.iter().all(|x| x.is_finite());
    if !finite || !volume.is_finite() || volume.abs() <= 1e-12 * scale {
        return Err(InvalidMesh::Box {
            edges_mm: edges.map(Into::into),
        });
    }
    if cells.contains(&0) {
        return Err(InvalidMesh::Cells(cells));
    }
    let limit = (u32::MAX >> 1) as usize;
    let product = |counts: [usize; 3]| counts.iter().try_fold(1usize, |product, n| product.checked_mul(*n));
    let points = cells.map(|n| n.saturating_add(1));
    for (what, found) in [
        ("nodes", product(points)),
        ("tetrahedra", product(cells).and_then(|n| n.checked_mul(WALKS.len()))),
    ] {
        let found = found.unwrap_or(usize::MAX);
        if found > limit {
            return Err(InvalidMesh::TooMany { what, found, limit });
        }
    }
    let nodes = nodes(cells, box_to_world);
    let elements = elements(cells, points, volume > 0.0, mirrored);
    let regions = vec![0; elements.len()];
    TetMesh::new(nodes, elements, regions)
}

fn nodes(cells: [usize; 3], box_to_world: &Matrix4<f64>) -> Vec<[f64; 3]> {
    let mut nodes = Vec::with_capacity((cells[0] + 1) * (cells[1] + 1) * (cells[2] + 1));
    for k in 0..=cells[2] {
        for j in 0..=cells[1] {
            for i in 0..=cells[0] {
                let unit = Point3::new(
                    i as f64 / cells[0] as f64,
                    j as f64 / cells[1] as f64,
                    k as f64 / cells[2] as f64,
                );
                nodes.push(box_to_world.transform_point(&unit).into());
            }
        }
    }
    nodes
}

fn elements(cells: [usize; 3], points: [usize; 3], right_handed: bool, mirrored: bool) -> Vec<[u32; 4]> {
    let stride = [1, points[0], points[0] * points[1]];
    let mut elements = Vec::with_capacity(WALKS.len() * cells[0] * cells[1] * cells[2]);
    for k in 0..cells[2] {
        for j in 0..cells[1] {
            for i in 0..cells[0] {
                let cell = [i, j, k];
                // The walks of a mirrored cell begin at the other end of its edges.
                let turned = cell.map(|coordinate| mirrored && coordinate % 2 == 1);
                let first: usize = (0..3)
                    .map(|axis| (cell[axis] + usize::from(turned[axis])) * stride[axis])
                    .sum();
                let along = |node: usize, axis: usize| {
                    if turned[axis] {
                        node - stride[axis]
                    } else {
                        node + stride[axis]
                    }
                };
                let upright = turned.iter().filter(|turned| **turned).count() % 2 == 0;
                for (order, even) in WALKS {
                    let second = along(first, order[0]);
                    let third = along(second, order[1]);
                    let last = along(third, order[2]);
                    let mut corners = [first, second, third, last].map(|node| node as u32);
                    if (even == upright) != right_handed {
                        corners.swap(2, 3);
                    }
                    elements.push(corners);
                }
            }
        }
    }
    elements
}

/// Returns whole numbers of near-cubic cells whose lattice has about `target` points.
fn cells_for(lengths: [f64; 3], target: usize) -> [usize; 3] {
    let target = target.max(8) as f64;
    let cells = |edge: f64| lengths.map(|length| (length / edge).round().max(1.0));
    let points = |edge: f64| cells(edge).iter().map(|n| n + 1.0).product::<f64>();
    let longest = lengths.iter().fold(0.0f64, |a, b| a.max(*b));
    // The point count falls as the edge grows: bisect between far too many and the fewest, then take the closer side.
    let (mut fine, mut coarse) = (longest / target, longest);
    for _ in 0..64 {
        let middle = 0.5 * (fine + coarse);
        if points(middle) > target {
            fine = middle;
        } else {
            coarse = middle;
        }
    }
    let edge = if points(fine) - target < target - points(coarse) {
        fine
    } else {
        coarse
    };
    cells(edge).map(|n| n as usize)
}
