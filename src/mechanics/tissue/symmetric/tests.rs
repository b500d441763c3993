use crate::tissue::error::LinearError;
use faer::Mat;
use nalgebra::DMatrix;

use super::*;
use crate::tissue::compliance::Compliance;
use crate::tissue::testing::{on_threads, value};

/// Sizes around a panel's edge, and around the eight columns of a tile.
const SIZES: [usize; 8] = [1, 2, 7, 127, 128, 129, 300, 517];

fn symmetric<T: Scalar>(size: usize, salt: u32) -> Symmetric<T> {
    Symmetric::from_fn(size, |i, j| T::of(value(i, j, salt)))
}

fn full<T: Scalar>(matrix: &Symmetric<T>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.size(), matrix.size(), |i, j| matrix.get(i, j).wide())
}

/// Returns Y and C of an update.
fn operands<T: Scalar>(size: usize, rank: usize) -> (Mat<T>, Mat<T>) {
    (
        Mat::from_fn(size, rank, |i, k| T::of(value(i, k, 7))),
        Mat::from_fn(rank, rank, |i, k| T::of(value(i.max(k), i.min(k), 8))),
    )
}

fn dense<T: Scalar>(matrix: &Mat<T>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)].wide())
}

/// Bounds the error of a product of `terms` terms whose absolute values sum to `magnitude`: gamma_n of Higham, Accuracy
/// and Stability of Numerical Algorithms, section 3.1, with a margin for the second order.
fn rounding<T: Scalar>(terms: usize, magnitude: f64) -> f64 {
    let unit = T::epsilon().wide() / 2.0;
    1.01 * terms as f64 * unit * magnitude
}

#[test]
fn an_entry_is_its_own_mirror_image_and_columns_are_rows() {
    for size in SIZES {
        let mut matrix = symmetric::<f64>(size, 1);
        let mut column = vec![0.0; size];
        for j in [0, size / 2, size - 1] {
            matrix.column_into(j, &mut column).expect("a column");
            for i in 0..size {
                assert_eq!(column[i], value(i.max(j), i.min(j), 1), "({i}, {j}) of {size}");
                assert_eq!(matrix.get(i, j), matrix.get(j, i));
            }
            let block = matrix.entries(&[j, 0], &[size - 1]).expect("entries");
            assert_eq!(block[(0, 0)], matrix.get(j, size - 1));
            assert_eq!(block[(1, 0)], matrix.get(0, size - 1));
        }
    }
}

#[test]
fn half_the_memory_of_a_full_matrix_and_known_beforehand() {
    for size in SIZES {
        assert_eq!(Symmetric::<f32>::zeros(size).bytes(), Symmetric::<f32>::bytes_of(size));
    }
    // Above the diagonal: at most half a panel per row, and the padding of the last panel.
    let [size, rows] = [9834, PANEL_ROWS];
    let triangle = size * (size + 1) / 2 * 8;
    let bytes = Symmetric::<f64>::bytes_of(size);
    assert!(
        bytes >= triangle && bytes <= triangle + (size * rows / 2 + size * rows) * 8,
        "{bytes}"
    );
    assert_eq!(Symmetric::<f64>::zeros(0).bytes(), 0);
    assert_eq!(Symmetric::<f64>::bytes_of(usize::MAX), usize::MAX);
}

