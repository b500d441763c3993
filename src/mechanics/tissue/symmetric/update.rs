//! Symmetric updates A -= Y C Y^T: the change of an inverse by the matrix inversion lemma, in full (level I) or in some
//! rows and columns (levels II and III).

use crate::tissue::error::LinearError;
use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};

use super::{Column, PANEL_ROWS, Scalar, Symmetric, panel_rows};
use crate::tissue::compliance::{check_distinct, check_dofs, check_shape};
use insonify_base::parallel::{chunks_mut, for_each, for_each_init};
use insonify_base::simd::{Simd, WithSimd, dispatch};

/// Columns of the matrix that a tile covers.
const WIDTH: usize = 8;
/// Registers of rows that a tile covers: with eight columns 16 of them accumulate, which hides the latency of two fused
/// multiply-adds per cycle and leaves registers for the operands.
const DEPTH: usize = 2;

impl<T: Scalar> Symmetric<T> {
    /// Computes A -= Y C Y^T with Y (size by s) and C (s by s, symmetric), on the lower triangle only: size^2 s
    /// operations. It runs on the current pool; the result does not depend on the number of threads.
    ///
    /// # Errors
    /// [`LinearError::Shape`] when Y or C has the wrong shape; the matrix is then unchanged.
    pub fn rank_update(&mut self, y: MatRef<'_, T>, c: MatRef<'_, T>) -> Result<(), LinearError> {
        let rank = self.check_update(y, c)?;
        if rank == 0 {
            return Ok(());
        }
        let z = packed_product(y, c);
        for_each_init(self.row_panels_mut(), &Vec::new, &|rows, panel| {
            rows.clear();
            let panel_rows = panel.first_row..panel.first_row + panel.rows;
            rows.extend((0..rank).map(|k| packed_column(y, panel_rows.clone(), k)));
            dispatch(Update {
                columns: panel.columns,
                y: rows,
                z: &z,
            });
        });
        Ok(())
    }

    /// Computes A -= Y C Y^T in the given rows and columns only. Operands are those of
    /// [`rank_update`](Self::rank_update); it takes size s operations per row.
    ///
    /// # Errors
    /// [`LinearError`] when Y or C has the wrong shape, or a row is out of range or repeated; the matrix is then
    /// unchanged.
    pub fn update_rows(&mut self, rows: &[usize], y: MatRef<'_, T>, c: MatRef<'_, T>) -> Result<(), LinearError> {
        let rank = self.check_update(y, c)?;
        check_dofs(rows, self.size)?;
        check_distinct(rows)?;
        let mut sorted = rows.to_vec();
        sorted.sort_unstable();
        if rank == 0 || rows.is_empty() {
            return Ok(());
        }
        let changes = changes(y, c, &sorted);
        for_each(self.row_panels_mut(), &|panel| {
            let panel_rows = panel.first_row..panel.first_row + panel.rows;
            let offset = panel.first_row / PANEL_ROWS * sorted.len();
            // Columns: contiguous. Pairs of given rows are changed here.
            for (&column, change) in sorted
                .iter()
                .zip(&changes[offset..])
                .take_while(|pair| *pair.0 < panel_rows.end)
            {
                let first_row = column.saturating_sub(panel_rows.start);
                let values = &mut panel.columns[column].0[first_row..];
                values
                    .iter_mut()
                    .zip(&change.0[first_row..])
                    .for_each(|(value, &change)| *value -= change);
            }
            // Rows: one value per column; the given rows of a panel share its cache lines.
            let named = sorted.partition_point(|&row| row < panel_rows.start)
                ..sorted.partition_point(|&row| row < panel_rows.end);
            if named.is_empty() {
                return;
            }
            let mut next = 0;
            for (j, column) in panel.columns.iter_mut().enumerate() {
                if sorted.get(next) == Some(&j) {
                    next += 1;
                    continue;
                }
                for q in named.clone().filter(|&q| sorted[q] > j) {
                    column.0[sorted[q] - panel_rows.start] -=
                        changes[j / PANEL_ROWS * sorted.len() + q].0[j % PANEL_ROWS];
                }
            }
        });
        Ok(())
    }

    /// Checks the operands of an update and returns its rank.
    fn check_update(&self, y: MatRef<'_, T>, c: MatRef<'_, T>) -> Result<usize, LinearError> {
        check_shape("rows of Y", y.nrows(), self.size)?;
        check_shape("rows of C", c.nrows(), y.ncols())?;
        check_shape("columns of C", c.ncols(), y.ncols())?;
        Ok(y.ncols())
    }
}

/// Returns rows of column `k` of Y, padded with zeros to a panel.
fn packed_column<T: Scalar>(y: MatRef<'_, T>, rows: Range<usize>, k: usize) -> Column<T> {
    let mut column = Column([T::of(0.0); PANEL_ROWS]);
    let values = y.col(k).subrows(rows.start, rows.len());
    column
        .0
        .iter_mut()
        .zip(values.iter())
        .for_each(|(to, &from)| *to = from);
    column
}

