//! Access to the compliance K^-1 (mm/N), from a dense inverse or by solving on demand.

use crate::tissue::error::LinearError;
use std::sync::Arc;

use faer::{Mat, MatMut};

use super::symmetric::{Scalar, Symmetric};

/// Inverse of the stiffness over the free degrees of freedom, mm/N, read by column or by entry.
///
/// Reading may solve for missing columns, hence `&mut self`.
pub trait Compliance {
    /// Number of free degrees of freedom.
    fn size(&self) -> usize;

    /// Writes column `dof` of K^-1 to `out`: the displacements (mm) under a unit force (N) on it, one per row.
    ///
    /// # Errors
    /// [`LinearError`] when `dof` is out of range, `out` has the wrong length, or the column cannot be computed.
    fn column_into(&mut self, dof: usize, out: &mut [f64]) -> Result<(), LinearError>;

    /// Writes the block of K^-1 at these rows and columns, in their order, to `out` (rows by columns).
    ///
    /// # Errors
    /// [`LinearError`] when an index is out of range, `out` has the wrong shape, or a column cannot be computed.
    fn entries_into(&mut self, rows: &[usize], columns: &[usize], out: MatMut<'_, f64>) -> Result<(), LinearError>;

    /// Returns the block of K^-1 at these rows and columns, in their order.
    ///
    /// # Errors
    /// [`LinearError`] when an index is out of range or a column cannot be computed.
    fn entries(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, LinearError> {
        let mut out = Mat::zeros(rows.len(), columns.len());
        self.entries_into(rows, columns, out.as_mut())?;
        Ok(out)
    }

    /// Computes these columns together before their use. A stored inverse only checks the indices.
    ///
    /// # Errors
    /// [`LinearError`] when an index is out of range or a column cannot be computed.
    fn prefetch(&mut self, dofs: &[usize]) -> Result<(), LinearError> {
        check_dofs(dofs, self.size())
    }

    /// Computes the displacements `out` (mm) under the forces `x` (N) on all free degrees of freedom.
    ///
    /// # Errors
    /// [`LinearError`] when a length is wrong or the displacements cannot be computed.
    fn multiply_into(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), LinearError>;

    /// Memory currently in use, bytes.
    fn bytes(&self) -> usize;
}

pub(super) fn check_shape(what: &'static str, found: usize, expected: usize) -> Result<(), LinearError> {
    if found == expected {
        Ok(())
    } else {
        Err(LinearError::Shape { what, found, expected })
    }
}

/// Checks that all indices are below `size`.
pub(super) fn check_dofs(dofs: &[usize], size: usize) -> Result<(), LinearError> {
    match dofs.iter().find(|&&dof| dof >= size) {
        Some(&dof) => Err(LinearError::OutOfRange { dof, size }),
        None => Ok(()),
    }
}

/// Checks that no index occurs twice.
pub(super) fn check_distinct(dofs: &[usize]) -> Result<(), LinearError> {
    let mut sorted = dofs.to_vec();
    sorted.sort_unstable();
    match sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(LinearError::Repeated { dof: pair[0] }),
        None => Ok(()),
    }
}

/// Read-only access to a matrix, shared between readers or not.
macro_rules! stored {
    ($of:ty) => {
        impl<T: Scalar> Compliance for $of {
            fn size(&self) -> usize {
                Symmetric::size(self)
            }

            fn column_into(&mut self, dof: usize, out: &mut [f64]) -> Result<(), LinearError> {
                self.copy_column(dof, out, T::wide)
            }

            fn entries_into(
                &mut self,
                rows: &[usize],
                columns: &[usize],
                out: MatMut<'_, f64>,
            ) -> Result<(), LinearError> {
                copy_entries(self, rows, columns, out)
            }

            fn multiply_into(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), LinearError> {
                multiply(self, x, out)
            }

            fn bytes(&self) -> usize {
                Symmetric::bytes(self)
            }
        }
    };
}

stored!(Symmetric<T>);
stored!(Arc<Symmetric<T>>);

fn copy_entries<T: Scalar>(
    matrix: &Symmetric<T>,
    rows: &[usize],
    columns: &[usize],
    mut out: MatMut<'_, f64>,
) -> Result<(), LinearError> {
    let size = matrix.size();
    check_dofs(rows, size)?;
    check_dofs(columns, size)?;
    check_shape("rows of the block", out.nrows(), rows.len())?;
    check_shape("columns of the block", out.ncols(), columns.len())?;
    for (j, &column) in columns.iter().enumerate() {
        for (i, &row) in rows.iter().enumerate() {
            out[(i, j)] = matrix.get(row, column).wide();
        }
    }
    Ok(())
}

fn multiply<T: Scalar>(matrix: &Symmetric<T>, x: &[f64], out: &mut [f64]) -> Result<(), LinearError> {
    let x: Vec<T> = x.iter().map(|x| T::of(*x)).collect();
    let mut product = vec![T::of(0.0); out.len()];
    matrix.multiply(&x, &mut product)?;
    out.iter_mut()
        .zip(&product)
        .for_each(|(out, product)| *out = product.wide());
    Ok(())
}
