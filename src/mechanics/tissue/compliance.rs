//! Entries and columns of the compliance K^-1 (mm/N), wherever they come from: a dense inverse or solutions on demand.

use std::sync::Arc;

use faer::{Mat, MatMut};

use super::symmetric::{Scalar, Symmetric};

/// The inverse of the stiffness over the free degrees of freedom, in mm/N, read by column or by entry.
///
/// Reading may solve for what is not there yet, hence `&mut self`.
pub trait Compliance {
    /// Free degrees of freedom: rows, and columns.
    fn size(&self) -> usize;

    /// Column `dof` of K^-1: the displacements (mm) under a unit force (N) on it. `out` holds one value a row.
    ///
    /// # Errors
    /// [`ComplianceError`] when `dof` or the length of `out` does not fit, or when the column cannot be computed.
    fn column_into(&mut self, dof: usize, out: &mut [f64]) -> Result<(), ComplianceError>;

    /// The block of K^-1 at these rows and columns, in their order; `out` is rows by columns.
    ///
    /// # Errors
    /// [`ComplianceError`] when an index or the shape of `out` does not fit, or when a column cannot be computed.
    fn entries_into(&mut self, rows: &[usize], columns: &[usize], out: MatMut<'_, f64>) -> Result<(), ComplianceError>;

    /// The block of K^-1 at these rows and columns, in their order.
    ///
    /// # Errors
    /// As [`entries_into`](Self::entries_into).
    fn entries(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, ComplianceError> {
        let mut out = Mat::zeros(rows.len(), columns.len());
        self.entries_into(rows, columns, out.as_mut())?;
        Ok(out)
    }

    /// Makes these columns ready together, ahead of their use. A stored inverse has nothing to do.
    ///
    /// # Errors
    /// [`ComplianceError`] when an index does not fit or a column cannot be computed.
    fn prefetch(&mut self, dofs: &[usize]) -> Result<(), ComplianceError> {
        check_dofs(dofs, self.size())
    }

    /// The displacements `out` (mm) under the forces `x` (N) on all free degrees of freedom.
    ///
    /// # Errors
    /// [`ComplianceError`] when a length does not fit or the displacements cannot be computed.
    fn multiply_into(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), ComplianceError>;

    /// Bytes that it takes at the moment.
    fn bytes(&self) -> usize;
}

/// Why entries of the compliance cannot be read or changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ComplianceError {
    /// An index beyond the matrix.
    #[error("degree of freedom {dof}, but there are {size}: valid are 0 to {size} - 1")]
    OutOfRange {
        /// The index given.
        dof: usize,
        /// Free degrees of freedom.
        size: usize,
    },
    /// An index given twice where each may come once.
    #[error("degree of freedom {dof} is named twice; name each once")]
    Repeated {
        /// The index.
        dof: usize,
    },
    /// An operand of the wrong length.
    #[error("{what}: {found} given, {expected} expected")]
    Shape {
        /// Which length.
        what: &'static str,
        /// As given.
        found: usize,
        /// As it must be.
        expected: usize,
    },
    /// A solution with infinite or undefined values.
    #[error("column {dof} of K^-1 holds a value that is not finite: the stiffness is singular to working precision")]
    NotFinite {
        /// The column.
        dof: usize,
    },
}

/// Checks a length.
pub(super) fn check_shape(what: &'static str, found: usize, expected: usize) -> Result<(), ComplianceError> {
    if found == expected {
        Ok(())
    } else {
        Err(ComplianceError::Shape { what, found, expected })
    }
}

/// Checks that indices lie inside a matrix.
pub(super) fn check_dofs(dofs: &[usize], size: usize) -> Result<(), ComplianceError> {
    match dofs.iter().find(|&&dof| dof >= size) {
        Some(&dof) => Err(ComplianceError::OutOfRange { dof, size }),
        None => Ok(()),
    }
}

/// Checks that no index is named twice.
pub(super) fn check_distinct(dofs: &[usize]) -> Result<(), ComplianceError> {
    let mut sorted = dofs.to_vec();
    sorted.sort_unstable();
    match sorted.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(ComplianceError::Repeated { dof: pair[0] }),
        None => Ok(()),
    }
}

/// Shared by several readers, none of which may change it.
impl<T: Scalar> Compliance for Arc<Symmetric<T>> {
    fn size(&self) -> usize {
        Symmetric::size(self)
    }

    fn column_into(&mut self, dof: usize, out: &mut [f64]) -> Result<(), ComplianceError> {
        self.copy_column(dof, out, T::wide)
    }

    fn entries_into(&mut self, rows: &[usize], columns: &[usize], out: MatMut<'_, f64>) -> Result<(), ComplianceError> {
        copy_entries(self, rows, columns, out)
    }

    fn multiply_into(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), ComplianceError> {
        multiply(self, x, out)
    }

    fn bytes(&self) -> usize {
        Symmetric::bytes(self)
    }
}

fn copy_entries<T: Scalar>(
    matrix: &Symmetric<T>,
    rows: &[usize],
    columns: &[usize],
    mut out: MatMut<'_, f64>,
) -> Result<(), ComplianceError> {
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

fn multiply<T: Scalar>(matrix: &Symmetric<T>, x: &[f64], out: &mut [f64]) -> Result<(), ComplianceError> {
    let x: Vec<T> = x.iter().map(|x| T::of(*x)).collect();
    let mut product = vec![T::of(0.0); out.len()];
    matrix.multiply(&x, &mut product)?;
    out.iter_mut()
        .zip(&product)
        .for_each(|(out, product)| *out = product.wide());
    Ok(())
}

impl<T: Scalar> Compliance for Symmetric<T> {
    fn size(&self) -> usize {
        Symmetric::size(self)
    }

    fn column_into(&mut self, dof: usize, out: &mut [f64]) -> Result<(), ComplianceError> {
        self.copy_column(dof, out, T::wide)
    }

    fn entries_into(&mut self, rows: &[usize], columns: &[usize], out: MatMut<'_, f64>) -> Result<(), ComplianceError> {
        copy_entries(self, rows, columns, out)
    }

    fn multiply_into(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), ComplianceError> {
        multiply(self, x, out)
    }

    fn bytes(&self) -> usize {
        Symmetric::bytes(self)
    }
}
