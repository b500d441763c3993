//! Dense inverse of the stiffness, solved for unit forces by row panels.
//!
//! The sparse factor solves a block of unit forces together, in f64 regardless of the result's precision, and only
//! their part of the lower triangle is kept. Panels are distributed over the current pool, each thread of which
//! needs two blocks beside the result. Compared with LAPACK's dense factorisation and inversion, this takes less work
//! (four operations per entry of L and column, instead of one per entry of the dense triangle) and never stores a
//! second dense matrix.

#[cfg(test)]
mod tests;

use crate::tissue::error::LinearError;
use std::sync::{Mutex, PoisonError};

use faer::{Mat, MatRef};

use super::assembly::Stiffness;
use super::compliance::Compliance;
use super::factor::Factor;
use super::symmetric::{PANEL_ROWS, PanelMut, Scalar, Symmetric};
use insonify_base::{memory, parallel};

/// Right-hand sides solved together.
const BLOCK: usize = 32;

/// Computes K^-1 (mm/N) from the factor of K on the current pool; the result is bitwise independent of the number
/// of threads. `progress` receives the number of finished columns and their total, in ascending order, from any thread.
///
/// # Errors
/// [`LinearError::InverseMemory`] before any allocation, where the system reports its available memory (Linux);
/// [`LinearError::Column`] when a solution is not finite.
pub fn invert<T: Scalar>(
    factor: &Factor,
    progress: &mut (dyn FnMut(usize, usize) + Send),
) -> Result<Symmetric<T>, LinearError> {
    let size = factor.size();
    check_memory::<T>(size)?;
    let mut inverse = Symmetric::zeros(size);
    let progress = Mutex::new((0, progress));
    parallel::try_for_each(inverse.row_panels_mut(), &|panel| {
        let rows = panel.rows;
        fill(factor, panel)?;
        // A panic in the callback leaves the count intact.
        let (done, report) = &mut *progress.lock().unwrap_or_else(PoisonError::into_inner);
        *done += rows;
        report(*done, size);
        Ok::<(), LinearError>(())
    })?;
    Ok(inverse)
}

/// Checks the memory needed by an inverse and the blocks of all threads against what is available.
pub(super) fn check_memory<T: Scalar>(size: usize) -> Result<(), LinearError> {
    check_memory_of::<T>(size, parallel::threads(), memory::available())
}

fn check_memory_of<T: Scalar>(size: usize, threads: usize, available: Option<usize>) -> Result<(), LinearError> {
    // A block of solutions, and the factor's scratch memory of the same size.
    let block = 2 * BLOCK * size_of::<f64>();
    let blocks = threads.saturating_mul(size).saturating_mul(block);
    let needed = Symmetric::<T>::bytes_of(size).saturating_add(blocks);
    match available {
        Some(available) if needed > available => Err(LinearError::InverseMemory {
            size,
            needed,
            available,
        }),
        _ => Ok(()),
    }
}

/// Solves for the rows of a panel.
fn fill<T: Scalar>(factor: &Factor, panel: PanelMut<'_, T>) -> Result<(), LinearError> {
    let mut solutions = Mat::<f64>::zeros(factor.size(), BLOCK.min(panel.rows));
    for first_row in (0..panel.rows).step_by(BLOCK) {
        let count = BLOCK.min(panel.rows - first_row);
        solutions.fill(0.0);
        for k in 0..count {
            solutions[(panel.first_row + first_row + k, k)] = 1.0;
        }
        factor.solve_many_in_place(solutions.as_mut().subcols_mut(0, count));
        let lower = solutions.as_ref().get(..panel.columns.len(), ..count);
        check_finite(lower, panel.first_row + first_row)?;
        // Transposed in square blocks, so that both sides are accessed locally.
        for (block, columns) in panel.columns.chunks_mut(BLOCK).enumerate() {
            for k in 0..count {
                let values = lower.col(k).subrows(block * BLOCK, columns.len());
                for (column, &value) in columns.iter_mut().zip(values.iter()) {
                    column.0[first_row + k] = T::of(value);
                }
            }
        }
    }
    Ok(())
}

/// Checks that the solutions for the unit forces from `first_row` on are finite.
fn check_finite(solutions: MatRef<'_, f64>, first_row: usize) -> Result<(), LinearError> {
    let bad = solutions
        .col_iter()
        .position(|column| !column.iter().all(|x| x.is_finite()));
    match bad {
        Some(k) => Err(LinearError::Column { dof: first_row + k }),
        None => Ok(()),
    }
}

/// Returns the largest entry of K (K^-1 e) - e over the columns `dofs`: a sampled error of a stored or updated inverse
/// of this stiffness.
///
/// # Errors
/// [`LinearError`] when an index is out of range, the sizes differ, or a column cannot be computed.
pub fn sampled_residual(
    stiffness: &Stiffness,
    compliance: &mut dyn Compliance,
    dofs: &[usize],
) -> Result<f64, LinearError> {
    let size = stiffness.dofs().free();
    super::compliance::check_shape("degrees of freedom of the compliance", compliance.size(), size)?;
    let [mut column, mut product] = [vec![0.0; size], vec![0.0; size]];
    let mut largest: f64 = 0.0;
    for &dof in dofs {
        compliance.column_into(dof, &mut column)?;
        stiffness.multiply(&column, &mut product);
        product[dof] -= 1.0;
        for value in &product {
            // `max` would discard NaN.
            if value.abs() > largest || value.is_nan() {
                largest = value.abs();
            }
        }
    }
    Ok(largest)
}

const _: () = assert!(PANEL_ROWS.is_multiple_of(BLOCK));
