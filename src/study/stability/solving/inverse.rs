//! Cases of the dense inverse.

use faer::linalg::solvers::Llt;
use faer::{Mat, Side};

use super::problem::Problem;
use crate::mechanics::tissue::factor::Factor;
use crate::mechanics::tissue::inverse::{invert, sampled_residual};
use crate::mechanics::tissue::symmetric::{Scalar, Symmetric};
use crate::study::stability::record::{Record, Unexpected, largest};

/// Tests definiteness and symmetry of K^-1 in both precisions.
pub fn definite(record: &mut Record<'_>) -> Result<(), Unexpected> {
    for poisson in [0.45, 0.499, 0.4999] {
        let problem = Problem::block(record, poisson)?;
        let stiffness = problem.stiffness()?;
        let factor = Factor::new(&stiffness)?;
        let mut double: Symmetric<f64> = invert(&factor, |_, _| {})?;
        measure(record, &format!("f64, nu {poisson}"), &double);
        let size = double.size();
        let residual = sampled_residual(&stiffness, &mut double, &[0, size / 2, size - 1])?;
        record.report(format!("|K X e - e|, nu {poisson}"), residual);
        let single: Symmetric<f32> = invert(&factor, |_, _| {})?;
        measure(record, &format!("f32, nu {poisson}"), &single);
    }
    Ok(())
}

fn measure<T: Scalar>(record: &mut Record<'_>, what: &str, inverse: &Symmetric<T>) {
    let size = inverse.size();
    let mut columns = vec![vec![T::of(0.0); size]; size];
    let unread = columns
        .iter_mut()
        .enumerate()
        .filter_map(|(j, column)| inverse.column_into(j, column).err());
    record.zero(format!("columns that cannot be read, {what}"), unread.count() as f64);
    let pairs = (0..size).flat_map(|i| (0..i).map(move |j| (i, j)));
    let asymmetry = largest(pairs.map(|(i, j)| columns[i][j].wide() - columns[j][i].wide()));
    record.zero(format!("asymmetry, {what}"), asymmetry);
    // Stored entries, factorised in f64.
    let entries = Mat::from_fn(size, size, |i, j| inverse.get(i, j).wide());
    let factor = Llt::new(entries.as_ref(), Side::Lower);
    record.zero(format!("not positive definite, {what}"), f64::from(factor.is_err()));
    if let Ok(factor) = factor {
        let lower = factor.L();
        let pivots = (0..size).map(|i| lower[(i, i)] * lower[(i, i)]);
        let smallest = pivots.fold(f64::INFINITY, f64::min);
        record.report(format!("smallest pivot (mm/N), {what}"), smallest);
        record.report(
            format!("smallest pivot over the largest entry, {what}"),
            smallest / entries.norm_max(),
        );
    }
}
