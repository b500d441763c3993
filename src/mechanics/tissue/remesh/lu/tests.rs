use faer::Mat;
use faer::linalg::solvers::{DenseSolveCore, PartialPivLu};

use super::*;
use crate::tissue::testing::value;

fn random(size: usize, salt: u32) -> Mat<f64> {
    Mat::from_fn(size, size, |i, j| value(i, j, salt) + if i == j { 2.0 } else { 0.0 })
}

fn factored(matrix: &Mat<f64>) -> (Lu, f64) {
    let mut lu = Lu::default();
    lu.space(matrix.nrows()).copy_from(matrix);
    let condition = lu.factor();
    (lu, condition)
}

fn norm(matrix: MatRef<'_, f64>) -> f64 {
    norm_one(matrix)
}

#[test]
fn it_solves_with_a_matrix_and_with_its_transpose() {
    let mut lu = Lu::default();
    // The memory is reused by larger and smaller matrices in turn.
    for size in [1, 45, 7, 90] {
        let matrix = random(size, 1);
        lu.space(size).copy_from(&matrix);
        let reciprocal = lu.factor();
        let expected = Mat::from_fn(size, 3, |i, j| value(i, j, 2));
        for transpose in [false, true] {
            let a = if transpose { matrix.transpose() } else { matrix.as_ref() };
            let mut x = a * &expected;
            if transpose {
                lu.solve_transpose(x.as_mut())
            } else {
                lu.solve(x.as_mut())
            }
            // Forward error of a backward stable solution.
            let bound = 8.0 * size as f64 * f64::EPSILON / reciprocal;
            assert!((&x - &expected).norm_max() <= bound, "{size}, transpose {transpose}");
        }
    }
}

#[test]
fn the_condition_is_never_underestimated_much_and_never_overestimated() {
    for (size, salt) in [(1, 1), (8, 2), (45, 3), (120, 4)] {
        for scale in [1.0, 1e-6] {
            let mut matrix = random(size, salt);
            matrix[(0, 0)] *= scale;
            let (_, reciprocal) = factored(&matrix);
            let inverse = PartialPivLu::new(matrix.as_ref()).inverse();
            let truth = 1.0 / (norm(matrix.as_ref()) * norm(inverse.as_ref()));
            // The estimate is a lower bound of the condition, seldom off by more than a factor of three.
            let rounding = 1.0 + 8.0 * size as f64 * f64::EPSILON / truth;
            assert!(
                reciprocal * rounding >= truth && reciprocal <= 3.0 * truth,
                "{reciprocal} {truth}"
            );
        }
    }
}

#[test]
fn singular_and_undefined_matrices_have_no_digits() {
    let mut zero_row = random(9, 1);
    zero_row.row_mut(4).fill(0.0);
    let mut nan = random(9, 1);
    nan[(3, 5)] = f64::NAN;
    let mut infinite = random(9, 1);
    infinite[(3, 5)] = f64::INFINITY;
    for matrix in [zero_row, nan, infinite, Mat::zeros(3, 3)] {
        assert_eq!(factored(&matrix).1, 0.0);
    }
    assert_eq!(factored(&Mat::new()).1, 1.0, "nothing to solve");
    assert_eq!(factored(&Mat::identity(5, 5)).1, 1.0);
}

#[test]
fn the_capacitance_is_that_of_the_matrix_inversion_lemma() {
    let size = 12;
    // d has low rank and any sign, h is symmetric and positive definite.
    let half = Mat::from_fn(size, 4, |i, j| value(i, j, 1));
    let signs = Mat::from_fn(4, 4, |i, j| {
        if i != j {
            0.0
        } else if i % 2 == 0 {
            1.0
        } else {
            -0.3
        }
    });
    let mut d = &half * &signs * half.transpose();
    symmetrise(d.as_mut());
    let root = random(size, 2);
    let mut h = &root * root.transpose();
    symmetrise(h.as_mut());
    let mut computed = Mat::zeros(size, size);
    let mut lu = Lu::default();
    let reciprocal = capacitance(&mut lu, d.as_ref(), h.as_ref(), computed.as_mut());
    // (h^-1 + d)^-1 = h - h D h.
    let inverse = PartialPivLu::new(h.as_ref()).inverse();
    let expected = PartialPivLu::new((&inverse + &d).as_ref()).inverse();
    let updated = &h - &h * &computed * &h;
    let worst = norm(inverse.as_ref()) * norm(h.as_ref()) / reciprocal;
    assert!((&updated - &expected).norm_max() <= size as f64 * f64::EPSILON * worst * expected.norm_max());
    assert_eq!(computed, computed.transpose().to_owned());
    let nothing = capacitance(&mut lu, Mat::zeros(size, size).as_ref(), h.as_ref(), computed.as_mut());
    assert_eq!((nothing, computed.norm_max()), (1.0, 0.0));
    for size in [size, size + 1] {
        let undefined = Mat::from_fn(size, size, |_, _| f64::NAN);
        assert_eq!(
            capacitance(
                &mut lu,
                undefined.as_ref(),
                undefined.as_ref(),
                undefined.clone().as_mut()
            ),
            0.0
        );
    }
}
