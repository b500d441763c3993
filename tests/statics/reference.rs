//! Stiffness and energy written another way than the solver's: strains in Voigt's order, gradients from the inverse of
//! the matrix of homogeneous corner coordinates, everything dense.

use insonify_mechanics::tissue::material::Material;
use insonify_mesh::TetMesh;
use nalgebra::{DMatrix, Matrix4, SMatrix, SVector};

const NEWTON_PER_MM2: f64 = 1e-3;

/// Strain (xx, yy, zz, yz, zx, xy, shears doubled) per displacement of the corners, and the volume, mm^3.
fn strain_matrix(corners: [[f64; 3]; 4]) -> (SMatrix<f64, 6, 12>, f64) {
    let homogeneous = Matrix4::from_fn(|row, column| if column == 0 { 1.0 } else { corners[row][column - 1] });
    let volume = homogeneous.determinant() / 6.0;
    let coefficients = homogeneous.try_inverse().unwrap();
    let mut strain = SMatrix::<f64, 6, 12>::zeros();
    for corner in 0..4 {
        let [x, y, z] = [1, 2, 3].map(|row| coefficients[(row, corner)]);
        let columns = [
            [x, 0.0, 0.0, 0.0, z, y],
            [0.0, y, 0.0, z, 0.0, x],
            [0.0, 0.0, z, y, x, 0.0],
        ];
        for (axis, column) in columns.into_iter().enumerate() {
            strain.set_column(3 * corner + axis, &SVector::from(column));
        }
    }
    (strain, volume)
}

/// Stress per strain, N/mm^2.
fn elasticity(material: &Material) -> SMatrix<f64, 6, 6> {
    let (young, poisson) = (material.young_kpa() * NEWTON_PER_MM2, material.poisson());
    // The compliance in engineering constants.
    let mut compliance = SMatrix::<f64, 6, 6>::zeros();
    for i in 0..3 {
        for j in 0..3 {
            compliance[(i, j)] = if i == j { 1.0 / young } else { -poisson / young };
        }
        compliance[(3 + i, 3 + i)] = 2.0 * (1.0 + poisson) / young;
    }
    compliance.try_inverse().unwrap()
}

fn corners(mesh: &TetMesh, element: usize) -> [[f64; 3]; 4] {
    mesh.elements()[element].map(|node| mesh.nodes()[node as usize])
}

/// The stiffness over all degrees of freedom, N/mm.
pub(super) fn stiffness(mesh: &TetMesh, materials: &[Material]) -> DMatrix<f64> {
    let size = 3 * mesh.nodes().len();
    let mut dense = DMatrix::zeros(size, size);
    for (element, nodes) in mesh.elements().iter().enumerate() {
        let (strain, volume) = strain_matrix(corners(mesh, element));
        let block = strain.transpose() * elasticity(&materials[element]) * strain * volume;
        for i in 0..12 {
            for j in 0..12 {
                let place = |k: usize| 3 * nodes[k / 3] as usize + k % 3;
                dense[(place(i), place(j))] += block[(i, j)];
            }
        }
    }
    dense
}

/// The strain energy of displacements of all nodes, N mm.
pub(super) fn energy(mesh: &TetMesh, materials: &[Material], displacement_mm: &[[f64; 3]]) -> f64 {
    let of = |(element, nodes): (usize, &[u32; 4])| {
        let (strain, volume) = strain_matrix(corners(mesh, element));
        let moved = SVector::<f64, 12>::from_fn(|k, _| displacement_mm[nodes[k / 3] as usize][k % 3]);
        let strain = strain * moved;
        0.5 * volume * strain.dot(&(elasticity(&materials[element]) * strain))
    };
    mesh.elements().iter().enumerate().map(of).sum()
}
