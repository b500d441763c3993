//! Tangents against finite differences, and assembled matrices against element-wise products.

use super::super::body::{NonlinearBody, Sheet};
use super::super::tangent::{Kind, Tangent};
use super::*;
use crate::tissue::factor::Symmetric;
use crate::tissue::law::Stiffening;
use crate::tissue::material::Material;
use crate::tissue::testing::value;
use insonify_mesh::TetMesh;

fn law() -> Stiffening {
    Stiffening::new(Material::new(10.0, 0.45).unwrap(), 0.1, 20.0).unwrap()
}

fn solid() -> NonlinearBody<3, 4> {
    let mesh = TetMesh::over_box([0.0; 3], [4.0, 4.0, 2.0], 36).unwrap();
    NonlinearBody::tetrahedra(&mesh, &vec![law(); mesh.elements().len()]).unwrap()
}

fn sheet() -> NonlinearBody<2, 3> {
    let nodes = vec![[0.0, 0.0], [2.0, 0.1], [4.0, -0.1], [0.1, 2.0], [1.8, 2.2], [4.1, 1.9]];
    let triangles = vec![[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]];
    Sheet::plane_strain(nodes, triangles, &[law(); 4], 1.5).unwrap()
}

/// Returns displacements that strain every element past the knee, an offset, and a direction.
fn fields(length: usize) -> [Vec<f64>; 3] {
    [(2, 0.6), (3, 0.2), (4, 1.0)].map(|(salt, size)| (0..length).map(|i| size * value(i, 0, salt)).collect())
}

/// Compares with central differences of forces, whose error is h^2 times the third derivative plus rounding over h.
fn derivative_is_consistent<const D: usize, const N: usize>(body: &NonlinearBody<D, N>, with_offset: bool) {
    let length = D * body.nodes().len();
    let [u, offset, direction] = fields(length);
    let offset = with_offset.then_some(&offset[..]);
    let mut responses = body.at_rest();
    let mut forces = [(); 3].map(|()| vec![0.0; length]);
    let h = 1e-5;
    for (forces, step) in forces.iter_mut().zip([-h, h, 0.0]) {
        let moved: Vec<f64> = u.iter().zip(&direction).map(|(u, v)| u + step * v).collect();
        body.respond(&moved, offset, forces, &mut responses);
    }
    assert!(responses.cells.iter().filter(|response| response.secant > 1.05).count() > body.elements().len() / 2);
    let mut product = vec![0.0; length];
    body.consistent(&responses, &direction, &mut product);
    let size = product.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
    for (dof, exact) in product.iter().enumerate() {
        let difference = (forces[1][dof] - forces[0][dof]) / (2.0 * h);
        assert!(
            (difference - exact).abs() < 1e-8 * size,
            "{exact} but {difference} at {dof} of {D} dimensions"
        );
    }
    // Kobayashi et al.'s tangent is not a derivative of this.
    body.scalar(&responses, &direction, &mut product);
    let differences = product
        .iter()
        .enumerate()
        .map(|(dof, x)| (x - (forces[1][dof] - forces[0][dof]) / (2.0 * h)).abs());
    assert!(differences.fold(0.0, f64::max) > 1e-3 * size);
}

#[test]
fn the_consistent_tangent_is_the_derivative() {
    for with_offset in [false, true] {
        derivative_is_consistent(&solid(), with_offset);
        derivative_is_consistent(&sheet(), with_offset);
    }
}

/// The matrix times a vector equals the element-wise product; for the consistent tangent, the mean of product and
/// transpose.
fn matrix_is_the_product<const D: usize, const N: usize>(body: &NonlinearBody<D, N>) {
    let nodes = body.nodes().len();
    let supports = Supports::<D>::new(nodes, [(0, 0), (0, 1), (1, 1), (nodes as u32 - 1, 0)]);
    let [u, _, _] = fields(D * nodes);
    let mut responses = body.at_rest();
    body.respond(&u, None, &mut vec![0.0; D * nodes], &mut responses);
    let mut matrix = Tangent::new(body.elements(), &supports).unwrap();
    let size = supports.free().len();
    let unit = |column: usize, kind: Kind| -> Vec<f64> {
        let mut unit = vec![0.0; D * nodes];
        unit[supports.free()[column] as usize] = 1.0;
        let mut product = vec![0.0; D * nodes];
        match kind {
            Kind::Scalar => body.scalar(&responses, &unit, &mut product),
            Kind::Consistent => body.consistent(&responses, &unit, &mut product),
        }
        supports.free().iter().map(|dof| product[*dof as usize]).collect()
    };
    for kind in [Kind::Scalar, Kind::Consistent] {
        matrix.fill(body, &responses, kind);
        let columns: Vec<Vec<f64>> = (0..size).map(|column| unit(column, kind)).collect();
        let scale = columns.iter().flatten().fold(0.0, |a: f64, x| a.max(x.abs()));
        let lower = matrix.lower();
        for (j, column) in columns.iter().enumerate() {
            for (i, entry) in column.iter().enumerate().skip(j) {
                let expected = 0.5 * (entry + columns[i][j]);
                let span = lower.col_ptr()[j] as usize..lower.col_ptr()[j + 1] as usize;
                let offset = lower.row_idx()[span.clone()].iter().position(|row| *row as usize == i);
                let entry = offset.map_or(0.0, |offset| lower.val()[span.start + offset]);
                assert!(
                    (entry - expected).abs() < 1e-13 * scale,
                    "{entry} but {expected} at {i}, {j}, {kind:?}"
                );
            }
        }
        let skew = (0..size)
            .flat_map(|i| (0..i).map(move |j| (i, j)))
            .map(|(i, j)| (columns[i][j] - columns[j][i]).abs());
        let skew = skew.fold(0.0, f64::max) / scale;
        // For tissue that is compressed and sheared, the asymmetry far exceeds rounding.
        assert_eq!(skew > 1e-3, kind == Kind::Consistent, "{skew} of {kind:?}");
    }
}

#[test]
fn matrices_are_the_products() {
    matrix_is_the_product(&solid());
    matrix_is_the_product(&sheet());
}
