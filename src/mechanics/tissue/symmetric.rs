//! A dense symmetric matrix in row panels: half the memory of a full one, and symmetric because an entry is stored once.
//!
//! Panel p holds the rows from p [`PANEL_ROWS`] on and the columns up to its last row, column by column. Walking down a
//! panel is then one stream through memory, which is what the rank-s update of remeshing is bound by, and every panel is
//! an allocation of its own, as buffers of GPUs are limited in size.
//!
//! ```text
//!          0    128   256   384 ...
//!     0  [ \  ]
//!   128  [     | \  ]                   a panel: columns of 128 values, cache-line aligned;
//!   256  [           | \  ]             above the diagonal (\) they carry no meaning
//! ```

mod multiply;
#[cfg(test)]
mod tests;
mod update;

use std::fmt;

use bytemuck::Pod;
use rayon::prelude::*;

use super::compliance::{ComplianceError, check_dofs, check_shape};
use crate::real::Real;
use crate::simd::Lanes;

/// Rows of a panel. Measured from 64 to 256 at 9,834 rows: 128 and 256 are alike, 64 is up to a tenth slower, and the
/// memory above the diagonal grows with it.
pub const PANEL_ROWS: usize = 128;

/// The scalar of a dense matrix: `f32` or `f64`.
pub trait Scalar: Real + Lanes + Pod + faer::traits::RealField {}

impl Scalar for f32 {}
impl Scalar for f64 {}

/// One column of a panel; beyond the last row of the matrix it is padded.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub struct Column<T>(pub [T; PANEL_ROWS]);

/// A symmetric matrix of `size` rows, of which the lower triangle is stored.
#[derive(Clone)]
pub struct Symmetric<T> {
    size: usize,
    panels: Vec<Vec<Column<T>>>,
}

/// Rows `first_row..first_row + rows` of a [`Symmetric`] and the columns up to the last of them.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a, T> {
    /// The first row.
    pub first_row: usize,
    /// How many rows; [`PANEL_ROWS`] in all panels but the last.
    pub rows: usize,
    /// The columns `0..first_row + rows`. Row `i` of the matrix is value `i - first_row` of each; values in rows above the
    /// column's own number, and beyond `rows`, carry no meaning.
    pub columns: &'a [Column<T>],
}

/// As [`Panel`], to be written.
#[derive(Debug)]
pub struct PanelMut<'a, T> {
    /// The first row.
    pub first_row: usize,
    /// How many rows.
    pub rows: usize,
    /// The columns `0..first_row + rows`.
    pub columns: &'a mut [Column<T>],
}

/// The first row of a panel and the one after its last.
fn panel_rows(panel: usize, size: usize) -> [usize; 2] {
    let first = panel * PANEL_ROWS;
    [first, (first + PANEL_ROWS).min(size)]
}

impl<T: Scalar> Symmetric<T> {
    /// The zero matrix of `size` rows. Takes [`bytes_of`](Self::bytes_of) bytes: check them against the machine's memory
    /// first where `size` comes from a user, as [`invert`](super::inverse::invert) does.
    pub fn zeros(size: usize) -> Self {
        let panels = (0..size.div_ceil(PANEL_ROWS)).into_par_iter();
        let zero = Column([T::of(0.0); PANEL_ROWS]);
        Self {
            size,
            panels: panels.map(|panel| vec![zero; panel_rows(panel, size)[1]]).collect(),
        }
    }

    /// The matrix of these entries; only those with row >= column are asked for.
    pub fn from_fn(size: usize, entry: impl Fn(usize, usize) -> T + Sync) -> Self {
        let mut matrix = Self::zeros(size);
        matrix.row_panels_mut().for_each(|panel| {
            for (j, column) in panel.columns.iter_mut().enumerate() {
                for i in j.saturating_sub(panel.first_row)..panel.rows {
                    column.0[i] = entry(panel.first_row + i, j);
                }
            }
        });
        matrix
    }

