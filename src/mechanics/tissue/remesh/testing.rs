//! Fixtures of the remeshing tests.

use std::sync::Arc;

use faer::linalg::solvers::{DenseSolveCore, Llt};
use faer::{Mat, Side};

use super::adapted::AdaptedMesh;
use crate::tissue::assembly::Stiffness;
use crate::tissue::dofs::NO_DOF;
use crate::tissue::symmetric::Symmetric;
use crate::tissue::testing::{Block, value};

/// Block of about 130 nodes, all at their base.
pub(super) fn adapted(poisson: f64) -> AdaptedMesh {
    let block = Block::new(130, poisson);
    AdaptedMesh::new(&block.mesh, &block.materials, &block.dofs).expect("a usable mesh")
}

/// Nodes without a fixed displacement.
pub(super) fn free_nodes(mesh: &AdaptedMesh) -> Vec<u32> {
    let nodes = 0..mesh.nodes().len() as u32;
    nodes.filter(|node| !mesh.dofs().of(*node).contains(&NO_DOF)).collect()
}

/// Free nodes whose neighbours are all free, near the middle.
pub(crate) fn inner_nodes(mesh: &AdaptedMesh) -> Vec<u32> {
    let free = free_nodes(mesh);
    let is_inner = |node: &u32| mesh.neighbours(*node).iter().all(|neighbour| free.contains(neighbour));
    free.iter().copied().filter(is_inner).collect()
}

/// Returns a position up to 1.5 mm along each axis from the node's base.
pub(super) fn nearby(mesh: &AdaptedMesh, node: u32, salt: u32) -> [f64; 3] {
    let base = mesh.base()[node as usize];
    std::array::from_fn(|axis| base[axis] + 1.5 * value(node as usize, axis, salt))
}

/// Returns a stiffness as a dense matrix.
pub(super) fn dense(stiffness: &Stiffness) -> Mat<f64> {
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

/// Assembles the stiffness of the current mesh.
pub(super) fn current(mesh: &AdaptedMesh) -> Mat<f64> {
    dense(&mesh.stiffness().at_nodes(mesh.nodes()).expect("a usable mesh"))
}

/// Computes the inverse of the stiffness of the current mesh by a dense Cholesky factorisation.
pub(super) fn gold(mesh: &AdaptedMesh) -> Mat<f64> {
    Llt::new(current(mesh).as_ref(), Side::Lower)
        .expect("positive definite")
        .inverse()
}

/// Computes the inverse of the base in its stored form.
pub(super) fn inverse(mesh: &AdaptedMesh) -> Arc<Symmetric<f64>> {
    let base = Llt::new(dense(mesh.stiffness()).as_ref(), Side::Lower)
        .expect("positive definite")
        .inverse();
    Arc::new(Symmetric::from_fn(base.nrows(), |i, j| base[(i, j)]))
}

/// Returns the largest difference relative to the largest entry of `expected`.
pub(super) fn error(computed: &Mat<f64>, expected: &Mat<f64>) -> f64 {
    (computed - expected).norm_max() / expected.norm_max()
}

/// Returns the largest difference of two inverses that are each backward stable, relative to the largest entry: twice
/// the rounding unit times |K|_inf |K^-1|_inf, an upper bound of the condition (N. J. Higham, "Accuracy and Stability
/// of Numerical Algorithms", section 14).
pub(super) fn rounding(mesh: &AdaptedMesh, gold: &Mat<f64>) -> f64 {
    let rows = |matrix: &Mat<f64>| -> f64 {
        let sums = matrix.row_iter().map(|row| row.iter().map(|x| x.abs()).sum());
        sums.fold(0.0, f64::max)
    };
    2.0 * f64::EPSILON * rows(&current(mesh)) * rows(gold)
}

/// Free degrees of freedom of nodes.
pub(crate) fn dofs_of(mesh: &AdaptedMesh, nodes: &[u32]) -> Vec<usize> {
    let dofs = nodes.iter().flat_map(|node| mesh.dofs().of(*node));
    dofs.filter(|dof| *dof != NO_DOF).map(|dof| dof as usize).collect()
}

/// Extracts the entries at rows and columns.
pub(super) fn part(matrix: &Mat<f64>, rows: &[usize], columns: &[usize]) -> Mat<f64> {
    Mat::from_fn(rows.len(), columns.len(), |i, j| matrix[(rows[i], columns[j])])
}
