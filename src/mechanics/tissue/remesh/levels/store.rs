//! Storage of a dense inverse, and its operations.

use crate::tissue::error::LinearError;
use std::sync::Arc;

use faer::{Mat, MatRef};
use insonify_base::parallel::{for_each, try_for_each};

use crate::tissue::compliance::{Compliance, check_shape};
use crate::tissue::remesh::make::Entry;
use crate::tissue::remesh::{Precision, RemeshError};
use crate::tissue::symmetric::{PANEL_ROWS, Scalar, Symmetric};

/// Inverse from which a store reads columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which {
    /// The inverse that follows the moves.
    Current,
    /// The inverse of the base.
    Base,
}

/// Dense inverse that follows the moves, and that of its base, in the memory of the CPU or of a device.
///
/// [`RemeshError::Device`] leaves the contents undefined; any other error leaves them unchanged.
pub trait Store: Send {
    /// Number of rows and columns.
    fn size(&self) -> usize;

    /// Precision of the entries.
    fn precision(&self) -> Precision;

    /// Size of one inverse, bytes.
    fn bytes(&self) -> usize;

    /// Memory in use, including the base, bytes.
    fn memory(&self) -> usize;

    /// Sets columns Y aside for the following update, and returns their rows of the same indices, G.
    ///
    /// # Errors
    /// [`RemeshError`].
    fn take(&mut self, which: Which, columns: &[usize]) -> Result<Mat<f64>, RemeshError>;

    /// Subtracts Y C Y^T (C in N/mm, symmetric) from all entries of the current inverse, or from those in some rows and
    /// columns. Y are the columns set aside from it. Returns the entries at the rows and columns `block`, mm/N.
    ///
    /// # Errors
    /// [`RemeshError`].
    fn update(&mut self, c: MatRef<'_, f64>, rows: Option<&[usize]>, block: &[usize]) -> Result<Mat<f64>, RemeshError>;

    /// Does for a change of the stiffness at some rows and columns what [`take`](Self::take) and
    /// [`update`](Self::update) do with C = (I + dK G)^-1 dK, in one go; returns the reciprocal condition of I + dK G,
    /// too. `None` where the store does not solve for C or the reciprocal condition is below `limit`; nothing has
    /// changed then.
    ///
    /// # Errors
    /// [`RemeshError`].
    fn apply(
        &mut self,
        _columns: &[usize],
        _change: MatRef<'_, f64>,
        _limit: f64,
        _rows: Option<&[usize]>,
        _block: &[usize],
    ) -> Result<Option<(f64, Mat<f64>)>, RemeshError> {
        Ok(None)
    }

    /// Replaces the current inverse by the base minus Y C Y^T. Y are the columns set aside from the base.
    ///
    /// # Errors
    /// [`RemeshError`].
    fn restart(&mut self, c: MatRef<'_, f64>) -> Result<(), RemeshError>;

    /// Returns a block of the current inverse, mm/N.
    ///
    /// # Errors
    /// [`RemeshError`].
    fn entries(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, RemeshError>;

    /// Writes the sum of columns of the current inverse, each times its weight (N), to `out` (mm).
    ///
    /// # Errors
    /// [`RemeshError`].
    fn combine(&mut self, columns: &[usize], weights: &[f64], out: &mut [f64]) -> Result<(), RemeshError>;

    /// Writes the product of the current inverse and `x` (N) to `out` (mm).
    ///
    /// # Errors
    /// [`RemeshError`].
    fn multiply(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), RemeshError>;
}

/// Store in CPU memory.
pub struct Host<T> {
    base: Arc<Symmetric<T>>,
    pub(super) current: Symmetric<T>,
    taken_columns: Mat<T>,
    column: Vec<f64>,
}

impl<T> std::fmt::Debug for Host<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Host({} rows)", self.column.len())
    }
}

impl<T: Scalar> Host<T> {
    pub(super) fn new(base: Arc<Symmetric<T>>) -> Self {
        Host {
            current: (*base).clone(),
            taken_columns: Mat::new(),
            column: vec![0.0; base.size()],
            base,
        }
    }
}

impl<T: Entry> Store for Host<T> {
    fn size(&self) -> usize {
        self.current.size()
    }

    fn precision(&self) -> Precision {
        T::PRECISION
    }

    fn bytes(&self) -> usize {
        self.current.bytes()
    }

    fn memory(&self) -> usize {
        self.base.bytes() + self.current.bytes()
    }

    fn take(&mut self, which: Which, columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        let matrix = match which {
            Which::Current => &self.current,
            Which::Base => &*self.base,
        };
        self.taken_columns = read_columns(matrix, columns)?;
        let block = |i, j| self.taken_columns[(columns[i], j)].wide();
        Ok(Mat::from_fn(columns.len(), columns.len(), block))
    }

    fn update(&mut self, c: MatRef<'_, f64>, rows: Option<&[usize]>, block: &[usize]) -> Result<Mat<f64>, RemeshError> {
        let (y, c) = (self.taken_columns.as_ref(), rounded(c));
        match rows {
            None => self.current.rank_update(y, c.as_ref())?,
            Some(rows) => self.current.update_rows(rows, y, c.as_ref())?,
        }
        self.entries(block, block)
    }

    fn restart(&mut self, c: MatRef<'_, f64>) -> Result<(), RemeshError> {
        let panels: Vec<_> = self.base.panel_columns().collect();
        for_each(self.current.row_panels_mut(), &|panel| {
            panel.columns.copy_from_slice(panels[panel.first_row / PANEL_ROWS]);
        });
        self.update(c, None, &[]).map(drop)
    }

    fn entries(&mut self, rows: &[usize], columns: &[usize]) -> Result<Mat<f64>, RemeshError> {
        self.current.entries(rows, columns).map_err(RemeshError::from)
    }

    fn combine(&mut self, columns: &[usize], weights: &[f64], out: &mut [f64]) -> Result<(), RemeshError> {
        check_shape("displacements", out.len(), self.size())?;
        out.fill(0.0);
        for (&column, &weight) in columns.iter().zip(weights) {
            self.current.copy_column(column, &mut self.column, T::wide)?;
            let sums = out.iter_mut().zip(&self.column);
            sums.for_each(|(sum, value)| *sum += weight * value);
        }
        Ok(())
    }

    fn multiply(&mut self, x: &[f64], out: &mut [f64]) -> Result<(), RemeshError> {
        self.current.multiply_into(x, out).map_err(RemeshError::from)
    }
}

/// Reads columns of a symmetric matrix.
fn read_columns<T: Scalar>(matrix: &Symmetric<T>, columns: &[usize]) -> Result<Mat<T>, LinearError> {
    let mut y = Mat::<T>::zeros(matrix.size(), columns.len());
    let mut out: Vec<_> = y.col_iter_mut().collect();
    try_for_each(
        (&mut out[..], columns),
        &|(out, &column)| match out.as_mut().try_as_col_major_mut() {
            Some(out) => matrix.column_into(column, out.as_slice_mut()),
            None => Ok(()),
        },
    )?;
    Ok(y)
}

/// Rounds a matrix to the precision of the inverse.
fn rounded<T: Scalar>(matrix: MatRef<'_, f64>) -> Mat<T> {
    Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| T::of(matrix[(i, j)]))
}
