//! Dense symmetric matrix in row panels: half the memory of a full one, and exactly symmetric, as an entry is stored
//! once.
//!
//! Panel p holds the rows from p `PANEL_ROWS` on and the columns up to its last row, column by column. A pass down a
//! panel is then one stream through memory, whose bandwidth limits the rank-s update of remeshing. Every panel is a
//! separate allocation, as GPU buffers are limited in size.
//!
//! ```text
//!          0    128   256   384 ...
//!     0  [ \  ]
//!   128  [     | \  ]                   a panel: columns of 128 values, cache-line aligned;
//!   256  [           | \  ]             above the diagonal (\) they carry no meaning
//! ```

mod update;

use std::fmt;

use bytemuck::Pod;

use super::compliance::{check_dofs, check_shape};
use crate::tissue::error::LinearError;
use insonify_base::parallel::{self, Rows, for_each, tasks};
use insonify_base::real::Real;
use insonify_base::simd::{Lanes, Simd, WithSimd, array, dispatch};

/// Rows of a panel. Measured from 64 to 256 at 9,834 rows: 128 and 256 are equally fast, 64 is up to a tenth slower,
/// and the memory above the diagonal grows with the number of rows.
pub(crate) const PANEL_ROWS: usize = 128;

/// Scalar type of a dense matrix: `f32` or `f64`.
pub trait Scalar: Real + Lanes + Pod + faer::traits::RealField {}

impl Scalar for f32 {}
impl Scalar for f64 {}

/// One column of a panel, padded beyond the last row of the matrix.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Column<T>(pub [T; PANEL_ROWS]);

/// Symmetric matrix of `size` rows, stored as its lower triangle.
#[derive(Clone)]
pub struct Symmetric<T> {
    size: usize,
    panels: Vec<Vec<Column<T>>>,
}

/// Consecutive rows of a [`Symmetric`] with the columns up to the last of them.
#[cfg(feature = "gpu")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Panel<'a, T> {
    /// Number of rows; `PANEL_ROWS` in all panels but the last.
    #[cfg(feature = "gpu")]
    pub rows: usize,
    /// Columns up to the last row. The first row of the panel is value 0 of each; values above the diagonal and beyond
    /// `rows` are meaningless.
    pub columns: &'a [Column<T>],
}

/// Consecutive rows, mutable, with the columns up to the last of them.
#[derive(Debug)]
pub(crate) struct PanelMut<'a, T> {
    pub first_row: usize,
    /// Number of rows.
    pub rows: usize,
    /// Columns `0..first_row + rows`.
    pub columns: &'a mut [Column<T>],
}

/// Consecutive panels of a matrix of `size` rows, handed out from the last to the first.
struct PanelsMut<'a, T> {
    size: usize,
    /// Number of the first of them.
    first: usize,
    panels: &'a mut [Vec<Column<T>>],
}

impl<'a, T: Send> Rows for PanelsMut<'a, T> {
    type Row = PanelMut<'a, T>;

    fn count(&self) -> usize {
        self.panels.len()
    }

    fn split_at(self, row: usize) -> (Self, Self) {
        let (size, middle) = (self.size, self.panels.len() - row);
        let (before, after) = self.panels.split_at_mut(middle);
        let part = |first: usize, panels: &'a mut [Vec<Column<T>>]| Self { size, first, panels };
        (part(self.first + middle, after), part(self.first, before))
    }

    fn next(&mut self) -> Option<PanelMut<'a, T>> {
        let columns = self.panels.split_off_last_mut()?;
        let [first_row, end] = panel_rows(self.first + self.panels.len(), self.size);
        Some(PanelMut {
            first_row,
            rows: end - first_row,
            columns,
        })
    }
}

/// Returns the first row of a panel and the one after its last.
fn panel_rows(panel: usize, size: usize) -> [usize; 2] {
    let first_row = panel * PANEL_ROWS;
    [first_row, (first_row + PANEL_ROWS).min(size)]
}

impl<T: Scalar> Symmetric<T> {
    /// Creates the zero matrix of `size` rows. It takes [`bytes_of`](Self::bytes_of) bytes: check them against the
    /// available memory first where `size` comes from a user, as [`invert`](super::inverse::invert) does.
    pub fn zeros(size: usize) -> Self {
        let zero = Column([T::of(0.0); PANEL_ROWS]);
        Self {
            size,
            panels: parallel::map(0..size.div_ceil(PANEL_ROWS), &|panel| {
                vec![zero; panel_rows(panel, size)[1]]
            }),
        }
    }

