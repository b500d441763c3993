//! Small symmetric positive definite systems whose rows may nearly depend on each other.

/// The smallest pivot relative to its diagonal entry: where less is left of a row, its force is hardly determined beside the
/// others, and it is left out. Rounding divided by it still leaves forces better than 1e-7.
const DEPENDENT: f64 = 1e-9;

/// A Cholesky factor, column by column; the memory is kept for the next.
#[derive(Clone, Debug, Default)]
pub(super) struct Spd {
    size: usize,
    entries: Vec<f64>,
    /// Reciprocals of the diagonal of the factor; 0 for a row that is left out.
    scales: Vec<f64>,
}

impl Spd {
    /// Starts a matrix of zeros.
    pub fn start(&mut self, size: usize) {
        self.size = size;
        self.entries.clear();
        self.entries.resize(size * size, 0.0);
    }

    /// The entry below or on the diagonal.
    pub fn entry(&mut self, row: usize, column: usize) -> &mut f64 {
        debug_assert!(row >= column);
        &mut self.entries[column * self.size + row]
    }

    /// Factors the lower triangle in place. How many rows are left out as dependent.
    pub fn factor(&mut self) -> usize {
        let n = self.size;
        self.scales.clear();
        self.scales.extend((0..n).map(|j| self.entries[j * n + j]));
        let mut dependent = 0;
        for j in 0..n {
            let diagonal = self.scales[j];
            let (before, rest) = self.entries.split_at_mut(j * n);
            let column = &mut rest[j..n];
            for other in before.chunks_exact(n) {
                let factor = other[j];
                column.iter_mut().zip(&other[j..]).for_each(|(x, y)| *x -= factor * y);
            }
            let pivot = column[0];
            // A NaN is no pivot either.
            self.scales[j] = if pivot > DEPENDENT * diagonal {
                1.0 / pivot.sqrt()
            } else {
                0.0
            };
            dependent += usize::from(self.scales[j] == 0.0);
            let scale = self.scales[j];
            column.iter_mut().for_each(|x| *x *= scale);
            if scale == 0.0 {
                column.fill(0.0);
            }
        }
        dependent
    }

    /// Solves in place; rows left out come out as zero.
    pub fn solve(&self, x: &mut [f64]) {
        let n = self.size;
        debug_assert_eq!(x.len(), n);
        for j in 0..n {
            x[j] *= self.scales[j];
            let value = x[j];
            let below = &self.entries[j * n + j + 1..(j + 1) * n];
            x[j + 1..].iter_mut().zip(below).for_each(|(x, y)| *x -= value * y);
        }
        for j in (0..n).rev() {
            let below = &self.entries[j * n + j + 1..(j + 1) * n];
            let sum: f64 = x[j + 1..].iter().zip(below).map(|(x, y)| x * y).sum();
            x[j] = (x[j] - sum) * self.scales[j];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix(spd: &mut Spd, entries: &[&[f64]]) {
        spd.start(entries.len());
        for (i, row) in entries.iter().enumerate() {
            row.iter().enumerate().for_each(|(j, x)| *spd.entry(i, j) = *x);
        }
    }

    #[test]
    fn systems_are_solved_and_dependent_rows_left_out() {
        let mut spd = Spd::default();
        matrix(&mut spd, &[&[4.0], &[2.0, 5.0], &[2.0, 3.0, 6.0]]);
        assert_eq!(spd.factor(), 0);
        let mut x = [8.0 + 2.0, 4.0 + 3.0, 4.0 + 6.0];
        spd.solve(&mut x);
        assert!(
            x.iter()
                .zip([2.0, 0.0, 1.0])
                .all(|(x, expected): (&f64, f64)| (x - expected).abs() < 1e-14),
            "{x:?}"
        );

        // The second row is the first again.
        matrix(&mut spd, &[&[4.0], &[4.0, 4.0 + 1e-12], &[2.0, 2.0, 5.0]]);
        assert_eq!(spd.factor(), 1);
        let mut x = [10.0, 10.0, 9.0];
        spd.solve(&mut x);
        assert!(
            x.iter()
                .zip([2.0, 0.0, 1.0])
                .all(|(x, expected): (&f64, f64)| (x - expected).abs() < 1e-14),
            "{x:?}"
        );
        matrix(&mut spd, &[&[f64::NAN]]);
        assert_eq!(spd.factor(), 1);
        let mut x = [1.0];
        spd.solve(&mut x);
        assert_eq!(x, [0.0]);
    }
}
