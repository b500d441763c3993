//! The dense inverse of the stiffness: solutions for unit forces, panel of rows by panel of rows.
//!
//! The sparse factor solves a block of unit forces together, in f64 whatever the precision of the result, and what is kept of
//! them is their part of the lower triangle. Panels go to the threads of the current rayon pool, each of which needs two
//! blocks beside the result. Against LAPACK's dense factorisation and inversion this does less work (four operations an
//! entry of L and a column, instead of one an entry of the dense triangle), and it never holds a second dense matrix.

#[cfg(test)]
mod tests;

use std::sync::{Mutex, PoisonError};

use faer::{Mat, MatRef};
use rayon::prelude::*;

use super::assembly::Stiffness;
use super::compliance::{Compliance, ComplianceError};
use super::factor::Factor;
use super::symmetric::{PANEL_ROWS, PanelMut, Scalar, Symmetric};
use crate::memory;

/// Right-hand sides solved together.
const BLOCK: usize = 32;

/// Why there is no dense inverse.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum InverseError {
    /// It is larger than the memory of the machine.
    #[error(
        "the dense inverse of {size} degrees of freedom needs {:.1} GiB, and {:.1} GiB of memory are available; use columns on \
         demand, which need none of it, single precision, or a coarser mesh",
        gib(*needed), gib(*available)
    )]
    Memory {
        /// Degrees of freedom.
        size: usize,
        /// Bytes that it needs.
        needed: usize,
        /// Bytes that can be had.
        available: usize,
    },
    /// A solution is not finite.
    #[error(transparent)]
    Column(#[from] ComplianceError),
}

fn gib(bytes: usize) -> f64 {
    bytes as f64 / (1u64 << 30) as f64
}

/// K^-1 (mm/N) from the factor of K, on the threads of the current rayon pool; the same bits on any number of them.
/// `progress` is told how many columns of how many are done, in ascending order, from any thread.
///
/// # Errors
/// [`InverseError::Memory`] before anything is allocated, where the system says how much memory there is (Linux);
/// [`InverseError::Column`] when a solution is not finite.
pub fn invert<T: Scalar>(
    factor: &Factor,
    progress: impl FnMut(usize, usize) + Send,
) -> Result<Symmetric<T>, InverseError> {
    let size = factor.size();
    check_memory::<T>(size)?;
    let mut inverse = Symmetric::zeros(size);
    let progress = Mutex::new((0, progress));
    inverse.row_panels_mut().try_for_each(|panel| {
        let rows = panel.rows;
        fill(factor, panel)?;
        // A caller's panic leaves the count whole.
        let (done, report) = &mut *progress.lock().unwrap_or_else(PoisonError::into_inner);
        *done += rows;
        report(*done, size);
        Ok::<(), ComplianceError>(())
    })?;
    Ok(inverse)
}

/// Checks what an inverse and the blocks of all threads need against what there is.
pub(super) fn check_memory<T: Scalar>(size: usize) -> Result<(), InverseError> {
    check_memory_of::<T>(size, rayon::current_num_threads(), memory::available())
}

fn check_memory_of<T: Scalar>(size: usize, threads: usize, available: Option<usize>) -> Result<(), InverseError> {
    // A block of solutions, and the factor's scratch memory for as many.
    let block = 2 * BLOCK * size_of::<f64>();
    let blocks = threads.saturating_mul(size).saturating_mul(block);
    let needed = Symmetric::<T>::bytes_of(size).saturating_add(blocks);
    match available {
        Some(available) if needed > available => Err(InverseError::Memory {
            size,
            needed,
            available,
        }),
        _ => Ok(()),
    }
}

/// Solves for the rows of a panel.
fn fill<T: Scalar>(factor: &Factor, panel: PanelMut<'_, T>) -> Result<(), ComplianceError> {
    let mut solutions = Mat::<f64>::zeros(factor.size(), BLOCK.min(panel.rows));
    for first in (0..panel.rows).step_by(BLOCK) {
        let count = BLOCK.min(panel.rows - first);
        solutions.fill(0.0);
        for k in 0..count {
            solutions[(panel.first_row + first + k, k)] = 1.0;
        }
        factor.solve_many_in_place(solutions.as_mut().subcols_mut(0, count));
        let lower = solutions.as_ref().get(..panel.columns.len(), ..count);
        check_finite(lower, panel.first_row + first)?;
        // Transposed in squares, so that neither side is walked across its lines alone.
        for (at, columns) in panel.columns.chunks_mut(BLOCK).enumerate() {
            for k in 0..count {
                let values = lower.col(k).subrows(at * BLOCK, columns.len());
                for (column, &value) in columns.iter_mut().zip(values.iter()) {
                    column.0[first + k] = T::of(value);
                }
            }
        }
    }
    Ok(())
}

/// Checks solutions for the unit forces from `first` on.
fn check_finite(solutions: MatRef<'_, f64>, first: usize) -> Result<(), ComplianceError> {
    let bad = solutions
        .col_iter()
        .position(|column| !column.iter().all(|x| x.is_finite()));
    match bad {
        Some(k) => Err(ComplianceError::NotFinite { dof: first + k }),
        None => Ok(()),
    }
}

/// The largest entry of K (K^-1 e) - e over the columns `dofs`: how far a stored, updated or loaded inverse is from that of
/// this stiffness, sampled.
///
/// # Errors
/// [`ComplianceError`] when an index or the size does not fit, or a column cannot be had.
pub fn sampled_residual(
    stiffness: &Stiffness,
    compliance: &mut dyn Compliance,
    dofs: &[usize],
) -> Result<f64, ComplianceError> {
    let size = stiffness.dofs().free();
    super::compliance::check_shape("degrees of freedom of the compliance", compliance.size(), size)?;
    let [mut column, mut product] = [vec![0.0; size], vec![0.0; size]];
    let mut largest: f64 = 0.0;
    for &dof in dofs {
        compliance.column_into(dof, &mut column)?;
        stiffness.multiply(&column, &mut product);
        product[dof] -= 1.0;
        for value in &product {
            // Not `max`, which forgets what is undefined.
            if value.abs() > largest || value.is_nan() {
                largest = value.abs();
            }
        }
    }
    Ok(largest)
}

const _: () = assert!(PANEL_ROWS.is_multiple_of(BLOCK));
