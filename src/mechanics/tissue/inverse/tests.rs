use crate::tissue::error::LinearError;
use nalgebra::DMatrix;

use super::*;
use crate::tissue::testing::{Block, on_threads};

fn dense(stiffness: &Stiffness) -> DMatrix<f64> {
    let size = stiffness.dofs().free();
    let mut matrix = DMatrix::zeros(size, size);
    let mut unit = vec![0.0; size];
    for j in 0..size {
        unit[j] = 1.0;
        stiffness.multiply(&unit, matrix.column_mut(j).as_mut_slice());
        unit[j] = 0.0;
    }
    matrix
}

fn inverted<T: Scalar>(block: &Block) -> Symmetric<T> {
    invert(&block.factor, &mut |_, _| ()).expect("an inverse")
}

/// Bounds |K x - e| for x by Cholesky: gamma_{3n+1} | |L| |L^T| | |x| in 2-norms, where the factor's norm is at most
/// the sum of the squares of L, the trace of K (Higham, Accuracy and Stability of Numerical Algorithms, theorem 10.4).
fn residual_bound(stiffness: &Stiffness, column: &[f64]) -> f64 {
    let size = column.len();
    let lower = stiffness.lower();
    let trace: f64 = (0..size).map(|j| lower.get(j, j).copied().unwrap_or(0.0)).sum();
    let length = column.iter().map(|x| x * x).sum::<f64>().sqrt();
    1.01 * (3 * size + 1) as f64 * (f64::EPSILON / 2.0) * trace * length
}

#[test]
fn it_is_the_inverse_of_an_independent_dense_one() {
    for poisson in [0.3, 0.45, 0.499] {
        let block = Block::new(200, poisson);
        let stiffness = dense(&block.stiffness);
        let inverse = inverted::<f64>(&block);
        let size = inverse.size();
        assert!(size > PANEL_ROWS, "{size} rows are one panel");
        let expected = stiffness.clone().try_inverse().expect("an inverse");
        let condition = stiffness.norm() * expected.norm();
        // Both have errors of a few n eps times the condition (Higham, section 14.3).
        let bound = 10.0 * size as f64 * f64::EPSILON * condition * expected.norm();
        let computed = DMatrix::from_fn(size, size, |i, j| inverse.get(i, j));
        assert!((&computed - &expected).norm() <= bound, "nu {poisson}");
        let pivots = computed.cholesky().expect("positive definite").l().diagonal();
        assert!(
            pivots.min().powi(2) > 0.0,
            "nu {poisson}: smallest pivot {:e}",
            pivots.min().powi(2)
        );
    }
}

#[test]
fn its_columns_solve_for_unit_forces() {
    let block = Block::new(600, 0.45);
    let mut inverse = inverted::<f64>(&block);
    let size = inverse.size();
    let mut column = vec![0.0; size];
    for dof in [0, 1, PANEL_ROWS - 1, PANEL_ROWS, size / 2, size - 1] {
        inverse.column_into(dof, &mut column).expect("a column");
        let bound = residual_bound(&block.stiffness, &column);
        let residual = sampled_residual(&block.stiffness, &mut inverse, &[dof]).expect("a residual");
        assert!(
            residual > 0.0 && residual <= bound,
            "column {dof}: {residual:e} > {bound:e}"
        );
    }
}

#[test]
fn single_precision_is_the_double_one_rounded_once() {
    let block = Block::new(600, 0.45);
    let [wide, mut narrow] = [inverted::<f64>(&block).cast(), inverted::<f32>(&block)];
    assert_eq!(narrow, wide);
    // Rounding the entries changes K x by at most u |K| |x| in maximum norms.
    let mut column = vec![0.0; narrow.size()];
    for dof in [0, 300, narrow.size() - 1] {
        Compliance::column_into(&mut narrow, dof, &mut column).expect("a column");
        let largest = column.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        let rounding = f64::from(f32::EPSILON) / 2.0 * block.stiffness.norm_inf() * largest;
        let bound = rounding + residual_bound(&block.stiffness, &column);
        let residual = sampled_residual(&block.stiffness, &mut narrow, &[dof]).expect("a residual");
        assert!(residual <= bound, "column {dof}: {residual:e} > {bound:e}");
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let block = Block::new(600, 0.45);
    let on_one = on_threads(1, || inverted::<f64>(&block));
    for threads in [2, 3] {
        assert_eq!(
            on_threads(threads, || inverted::<f64>(&block)),
            on_one,
            "{threads} threads"
        );
    }
}

#[test]
fn progress_ascends_to_the_end() {
    let block = Block::new(600, 0.45);
    let mut seen = Vec::new();
    on_threads(3, || {
        invert::<f32>(&block.factor, &mut |done, total| seen.push((done, total)))
    })
    .expect("an inverse");
    let size = block.dofs.free();
    assert_eq!(seen.len(), size.div_ceil(PANEL_ROWS));
    assert!(seen.windows(2).all(|pair| pair[0].0 < pair[1].0), "{seen:?}");
    assert!(seen.iter().all(|&(_, total)| total == size));
    assert_eq!(seen.last(), Some(&(size, size)));
}

#[test]
fn what_exceeds_the_memory_is_refused_with_what_it_needs() {
    let size = 30_000;
    let error = check_memory_of::<f64>(size, 2, Some(1 << 30)).expect_err("3.6 GB in 1 GiB");
    let LinearError::InverseMemory { needed, available, .. } = error else {
        panic!("{error}");
    };
    assert_eq!(available, 1 << 30);
    assert!(
        needed > size * size / 2 * 8 && needed < size * size / 2 * 8 * 11 / 10,
        "{needed}"
    );
    let text = error.to_string();
    assert!(
        text.contains("3.4 GiB") && text.contains("1.0 GiB") && text.contains("columns on demand"),
        "{text}"
    );
    assert_eq!(check_memory_of::<f64>(size, 2, Some(needed)), Ok(()));
    assert_eq!(check_memory_of::<f64>(size, 2, None), Ok(()));
    assert!(check_memory_of::<f64>(usize::MAX, 2, Some(1 << 40)).is_err());
}

#[test]
fn a_residual_tells_a_wrong_inverse() {
    let block = Block::new(200, 0.45);
    let mut inverse = inverted::<f64>(&block);
    let mut singular = inverted::<f64>(&Block::new(200, 0.3));
    let dofs = [3, 100];
    let [good, bad] =
        [&mut inverse, &mut singular].map(|x| sampled_residual(&block.stiffness, x, &dofs).expect("sizes"));
    assert!(good < 1e-9 && bad > 1e-2, "{good:e}, {bad:e}");
    let mut undefined = Symmetric::from_fn(inverse.size(), |i, _| if i == 3 { f64::NAN } else { 0.0 });
    assert!(
        sampled_residual(&block.stiffness, &mut undefined, &dofs)
            .expect("sizes")
            .is_nan()
    );
    let short = sampled_residual(&block.stiffness, &mut Symmetric::<f64>::zeros(3), &dofs);
    assert!(matches!(short, Err(LinearError::Shape { found: 3, .. })), "{short:?}");
}
