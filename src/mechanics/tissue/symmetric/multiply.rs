//! Products with a vector; every entry is read once, for its row and its column.

use crate::mechanics::tissue::error::LinearError;
use rayon::prelude::*;

use super::{Column, PANEL_ROWS, Scalar, Symmetric, panel_rows};
use crate::base::simd::{Simd, WithSimd, dispatch};
use crate::mechanics::tissue::compliance::check_shape;

/// Number of parts of a product, independent of the number of threads: their sums are added in order, so the result is
/// the same on any number. At most as many threads have work.
const PARTS: usize = 16;
/// Columns read together.
const WIDTH: usize = 4;

impl<T: Scalar> Symmetric<T> {
    /// Computes y = A x on the current rayon pool.
    ///
    /// # Errors
    /// [`LinearError::Shape`] when a length is wrong.
    pub fn multiply(&self, x: &[T], y: &mut [T]) -> Result<(), LinearError> {
        check_shape("values of x", x.len(), self.size)?;
        check_shape("values of y", y.len(), self.size)?;
        let parts: Vec<Vec<T>> = self
            .parts()
            .into_par_iter()
            .with_max_len(1)
            .map(|part| self.part(part, x))
            .collect();
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
            let [first, end] = panel_rows(panel, self.size);
            let mut own = Column([T::of(0.0); PANEL_ROWS]);
            own.0[..end - first].copy_from_slice(&x[first..end]);
            let mut rows = Column([T::of(0.0); PANEL_ROWS]);
            let (left, diagonal) = self.panels[panel].split_at(first);
            dispatch(Left {
                columns: left,
                x: &x[..first],
                own: &own,
                y: &mut y[..first],
                rows: &mut rows,
            });
            for (j, column) in diagonal.iter().enumerate() {
                let below = j + 1..end - first;
                rows.0[j] += column.0[j] * own.0[j];
                for i in below {
                    rows.0[i] += column.0[i] * own.0[j];
                    rows.0[j] += column.0[i] * own.0[i];
                }
            }
            y[first..].iter_mut().zip(&rows.0).for_each(|(y, &value)| *y += value);
        }
        y
    }
}

/// Columns of a panel left of its diagonal block: rows += A x and y += A^T own.
struct Left<'a, T> {
    columns: &'a [Column<T>],
    x: &'a [T],
    own: &'a Column<T>,
    y: &'a mut [T],
    rows: &'a mut Column<T>,
}

impl<T: Scalar> WithSimd for Left<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        // Left of the diagonal block there are as many columns as rows in the panels before: a multiple of WIDTH.
        let groups = self.columns.as_chunks::<WIDTH>().0.iter();
        let own = T::vectors::<S>(&self.own.0);
        let rows = T::vectors_mut::<S>(&mut self.rows.0);
        for ((columns, x), y) in groups
            .zip(self.x.as_chunks::<WIDTH>().0)
            .zip(self.y.as_chunks_mut::<WIDTH>().0)
        {
            let columns: [_; WIDTH] = std::array::from_fn(|j| T::vectors::<S>(&columns[j].0));
            let x: [_; WIDTH] = std::array::from_fn(|j| T::splat(simd, x[j]));
            let mut sums = [T::splat(simd, T::of(0.0)); WIDTH];
            for i in 0..own.len() {
                for j in 0..WIDTH {
                    rows[i] = T::multiply_add(simd, columns[j][i], x[j], rows[i]);
                    sums[j] = T::multiply_add(simd, columns[j][i], own[i], sums[j]);
                }
            }
            for j in 0..WIDTH {
                y[j] += T::total(simd, sums[j]);
            }
        }
    }
}
