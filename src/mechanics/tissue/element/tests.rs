use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};

use super::*;

const CORNERS: [[f64; 3]; 4] = [[0.1, 0.2, -0.1], [1.3, 0.1, 0.2], [0.2, 1.1, 0.3], [0.4, 0.3, 1.7]];

/// Computes V B^T D B in Voigt notation with engineering shear strains, an independent formula of the stiffness.
fn by_voigt(corners: &[[f64; 3]; 4], young: f64, nu: f64) -> SMatrix<f64, 12, 12> {
    let columns = [1, 2, 3].map(|c: usize| Vector3::from(corners[c]) - Vector3::from(corners[0]));
    let jacobian = Matrix3::from_columns(&columns);
    let inverse = jacobian.try_inverse().unwrap();
    let rows = [inverse.row(0), inverse.row(1), inverse.row(2)];
    let mut b = SMatrix::<f64, 6, 12>::zeros();
    for corner in 0..4 {
        let g = match corner {
            0 => -(rows[0] + rows[1] + rows[2]),
            _ => rows[corner - 1].into_owned(),
        };
        for axis in 0..3 {
            b[(axis, 3 * corner + axis)] = g[axis];
        }
        for (row, (i, j)) in [(3, (0, 1)), (4, (1, 2)), (5, (0, 2))] {
            b[(row, 3 * corner + i)] = g[j];
            b[(row, 3 * corner + j)] = g[i];
        }
    }
    let mut d = Matrix6::zeros();
    for i in 0..3 {
        for j in 0..3 {
            d[(i, j)] = if i == j { 1.0 - nu } else { nu };
        }
        d[(i + 3, i + 3)] = 0.5 - nu;
    }
    d *= 1e-3 * young / ((1.0 + nu) * (1.0 - 2.0 * nu));
    b.transpose() * d * b * (jacobian.determinant() / 6.0)
}

#[test]
fn it_is_the_textbook_element() {
    for nu in [-0.4, 0.0, 0.3, 0.49] {
        let ElementStiffness(blocks) = element_stiffness(&CORNERS, &Material::new(7.0, nu).unwrap()).unwrap();
        let expected = by_voigt(&CORNERS, 7.0, nu);
        // Two formulas of a few dozen roundings each.
        let bound = 100.0 * f64::EPSILON * expected.amax();
        for (a, b, i, j) in indices() {
            assert!(
                (blocks[a][b][i][j] - expected[(3 * a + i, 3 * b + j)]).abs() < bound,
                "{nu} {a}{b}{i}{j}"
            );
        }
    }
}

fn indices() -> impl Iterator<Item = (usize, usize, usize, usize)> {
    (0..144).map(|n| (n / 36, n / 9 % 4, n / 3 % 3, n % 3))
}

#[test]
fn it_is_symmetric_bit_for_bit() {
    let ElementStiffness(blocks) = element_stiffness(&CORNERS, &Material::new(3.3, 0.41).unwrap()).unwrap();
    for (a, b, i, j) in indices() {
        assert_eq!(blocks[a][b][i][j].to_bits(), blocks[b][a][j][i].to_bits());
    }
}

#[test]
fn a_translation_is_free() {
    let ElementStiffness(blocks) = element_stiffness(&CORNERS, &Material::new(3.3, 0.45).unwrap()).unwrap();
    let largest = blocks
        .iter()
        .flatten()
        .flatten()
        .flatten()
        .fold(0.0, |a: f64, x| a.max(x.abs()));
    for a in 0..4 {
        for (i, j) in (0..9).map(|n| (n / 3, n % 3)) {
            let sum: f64 = (0..4).map(|b| blocks[a][b][i][j]).sum();
            assert!(sum.abs() < 10.0 * f64::EPSILON * largest);
        }
    }
}

#[test]
fn a_power_of_four_scales_bit_for_bit() {
    let material = Material::new(5.0, 0.45).unwrap();
    let ElementStiffness(once) = element_stiffness(&CORNERS, &material).unwrap();
    let ElementStiffness(large) = element_stiffness(&CORNERS.map(|c| c.map(|x| 64.0 * x)), &material).unwrap();
    for (a, b, i, j) in indices() {
        assert_eq!(64.0 * once[a][b][i][j], large[a][b][i][j]);
    }
}

#[test]
fn elements_without_volume_are_refused() {
    let material = Material::new(5.0, 0.45).unwrap();
    let mut inverted = CORNERS;
    inverted.swap(1, 2);
    let error = element_stiffness(&inverted, &material).unwrap_err();
    assert!(matches!(error, DegenerateElement::Inverted { volume_mm3 } if volume_mm3 < 0.0));
    for height in [0.0, 1e-11, -1e-11] {
        let flat = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.3, height]];
        let error = element_stiffness(&flat, &material).unwrap_err();
        assert!(matches!(error, DegenerateElement::Flat { .. }), "{height}: {error}");
    }
    let thin = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.3, 1e-8]];
    assert!(element_stiffness(&thin, &material).is_ok());
    let point = [[2.0; 3]; 4];
    assert_eq!(
        element_stiffness(&point, &material),
        Err(DegenerateElement::Flat { height: 0.0 })
    );
    let mut broken = CORNERS;
    broken[2][1] = f64::NAN;
    let error = element_stiffness(&broken, &material).unwrap_err();
    assert!(matches!(error, DegenerateElement::NotFinite { corner } if corner[1].is_nan()));
}

/// Forces from differences of displacements equal those of the stiffness, are zero for a translation of any size, and
/// sum to zero up to the rounding of their sum.
#[test]
fn forces_from_differences_are_those_of_the_stiffness_and_balance() {
    let material = Material::new(7.0, 0.45).unwrap();
    let ElementStiffness(blocks) = element_stiffness(&CORNERS, &material).unwrap();
    let shape = Shape::of(&CORNERS).unwrap();
    let moved: [[f64; 3]; 4] =
        std::array::from_fn(|a| std::array::from_fn(|i| ((5 * a + i) as f64).sin() + [1e3, -2e3, 5e2][i]));
    let forces = shape.forces(shape.weights(&material), &moved);
    let largest = forces.as_flattened().iter().fold(0.0, |a: f64, x| a.max(x.abs()));
    for (a, i) in (0..12).map(|n| (n / 3, n % 3)) {
        let terms = (0..12).map(|n| blocks[a][n / 3][i][n % 3] * moved[n / 3][n % 3]);
        let size: f64 = terms.clone().map(f64::abs).sum();
        assert!(
            (forces[a][i] - terms.sum::<f64>()).abs() < 100.0 * f64::EPSILON * size,
            "{a} {i}"
        );
    }
    for axis in 0..3 {
        let sum: f64 = forces.iter().map(|force| force[axis]).sum();
        assert!(sum.abs() <= 4.0 * f64::EPSILON * largest, "{sum:e}");
    }
    let away = [[1e6, -3e5, 7.0]; 4];
    assert_eq!(shape.forces(shape.weights(&material), &away), [[0.0; 3]; 4]);
}
