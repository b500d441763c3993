//! Small dense matrices that grow and shrink with few allocations.

use faer::prelude::ReborrowMut;
use faer::{Mat, MatMut, MatRef};

/// Matrix whose memory at least doubles when outgrown and is kept when the matrix shrinks.
#[derive(Clone, Debug)]
pub(super) struct Growable {
    space: Mat<f64>,
    rows: usize,
    columns: usize,
}

impl Default for Growable {
    fn default() -> Self {
        Growable {
            space: Mat::new(),
            rows: 0,
            columns: 0,
        }
    }
}

impl Growable {
    /// Creates an empty matrix with memory for this size.
    pub(crate) fn with_room(rows: usize, columns: usize) -> Growable {
        let mut grown = Growable::default();
        grown.shape(rows, columns).fill(0.0);
        (grown.rows, grown.columns) = (0, 0);
        grown
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    pub(super) fn bytes(&self) -> usize {
        self.space.nrows() * self.space.ncols() * size_of::<f64>()
    }

    pub(super) fn get(&self) -> MatRef<'_, f64> {
        self.space.as_ref().submatrix(0, 0, self.rows, self.columns)
    }

    pub(super) fn get_mut(&mut self) -> MatMut<'_, f64> {
        self.space.as_mut().submatrix_mut(0, 0, self.rows, self.columns)
    }

    /// Resizes the matrix; remaining entries keep their values, new ones are arbitrary.
    pub(super) fn shape(&mut self, rows: usize, columns: usize) -> MatMut<'_, f64> {
        let (tall, wide) = (self.space.nrows(), self.space.ncols());
        if rows > tall || columns > wide {
            let enough = |need: usize, have: usize| if need > have { need.max(2 * have) } else { have };
            // An odd number of cache lines between columns avoids cache conflicts.
            let tall = (enough(rows, tall).div_ceil(8) | 1) * 8;
            let mut space = Mat::zeros(tall, enough(columns, wide));
            let kept = self.get();
            space
                .as_mut()
                .submatrix_mut(0, 0, kept.nrows(), kept.ncols())
                .copy_from(kept);
            self.space = space;
        }
        (self.rows, self.columns) = (rows, columns);
        self.get_mut()
    }

    /// Resizes as [`shape`](Self::shape) does, with zeros in the new rows and columns.
    pub(super) fn extend(&mut self, rows: usize, columns: usize) {
        let (old_rows, old_columns) = (self.rows.min(rows), self.columns.min(columns));
        let mut matrix = self.shape(rows, columns);
        matrix.rb_mut().get_mut(old_rows.., ..).fill(0.0);
        matrix.get_mut(..old_rows, old_columns..).fill(0.0);
    }

    /// Removes a row; the last one takes its place.
    pub(crate) fn take_row(&mut self, row: usize) {
        let last_row = self.rows - 1;
        for mut column in self.get_mut().col_iter_mut() {
            column[row] = column[last_row];
        }
        self.rows = last_row;
    }

    /// Removes a column; the last one takes its place.
    pub(crate) fn take_column(&mut self, column: usize) {
        let last_column = self.columns - 1;
        if column < last_column {
            let (mut left, right) = self.get_mut().split_at_col_mut(last_column);
            left.rb_mut().col_mut(column).copy_from(right.col(0));
        }
        self.columns = last_column;
    }
}

/// Copies the lower triangle to the upper.
pub(super) fn mirror(mut matrix: MatMut<'_, f64>) {
    // In blocks, as row entries of a large matrix are far apart.
    const BLOCK: usize = 16;
    let size = matrix.nrows();
    for block_start in (0..size).step_by(BLOCK) {
        for left in (0..=block_start).step_by(BLOCK) {
            for j in left..(left + BLOCK).min(size) {
                for i in block_start.max(j + 1)..(block_start + BLOCK).min(size) {
                    matrix[(j, i)] = matrix[(i, j)];
                }
            }
        }
    }
}

/// Replaces a nearly symmetric matrix by the mean of itself and its transpose.
pub(super) fn symmetrise(mut matrix: MatMut<'_, f64>) {
    for j in 0..matrix.ncols() {
        for i in j + 1..matrix.nrows() {
            let mean = 0.5 * (matrix[(i, j)] + matrix[(j, i)]);
            matrix[(i, j)] = mean;
            matrix[(j, i)] = mean;
        }
    }
}

#[cfg(test)]
mod tests;