    /// Creates a matrix from its entries; `entry` is called only for row >= column.
    pub fn from_fn(size: usize, entry: impl Fn(usize, usize) -> T + Sync) -> Self {
        let mut matrix = Self::zeros(size);
        for_each(matrix.row_panels_mut(), &|panel| {
            for (j, column) in panel.columns.iter_mut().enumerate() {
                for i in j.saturating_sub(panel.first_row)..panel.rows {
                    column.0[i] = entry(panel.first_row + i, j);
                }
            }
        });
        matrix
    }

    /// Converts to another precision, rounding each entry once.
    pub fn cast<U: Scalar>(&self) -> Symmetric<U> {
        let convert = |column: &Column<T>| Column(column.0.map(|value| U::of(value.wide())));
        Symmetric {
            size: self.size,
            panels: parallel::map(tasks(&self.panels[..]), &|panel| panel.iter().map(convert).collect()),
        }
    }

    /// Number of rows and columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Size of the entries, bytes.
    pub fn bytes(&self) -> usize {
        self.panels.iter().map(|panel| size_of_val(panel.as_slice())).sum()
    }

    /// Size of a matrix of `size` rows, bytes; saturates.
    pub fn bytes_of(size: usize) -> usize {
        let panels = size.div_ceil(PANEL_ROWS);
        let whole = panels.saturating_mul(panels.saturating_sub(1)) / 2;
        let columns = whole.saturating_mul(PANEL_ROWS).saturating_add(size);
        columns.saturating_mul(size_of::<Column<T>>())
    }

    /// Returns entry (row, column).
    ///
    /// # Panics
    /// If an index is not below [`size`](Self::size), as in indexing.
    #[inline]
    pub fn get(&self, row: usize, column: usize) -> T {
        assert!(
            row < self.size && column < self.size,
            "({row}, {column}) of {}",
            self.size
        );
        let [row, column] = [row.max(column), row.min(column)];
        self.panels[row / PANEL_ROWS][column].0[row % PANEL_ROWS]
    }

    /// Writes column `j`, which is also row `j`, to `out`.
    ///
    /// # Errors
    /// [`LinearError`] when `j` is out of range or `out` has the wrong length.
    pub fn column_into(&self, j: usize, out: &mut [T]) -> Result<(), LinearError> {
        self.copy_column(j, out, |value| value)
    }

    /// Writes column `j`, converted, to `out`.
    pub(super) fn copy_column<U>(&self, j: usize, out: &mut [U], convert: impl Fn(T) -> U) -> Result<(), LinearError> {
        check_dofs(&[j], self.size)?;
        check_shape("rows of the column", out.len(), self.size)?;
        let panel_of_j = j / PANEL_ROWS;
        for (value, column) in out[..j].iter_mut().zip(&self.panels[panel_of_j]) {
            *value = convert(column.0[j % PANEL_ROWS]);
        }
        let mut row = j;
        for panel in &self.panels[panel_of_j..] {
            let rows = &panel[j].0[row % PANEL_ROWS..];
            for (value, &entry) in out[row..].iter_mut().zip(rows) {
                *value = convert(entry);
            }
            row += rows.len();
        }
        Ok(())
    }

    /// Columns of the panels, from the first row to the last.
    pub(crate) fn panel_columns(&self) -> impl ExactSizeIterator<Item = &[Column<T>]> {
        self.panels.iter().map(Vec::as_slice)
    }

    /// Panels from the first row to the last.
    #[cfg(feature = "gpu")]
    pub(crate) fn row_panels(&self) -> impl ExactSizeIterator<Item = Panel<'_, T>> {
        self.panels.iter().enumerate().map(|(panel, columns)| {
            let [first_row, end] = panel_rows(panel, self.size);
            Panel {
                rows: end - first_row,
                columns,
            }
        })
    }

    /// Mutable panels from the last to the first, to be taken by threads one by one: later ones are longer.
    pub(crate) fn row_panels_mut(&mut self) -> impl Rows<Row = PanelMut<'_, T>> {
        tasks(PanelsMut {
            size: self.size,
            first: 0,
            panels: &mut self.panels,
        })
    }
}

