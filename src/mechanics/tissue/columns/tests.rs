use super::*;
use crate::tissue::error::LinearError;
use crate::tissue::inverse::{invert, sampled_residual};
use crate::tissue::symmetric::Symmetric;
use crate::tissue::testing::Block;

fn kept(columns: &Columns) -> Vec<usize> {
    let dofs: Vec<usize> = (0..columns.size()).filter(|dof| columns.holds(*dof)).collect();
    assert_eq!(dofs.len(), columns.len());
    dofs
}

#[test]
fn columns_and_entries_are_those_of_the_dense_inverse() {
    let block = Block::new(300, 0.45);
    let mut dense: Symmetric<f64> = invert(&block.factor, &mut |_, _| ()).expect("an inverse");
    let mut columns = Columns::new(block.factor.clone(), 50);
    let size = columns.size();
    let mut expected = vec![0.0; size];
    let residual = sampled_residual(&block.stiffness, &mut columns, &[0, 7, size - 1]).expect("columns");
    // Both solve the same factor: they differ by the rounding of a triangular solve, n eps |K| |x| in the residual,
    // times the norm of the inverse, which the sum of its largest column estimates.
    let norm: f64 = (0..size).map(|j| dense.get(j, j)).sum();
    let bound = size as f64 * f64::EPSILON * block.stiffness.norm_inf() * norm * norm;
    for dof in [0, 7, size - 1] {
        dense.column_into(dof, &mut expected).expect("a column");
        for (value, expected) in columns.column(dof).expect("a column").iter().zip(&expected) {
            assert!((value - expected).abs() <= bound, "{value} {expected}");
        }
    }
    assert!(
        residual < size as f64 * f64::EPSILON * block.stiffness.norm_inf() * norm,
        "{residual:e}"
    );
    let (rows, sides) = ([5, 7, 300, 5], [size - 1, 7, 0]);
    let block = columns.entries(&rows, &sides).expect("entries");
    let expected = dense.entries(&rows, &sides).expect("entries");
    for i in 0..rows.len() {
        for j in 0..sides.len() {
            assert!((block[(i, j)] - expected[(i, j)]).abs() <= bound);
        }
    }
}

#[test]
fn what_is_kept_is_not_solved_again_and_the_longest_unused_is_forgotten() {
    let block = Block::new(100, 0.45);
    let mut columns = Columns::new(block.factor.clone(), 3);
    columns.prefetch(&[1, 2, 3, 2]).expect("columns");
    assert_eq!((kept(&columns), columns.solved(), columns.len()), (vec![1, 2, 3], 3, 3));
    assert_eq!(columns.bytes(), (3 * columns.size() + block.factor.entries()) * 8);
    columns.column(1).expect("a column");
    assert_eq!(columns.solved(), 3);
    columns.column(4).expect("a column");
    assert_eq!((kept(&columns), columns.solved()), (vec![1, 2, 4], 4));
    columns.column(5).expect("a column");
    assert_eq!(kept(&columns), [1, 4, 5]);
    columns.prefetch(&[8, 1, 7, 6]).expect("columns");
    assert_eq!(kept(&columns), [1, 7, 8]);
}

#[test]
fn entries_come_from_the_side_with_less_to_solve_and_need_not_fit_the_capacity() {
    let block = Block::new(100, 0.45);
    let mut columns = Columns::new(block.factor.clone(), 2);
    columns.prefetch(&[9]).expect("a column");
    let wide: Vec<usize> = (20..40).collect();
    let across = columns.entries(&[9], &wide).expect("entries");
    let down = columns.entries(&wide, &[9]).expect("entries");
    assert_eq!(columns.solved(), 1);
    assert_eq!(across.transpose(), down.as_ref());
    // Seven columns through a cache of two.
    let some: Vec<usize> = (30..37).collect();
    let narrow = columns.entries(&wide, &some).expect("entries");
    let mut roomy = Columns::new(block.factor.clone(), 100);
    let expected = roomy.entries(&wide, &some).expect("entries");
    for i in 0..wide.len() {
        for j in 0..some.len() {
            let error = (narrow[(i, j)] - expected[(i, j)]).abs();
            assert!(
                error <= 1e-9 * expected[(i, j)].abs().max(1e-3),
                "({i}, {j}): {error:e}"
            );
        }
    }
    assert_eq!(columns.len(), 2);
    assert_eq!(Columns::new(block.factor.clone(), 0).capacity(), 1);
}

#[test]
fn the_same_requests_give_the_same_bits() {
    let block = Block::new(300, 0.45);
    let run = || {
        let mut columns = Columns::new(block.factor.clone(), 40);
        columns.prefetch(&(0..30).collect::<Vec<_>>()).expect("columns");
        columns.entries(&[3, 200, 201], &[5, 202, 100]).expect("entries")
    };
    assert_eq!(run(), run());
}

#[test]
fn another_factor_starts_empty() {
    let [block, stiffer] = [Block::new(100, 0.3), Block::new(100, 0.45)];
    let mut columns = Columns::new(block.factor.clone(), 10);
    let before = columns.column(3).expect("a column").to_vec();
    columns.replace(stiffer.factor.clone());
    assert!(columns.is_empty());
    assert_ne!(columns.column(3).expect("a column"), before);
}

#[test]
fn requests_that_do_not_fit_are_refused() {
    let block = Block::new(100, 0.45);
    let mut columns = Columns::new(block.factor.clone(), 10);
    let size = columns.size();
    let outside = LinearError::OutOfRange { dof: size, size };
    assert_eq!(columns.column(size).err(), Some(outside.clone()));
    assert_eq!(columns.prefetch(&[0, size]), Err(outside.clone()));
    assert_eq!(columns.entries(&[size], &[0]).err(), Some(outside.clone()));
    assert_eq!(columns.entries(&[0], &[size]).err(), Some(outside.clone()));
    assert!(matches!(
        columns.column_into(0, &mut [0.0]),
        Err(LinearError::Shape { found: 1, .. })
    ));
    assert!(columns.is_empty());
}