fn check_rank_update<T: Scalar>() {
    for size in SIZES {
        for rank in [1, 3, 48] {
            let (y, c) = operands::<T>(size, rank);
            let mut matrix = symmetric::<T>(size, 1);
            let before = full(&matrix);
            matrix.rank_update(y.as_ref(), c.as_ref()).expect("an update");
            let [y, c] = [dense(&y), dense(&c)];
            let expected = &before - &y * &c * y.transpose();
            let magnitude = before.abs() + y.abs() * c.abs() * y.abs().transpose();
            let updated = full(&matrix);
            for i in 0..size {
                for j in 0..=i {
                    let error = (updated[(i, j)] - expected[(i, j)]).abs();
                    // The reference also rounds, in f64.
                    let terms = 2 * rank + 1;
                    let bound = rounding::<T>(terms, magnitude[(i, j)]) + rounding::<f64>(terms, magnitude[(i, j)]);
                    assert!(
                        error <= bound,
                        "({i}, {j}) of {size}, rank {rank}: {error:e} > {bound:e}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_rank_update_is_that_of_a_full_matrix_in_f64() {
    check_rank_update::<f64>();
}

#[test]
fn a_rank_update_is_that_of_a_full_matrix_in_f32() {
    check_rank_update::<f32>();
}

#[test]
fn an_update_of_rank_zero_or_by_zero_changes_no_bit() {
    let mut matrix = symmetric::<f64>(300, 1);
    let before = matrix.clone();
    let (y, _) = operands::<f64>(300, 5);
    matrix
        .rank_update(Mat::zeros(300, 0).as_ref(), Mat::zeros(0, 0).as_ref())
        .expect("an update");
    matrix
        .rank_update(y.as_ref(), Mat::zeros(5, 5).as_ref())
        .expect("an update");
    matrix
        .update_rows(&[], y.as_ref(), operands(300, 5).1.as_ref())
        .expect("an update");
    matrix
        .update_rows(&[4], y.as_ref(), Mat::zeros(5, 5).as_ref())
        .expect("an update");
    assert_eq!(matrix, before);
}

#[test]
fn updated_rows_are_those_of_a_full_update_and_others_stay() {
    for (size, rows) in [
        (1, vec![0]),
        (129, vec![128, 0]),
        (517, vec![300, 3, 4, 5, 127, 128, 516, 301]),
    ] {
        let (y, c) = operands::<f64>(size, 24);
        let start = symmetric::<f64>(size, 1);
        let [mut some_rows, mut all_rows] = [start.clone(), start.clone()];
        some_rows.update_rows(&rows, y.as_ref(), c.as_ref()).expect("an update");
        all_rows.rank_update(y.as_ref(), c.as_ref()).expect("an update");
        let [wide_y, wide_c] = [dense(&y), dense(&c)];
        let magnitude = full(&start).abs() + wide_y.abs() * wide_c.abs() * wide_y.abs().transpose();
        for i in 0..size {
            for j in 0..size {
                if rows.contains(&i) || rows.contains(&j) {
                    let error = (some_rows.get(i, j) - all_rows.get(i, j)).abs();
                    let bound = 2.0 * rounding::<f64>(2 * 24 + 1, magnitude[(i, j)]);
                    assert!(error <= bound, "({i}, {j}) of {size}: {error:e} > {bound:e}");
                } else {
                    assert_eq!(some_rows.get(i, j), start.get(i, j), "({i}, {j}) of {size}");
                }
            }
        }
    }
}

fn check_multiply<T: Scalar>() {
    for size in SIZES.into_iter().chain([3000]) {
        let matrix = symmetric::<T>(size, 1);
        let x: Vec<T> = (0..size).map(|i| T::of(value(i, 0, 9))).collect();
        let mut y = vec![T::of(f64::NAN); size];
        matrix.multiply(&x, &mut y).expect("a product");
        let [mut expected, mut magnitude] = [vec![0.0; size], vec![0.0; size]];
        for i in 0..size {
            for j in 0..size {
                let term = matrix.get(i, j).wide() * x[j].wide();
                expected[i] += term;
                magnitude[i] += term.abs();
            }
        }
        for i in 0..size {
            let error = (y[i].wide() - expected[i]).abs();
            let bound = rounding::<T>(size + 1, magnitude[i]) + rounding::<f64>(size, magnitude[i]);
            assert!(error <= bound, "row {i} of {size}: {error:e} > {bound:e}");
        }
    }
}

#[test]
fn a_product_is_that_of_a_full_matrix() {
    check_multiply::<f64>();
    check_multiply::<f32>();
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let (y, c) = operands::<f32>(1000, 48);
    let run = || {
        let mut matrix = symmetric::<f32>(1000, 1);
        matrix.rank_update(y.as_ref(), c.as_ref()).expect("an update");
        matrix
            .update_rows(&[700, 701, 702], y.as_ref(), c.as_ref())
            .expect("an update");
        let x: Vec<f32> = (0..1000).map(|i| value(i, 0, 9) as f32).collect();
        let mut product = vec![0.0; 1000];
        matrix.multiply(&x, &mut product).expect("a product");
        (matrix, product)
    };
    let on_one = on_threads(1, run);
    for threads in [2, 3] {
        assert!(on_threads(threads, run) == on_one, "{threads} threads");
    }
}

#[test]
fn a_cast_rounds_each_entry_once() {
    let wide = symmetric::<f64>(300, 1);
    assert_eq!(
        wide.cast::<f32>(),
        Symmetric::from_fn(300, |i, j| wide.get(i, j) as f32)
    );
}

#[test]
fn operands_that_do_not_fit_are_refused_and_change_nothing() {
    let mut matrix = symmetric::<f64>(20, 1);
    let before = matrix.clone();
    let (y, c) = operands::<f64>(20, 3);
    let shape = |what, found, expected| Err(LinearError::Shape { what, found, expected });
    let short = y.as_ref().subrows(0, 19);
    assert_eq!(matrix.rank_update(short, c.as_ref()), shape("rows of Y", 19, 20));
    assert_eq!(
        matrix.rank_update(y.as_ref(), c.as_ref().subrows(0, 2)),
        shape("rows of C", 2, 3)
    );
    assert_eq!(
        matrix.rank_update(y.as_ref(), c.as_ref().subcols(0, 2)),
        shape("columns of C", 2, 3)
    );
    let outside = LinearError::OutOfRange { dof: 20, size: 20 };
    assert_eq!(matrix.update_rows(&[20], y.as_ref(), c.as_ref()), Err(outside.clone()));
    let twice = LinearError::Repeated { dof: 5 };
    assert_eq!(matrix.update_rows(&[5, 1, 5], y.as_ref(), c.as_ref()), Err(twice));
    assert_eq!(
        Compliance::column_into(&mut matrix, 20, &mut [0.0; 20]),
        Err(outside.clone())
    );
    assert_eq!(matrix.column_into(0, &mut [0.0; 3]), shape("rows of the column", 3, 20));
    assert_eq!(matrix.multiply(&[0.0; 3], &mut [0.0; 20]), shape("values of x", 3, 20));
    assert_eq!(matrix.multiply(&[0.0; 20], &mut [0.0; 2]), shape("values of y", 2, 20));
    assert_eq!(matrix.entries(&[0], &[20]).err(), Some(outside.clone()));
    assert_eq!(matrix.prefetch(&[3, 20]), Err(outside.clone()));
    assert_eq!(matrix, before);
}