impl<T> fmt::Debug for Symmetric<T> {
    /// Writes only the size, as entries are too many to read.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Symmetric")
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

impl<T: PartialEq> PartialEq for Symmetric<T> {
    /// Compares only meaningful values.
    fn eq(&self, other: &Self) -> bool {
        let equal = |panel: usize| {
            let [first_row, end_row] = panel_rows(panel, self.size);
            (0..end_row).all(|j| {
                let rows = j.saturating_sub(first_row)..end_row - first_row;
                self.panels[panel][j].0[rows.clone()] == other.panels[panel][j].0[rows]
            })
        };
        self.size == other.size && (0..self.panels.len()).all(equal)
    }
}

/// Number of parts of a product, independent of the number of threads: their sums are added in order, so the result is
/// the same on any number. At most as many threads have work.
const PARTS: usize = 16;
/// Columns read together.
const WIDTH: usize = 4;

impl<T: Scalar> Symmetric<T> {
    /// Computes y = A x on the current pool.
    ///
    /// # Errors
    /// [`LinearError::Shape`] when a length is wrong.
    pub fn multiply(&self, x: &[T], y: &mut [T]) -> Result<(), LinearError> {
        check_shape("values of x", x.len(), self.size)?;
        check_shape("values of y", y.len(), self.size)?;
        let parts = parallel::map(tasks(&self.parts()[..]), &|part| self.part(part.clone(), x));
        y.fill(T::of(0.0));
        for part in &parts {
            y.iter_mut().zip(part).for_each(|(y, &value)| *y += value);
        }
        Ok(())
    }

    /// Splits the panels into runs with about the same number of entries.
    fn parts(&self) -> Vec<std::ops::Range<usize>> {
        let count = self.panels.len();
        // The number of entries up to a panel grows with its square.
        let bound = |part: usize| (count as f64 * (part as f64 / PARTS as f64).sqrt()).round() as usize;
        (0..PARTS)
            .map(|part| bound(part)..bound(part + 1))
            .filter(|part| !part.is_empty())
            .collect()
    }

    /// Computes the contribution of some panels to the product, from its first row to their last.
    fn part(&self, panels: std::ops::Range<usize>, x: &[T]) -> Vec<T> {
        let mut y = vec![T::of(0.0); panel_rows(panels.end - 1, self.size)[1]];
        for panel in panels {
            let [first_row, end] = panel_rows(panel, self.size);
            // Each entry left of the diagonal is read once and used twice, as itself and mirrored: the product is bound
            // by memory.
            let mut x_of_rows = Column([T::of(0.0); PANEL_ROWS]);
            x_of_rows.0[..end - first_row].copy_from_slice(&x[first_row..end]);
            let mut rows = Column([T::of(0.0); PANEL_ROWS]);
            let (left, diagonal) = self.panels[panel].split_at(first_row);
            dispatch(Left {
                columns: left,
                x: &x[..first_row],
                x_of_rows: &x_of_rows,
                y: &mut y[..first_row],
                rows: &mut rows,
            });
            for (j, column) in diagonal.iter().enumerate() {
                let below = j + 1..end - first_row;
                rows.0[j] += column.0[j] * x_of_rows.0[j];
                for i in below {
                    rows.0[i] += column.0[i] * x_of_rows.0[j];
                    rows.0[j] += column.0[i] * x_of_rows.0[i];
                }
            }
            y[first_row..]
                .iter_mut()
                .zip(&rows.0)
                .for_each(|(y, &value)| *y += value);
        }
        y
    }
}

/// Columns of a panel left of its diagonal block: rows += A x and y += A^T x_of_rows.
struct Left<'a, T> {
    columns: &'a [Column<T>],
    x: &'a [T],
    x_of_rows: &'a Column<T>,
    y: &'a mut [T],
    rows: &'a mut Column<T>,
}

impl<T: Scalar> WithSimd for Left<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Left of the diagonal block there are as many columns as rows in the panels before: a multiple of WIDTH.
        let groups = self.columns.as_chunks::<WIDTH>().0.iter();
        let x_of_rows = T::vectors::<S>(&self.x_of_rows.0);
        let rows = T::vectors_mut::<S>(&mut self.rows.0);
        for ((columns, x), y) in groups
            .zip(self.x.as_chunks::<WIDTH>().0)
            .zip(self.y.as_chunks_mut::<WIDTH>().0)
        {
            let columns: [_; WIDTH] = array(|j| T::vectors::<S>(&columns[j].0));
            let x: [_; WIDTH] = array(|j| T::splat(simd, x[j]));
            let mut sums = [T::splat(simd, T::of(0.0)); WIDTH];
            for i in 0..x_of_rows.len() {
                for j in 0..WIDTH {
                    rows[i] = T::multiply_add(simd, columns[j][i], x[j], rows[i]);
                    sums[j] = T::multiply_add(simd, columns[j][i], x_of_rows[i], sums[j]);
                }
            }
            for j in 0..WIDTH {
                y[j] += T::total(simd, sums[j]);
            }
        }
    }
}

#[cfg(test)]
mod tests;