/// Computes Z = Y C in the layout of the tiles: for each group of [`WIDTH`] rows, their values in the s columns, padded
/// with zeros.
fn packed_product<T: Scalar>(y: MatRef<'_, T>, c: MatRef<'_, T>) -> Vec<[T; WIDTH]> {
    let [size, rank] = [y.nrows(), y.ncols()];
    let mut z = vec![[T::of(0.0); WIDTH]; size.div_ceil(WIDTH) * rank];
    for_each((0.., chunks_mut(&mut z, PANEL_ROWS / WIDTH * rank)), &|(panel, z)| {
        let [first, end] = panel_rows(panel, size);
        let mut block = Mat::<T>::zeros(end - first, rank);
        product(block.as_mut(), y.subrows(first, end - first), c);
        for k in 0..rank {
            for (i, &value) in block.col(k).iter().enumerate() {
                z[i / WIDTH * rank + k][i % WIDTH] = value;
            }
        }
    });
    z
}

/// Computes W = Y C Y[rows]^T by panels of rows: one column for each given row.
fn changes<T: Scalar>(y: MatRef<'_, T>, c: MatRef<'_, T>, rows: &[usize]) -> Vec<Column<T>> {
    let [size, rank] = [y.nrows(), y.ncols()];
    let selected = Mat::from_fn(rows.len(), rank, |i, k| y[(rows[i], k)]);
    let mut z = Mat::<T>::zeros(rows.len(), rank);
    product(z.as_mut(), selected.as_ref(), c);
    let mut changes = vec![Column([T::of(0.0); PANEL_ROWS]); size.div_ceil(PANEL_ROWS) * rows.len()];
    for_each((0.., chunks_mut(&mut changes, rows.len())), &|(panel, changes)| {
        let [first, end] = panel_rows(panel, size);
        let mut block = Mat::<T>::zeros(end - first, rows.len());
        product(block.as_mut(), y.subrows(first, end - first), z.transpose());
        for (column, change) in block.col_iter().zip(changes) {
            change
                .0
                .iter_mut()
                .zip(column.iter())
                .for_each(|(to, &from)| *to = from);
        }
    });
    changes
}

/// Computes out = A B on this thread.
fn product<T: Scalar>(out: MatMut<'_, T>, a: MatRef<'_, T>, b: MatRef<'_, T>) {
    matmul(out, Accum::Replace, a, b, T::of(1.0), Par::Seq);
}

/// Update of one panel: its columns minus Y_p Z^T.
struct Update<'a, T> {
    columns: &'a mut [Column<T>],
    y: &'a [Column<T>],
    z: &'a [[T; WIDTH]],
}

impl<T: Scalar> WithSimd for Update<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (groups, single_columns) = self.columns.as_chunks_mut::<WIDTH>();
        let mut z = self.z.chunks_exact(self.y.len());
        for (group, z) in groups.iter_mut().zip(&mut z) {
            if S::REGISTER_COUNT >= 32 {
                tiles::<T, S, WIDTH>(simd, group, self.y, z, 0);
            } else {
                let (halves, _) = group.as_chunks_mut::<{ WIDTH / 2 }>();
                for (half, columns) in halves.iter_mut().enumerate() {
                    tiles::<T, S, { WIDTH / 2 }>(simd, columns, self.y, z, half * WIDTH / 2);
                }
            }
        }
        if let Some(z) = z.next() {
            for (index, column) in single_columns.iter_mut().enumerate() {
                tiles::<T, S, 1>(simd, std::array::from_mut(column), self.y, z, index);
            }
        }
    }
}

/// Updates a few columns from the first row of the panel to the last. `from` is the place of the first in its group.
#[inline(always)]
fn tiles<T: Scalar, S: Simd, const COLUMNS: usize>(
    simd: S,
    columns: &mut [Column<T>; COLUMNS],
    y: &[Column<T>],
    z: &[[T; WIDTH]],
    from: usize,
) {
    let depth = size_of::<T::Vector<S>>() / size_of::<T>() * DEPTH;
    for tile in 0..PANEL_ROWS / depth {
        // The sums stay in registers for all of Y, so that the matrix is read and written once.
        let mut sums = [[T::splat(simd, T::of(0.0)); DEPTH]; COLUMNS];
        for (y, z) in y.iter().zip(z) {
            let y = &T::vectors::<S>(&y.0).as_chunks::<DEPTH>().0[tile];
            for j in 0..COLUMNS {
                let z = T::splat(simd, z[from + j]);
                for i in 0..DEPTH {
                    sums[j][i] = T::multiply_add(simd, y[i], z, sums[j][i]);
                }
            }
        }
        for (column, sums) in columns.iter_mut().zip(sums) {
            let values = &mut T::vectors_mut::<S>(&mut column.0).as_chunks_mut::<DEPTH>().0[tile];
            for i in 0..DEPTH {
                values[i] = T::difference(simd, values[i], sums[i]);
            }
        }
    }
}
