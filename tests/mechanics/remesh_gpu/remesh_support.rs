//! Small meshes, sequences of moves, and the gold standard.

use std::sync::Arc;

use faer::linalg::solvers::{DenseSolveCore, Llt};
use faer::{Mat, MatRef, Side};
use insonify_mechanics::tissue::assembly::Stiffness;
use insonify_mechanics::tissue::dofs::{Dofs, NO_DOF};
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::remesh::{AdaptedMesh, Source};
use insonify_mechanics::tissue::symmetric::Symmetric;
use insonify_mesh::TetMesh;

/// Edges of the lattice cells, mm.
const CELL: f64 = 5.0;

/// A hash of an integer in [-1, 1).
pub(super) fn noise(n: u64) -> f64 {
    let mut x = n.wrapping_add(0x9e37_79b9_7f4a_7c15);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// A jittered block of 6 x 5 x 5 nodes, its bottom fixed, of Poisson's ratio `poisson`.
pub(super) fn mesh(poisson: f64) -> AdaptedMesh {
    let cells = [5, 4, 4];
    let lattice = TetMesh::over_box([0.0; 3], cells.map(|n| f64::from(n) * CELL), 6 * 5 * 5).unwrap();
    assert_eq!(lattice.nodes().len(), 6 * 5 * 5);
    let jittered = lattice.nodes().iter().enumerate().map(|(node, position)| {
        std::array::from_fn(|axis| {
            let inside = position[axis] > 0.0 && position[axis] < f64::from(cells[axis]) * CELL;
            let shift = if inside {
                0.12 * CELL * noise((3 * node + axis) as u64)
            } else {
                0.0
            };
            position[axis] + shift
        })
    });
    let mesh = TetMesh::new(
        jittered.collect(),
        lattice.elements().to_vec(),
        lattice.regions().to_vec(),
    )
    .unwrap();
    let bottom = (0..mesh.nodes().len() as u32).filter(|node| mesh.nodes()[*node as usize][2] == 0.0);
    let fixed = bottom.flat_map(|node| [0, 1, 2].map(|axis| (node, axis)));
    let dofs = Dofs::new(mesh.nodes().len(), fixed);
    let materials = vec![Material::new(10.0, poisson).unwrap(); mesh.elements().len()];
    AdaptedMesh::new(&mesh, &materials, &dofs).unwrap()
}

/// The inverse of the stiffness assembled from the current positions, by a dense Cholesky factorisation.
pub(super) fn gold(mesh: &AdaptedMesh) -> Mat<f64> {
    let stiffness = mesh.stiffness().at_nodes(mesh.nodes()).unwrap();
    Llt::new(dense(&stiffness).as_ref(), Side::Lower).unwrap().inverse()
}

/// All entries.
fn dense(stiffness: &Stiffness) -> Mat<f64> {
    let size = stiffness.dofs().free();
    let mut matrix = Mat::zeros(size, size);
    let lower = stiffness.lower();
    for column in 0..size {
        for (row, value) in lower.row_idx_of_col(column).zip(lower.val_of_col(column)) {
            matrix[(row, column)] = *value;
            matrix[(column, row)] = *value;
        }
    }
    matrix
}

/// The same in f32.
pub(super) fn single(mesh: &AdaptedMesh) -> Source {
    Source::Single(Arc::new(symmetric(gold(mesh).as_ref()).cast()))
}

fn symmetric(matrix: MatRef<'_, f64>) -> Symmetric<f64> {
    Symmetric::from_fn(matrix.nrows(), |i, j| matrix[(i, j)])
}

/// Nodes without a fixed displacement.
pub(super) fn free_nodes(mesh: &AdaptedMesh) -> Vec<u32> {
    let nodes = 0..mesh.nodes().len() as u32;
    nodes.filter(|node| !mesh.dofs().of(*node).contains(&NO_DOF)).collect()
}

/// A node and where to move it, the `n`th of a sequence: up to 0.25 cells from its base along each axis.
pub(super) fn nth_move(mesh: &AdaptedMesh, nodes: &[u32], n: u64) -> (u32, [f64; 3]) {
    let node = nodes[((noise(7 * n) + 1.0) * 0.5 * nodes.len() as f64) as usize];
    let base = mesh.base()[node as usize];
    (
        node,
        std::array::from_fn(|axis| base[axis] + 0.25 * CELL * noise(1_000_003 * n + axis as u64)),
    )
}

/// Ten nodes' degrees of freedom to be contacts, some of them moved by the sequences and some not.
pub(super) fn contacts(mesh: &AdaptedMesh) -> Vec<usize> {
    let nodes = free_nodes(mesh);
    let every = nodes.iter().step_by(nodes.len() / 10).take(10);
    every
        .flat_map(|node| mesh.dofs().of(*node))
        .map(|dof| dof as usize)
        .collect()
}

/// Entries at rows and columns.
pub(super) fn part(matrix: MatRef<'_, f64>, rows: &[usize], columns: &[usize]) -> Mat<f64> {
    Mat::from_fn(rows.len(), columns.len(), |i, j| matrix[(rows[i], columns[j])])
}

/// The largest difference over the largest entry of the second.
pub(super) fn error(found: MatRef<'_, f64>, expected: MatRef<'_, f64>) -> f64 {
    (found.to_owned() - expected).norm_max() / expected.norm_max()
}

/// Bound on the difference of two backward stable inverses, relative to the largest entry: twice the rounding unit
/// times `|K|_inf |K^-1|_inf`, an upper bound of the condition of the mesh's stiffness now (N. J. Higham, "Accuracy and
/// Stability of Numerical Algorithms", section 14).
pub(super) fn rounding(mesh: &AdaptedMesh, gold: MatRef<'_, f64>) -> f64 {
    let stiffness = mesh.stiffness().at_nodes(mesh.nodes()).unwrap();
    let sums = gold.row_iter().map(|row| row.iter().map(|x| x.abs()).sum::<f64>());
    2.0 * f64::EPSILON * stiffness.norm_inf() * sums.fold(0.0, f64::max)
}