    /// The same matrix in another precision, each entry rounded once.
    pub fn cast<U: Scalar>(&self) -> Symmetric<U> {
        let convert = |column: &Column<T>| Column(column.0.map(|value| U::of(value.wide())));
        let panels = self.panels.par_iter().with_max_len(1);
        Symmetric {
            size: self.size,
            panels: panels.map(|panel| panel.iter().map(convert).collect()).collect(),
        }
    }

    /// Rows, and columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Bytes that the entries take.
    pub fn bytes(&self) -> usize {
        self.panels.iter().map(|panel| size_of_val(panel.as_slice())).sum()
    }

    /// Bytes that a matrix of `size` rows takes; saturates.
    pub fn bytes_of(size: usize) -> usize {
        let panels = size.div_ceil(PANEL_ROWS);
        let whole = panels.saturating_mul(panels.saturating_sub(1)) / 2;
        let columns = whole.saturating_mul(PANEL_ROWS).saturating_add(size);
        columns.saturating_mul(size_of::<Column<T>>())
    }

    /// Entry (row, column).
    ///
    /// # Panics
    /// When an index is not below [`size`](Self::size), as indexing does.
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

    /// Writes column `j`, which is row `j` as well.
    ///
    /// # Errors
    /// [`ComplianceError`] when `j` or the length of `out` does not fit.
    pub fn column_into(&self, j: usize, out: &mut [T]) -> Result<(), ComplianceError> {
        self.copy_column(j, out, |value| value)
    }

    /// Writes column `j`, converted.
    pub(super) fn copy_column<U>(
        &self,
        j: usize,
        out: &mut [U],
        convert: impl Fn(T) -> U,
    ) -> Result<(), ComplianceError> {
        check_dofs(&[j], self.size)?;
        check_shape("rows of the column", out.len(), self.size)?;
        let own = j / PANEL_ROWS;
        for (value, column) in out[..j].iter_mut().zip(&self.panels[own]) {
            *value = convert(column.0[j % PANEL_ROWS]);
        }
        let mut row = j;
        for panel in &self.panels[own..] {
            let rows = &panel[j].0[row % PANEL_ROWS..];
            for (value, &entry) in out[row..].iter_mut().zip(rows) {
                *value = convert(entry);
            }
            row += rows.len();
        }
        Ok(())
    }

    /// The panels from the first row to the last.
    pub fn row_panels(&self) -> impl ExactSizeIterator<Item = Panel<'_, T>> {
        self.panels.iter().enumerate().map(|(panel, columns)| {
            let [first_row, end] = panel_rows(panel, self.size);
            Panel {
                first_row,
                rows: end - first_row,
                columns,
            }
        })
    }

    /// Hands out every column of every panel in order, to be filled as it was read from [`row_panels`](Self::row_panels);
    /// stops at the first failure.
    pub(super) fn for_each_column_mut<E>(&mut self, mut fill: impl FnMut(&mut [T]) -> Result<(), E>) -> Result<(), E> {
        self.panels
            .iter_mut()
            .flatten()
            .try_for_each(|column| fill(&mut column.0))
    }

    /// The panels to be written, from the last to the first, for threads to take one by one: later ones are longer.
    pub fn row_panels_mut(&mut self) -> impl IndexedParallelIterator<Item = PanelMut<'_, T>> {
        let size = self.size;
        let panels = self.panels.par_iter_mut().enumerate().rev().with_max_len(1);
        panels.map(move |(panel, columns)| {
            let [first_row, end] = panel_rows(panel, size);
            PanelMut {
                first_row,
                rows: end - first_row,
                columns,
            }
        })
    }
}

impl<T> fmt::Debug for Symmetric<T> {
    /// The size: entries are too many to read.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Symmetric")
            .field("size", &self.size)
            .finish_non_exhaustive()
    }
}

impl<T: PartialEq> PartialEq for Symmetric<T> {
    /// Compares what has a meaning.
    fn eq(&self, other: &Self) -> bool {
        let equal = |panel: usize| {
            let [first, end] = panel_rows(panel, self.size);
            (0..end).all(|j| {
                let rows = j.saturating_sub(first)..end - first;
                self.panels[panel][j].0[rows.clone()] == other.panels[panel][j].0[rows]
            })
        };
        self.size == other.size && (0..self.panels.len()).all(equal)
    }
}
