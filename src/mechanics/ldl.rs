//! Dense LDL^T factorisation of small symmetric systems, without pivoting.
//!
//! Definite matrices need no pivoting. Those of needles that would buckle without support are indefinite; the number of
//! negative pivots shows whether tissue supports them (Sylvester's law of inertia). Each solution is one step of an
//! iteration, which corrects its rounding errors.

use insonify_base::simd::{Kernel, vectorised};

/// Smallest pivot relative to its diagonal entry. Below it, an unknown is nearly dependent on the earlier ones and is
/// dropped. Divisions by larger pivots keep forces accurate to better than 1e-7.
const DEPENDENT: f64 = 1e-9;

/// Factor stored column by column; its memory is reused by the next factorisation.
#[derive(Clone, Debug, Default)]
pub(crate) struct Ldl {
    size: usize,
    entries: Vec<f64>,
    /// Reciprocals of D; 0 for a dropped row.
    reciprocals: Vec<f64>,
}

/// Counts of dependent and negative pivots in D.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Signs {
    /// Rows dropped as dependent on earlier rows.
    pub dependent: usize,
    /// Negative pivots.
    pub negative: usize,
}

impl Ldl {
    /// Resets to a zero matrix of `size` rows.
    pub(crate) fn start(&mut self, size: usize) {
        self.size = size;
        self.entries.clear();
        self.entries.resize(size * size, 0.0);
    }

    /// Returns the entry on or below the diagonal.
    pub(crate) fn entry(&mut self, row: usize, column: usize) -> &mut f64 {
        debug_assert!(row >= column);
        &mut self.entries[column * self.size + row]
    }

    /// Factors the lower triangle in place.
    pub(crate) fn factor(&mut self) -> Signs {
        vectorised(Factor(self))
    }

    /// Solves in place; unknowns of dropped rows are zero.
    pub(crate) fn solve(&self, x: &mut [f64]) {
        let n = self.size;
        self.forward(x, 1);
        for j in (0..n).rev() {
            let below = &self.entries[j * n + j + 1..(j + 1) * n];
            let sum: f64 = x[j + 1..].iter().zip(below).map(|(x, y)| x * y).sum();
            let scaled = x[j] * self.reciprocals[j];
            x[j] = if self.reciprocals[j] == 0.0 { 0.0 } else { scaled - sum };
        }
    }

    /// Solves for `width` right-hand sides in place, stored row by row; unknowns of dropped rows are zero.
    pub(crate) fn solve_rows(&self, x: &mut [f64], width: usize) {
        self.forward(x, width);
        vectorised(Backward(self, x, width));
    }

    /// Computes `L^-1 X` in place for X of `width` columns, stored row by row.
    pub(crate) fn forward(&self, x: &mut [f64], width: usize) {
        debug_assert_eq!(x.len(), self.size * width);
        vectorised(Forward(self, x, width));
    }

    /// Reciprocals of D; 0 for a dropped row.
    pub(crate) fn reciprocals(&self) -> &[f64] {
        &self.reciprocals
    }
}

struct Factor<'a>(&'a mut Ldl);

impl Kernel for Factor<'_> {
    type Output = Signs;

    #[inline(always)]
    fn run(self) -> Signs {
        let Ldl {
            size: n,
            ref mut entries,
            ref mut reciprocals,
        } = *self.0;
        reciprocals.clear();
        let mut signs = Signs::default();
        for j in 0..n {
            let (before, from_column) = entries.split_at_mut(j * n);
            let column = &mut from_column[j..n];
            let diagonal = column[0].abs();
            for (earlier, reciprocal) in before.chunks_exact(n).zip(reciprocals.iter()) {
                // A dropped row has a column of zeros.
                let pivot = if *reciprocal == 0.0 { 0.0 } else { 1.0 / reciprocal };
                let factor = earlier[j] * pivot;
                column.iter_mut().zip(&earlier[j..]).for_each(|(x, y)| *x -= factor * y);
            }
            let pivot = column[0];
            // A NaN is not a usable pivot either.
            if pivot.abs() > DEPENDENT * diagonal && pivot.is_finite() {
                signs.negative += usize::from(pivot < 0.0);
                reciprocals.push(1.0 / pivot);
                column.iter_mut().for_each(|x| *x /= pivot);
            } else {
                signs.dependent += 1;
                reciprocals.push(0.0);
                column.fill(0.0);
            }
        }
        signs
    }
}

struct Forward<'a>(&'a Ldl, &'a mut [f64], usize);

impl Kernel for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Forward(Ldl { size: n, entries, .. }, x, width) = self;
        for j in 0..*n {
            let (done, below) = x.split_at_mut((j + 1) * width);
            let row = &done[j * width..];
            let factors = &entries[j * n + j + 1..(j + 1) * n];
            for (factor, lower_row) in factors.iter().zip(below.chunks_exact_mut(width)) {
                lower_row.iter_mut().zip(row).for_each(|(x, y)| *x -= factor * y);
            }
        }
    }
}

struct Backward<'a>(&'a Ldl, &'a mut [f64], usize);

impl Kernel for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Backward(ldl, x, width) = self;
        let n = ldl.size;
        for j in (0..n).rev() {
            let (above, below) = x.split_at_mut((j + 1) * width);
            let row = &mut above[j * width..];
            let reciprocal = ldl.reciprocals[j];
            row.iter_mut().for_each(|x| *x *= reciprocal);
            if reciprocal == 0.0 {
                row.fill(0.0);
                continue;
            }
            let factors = &ldl.entries[j * n + j + 1..(j + 1) * n];
            for (factor, lower_row) in factors.iter().zip(below.chunks_exact(width)) {
                row.iter_mut().zip(lower_row).for_each(|(x, y)| *x -= factor * y);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn factored(entries: &[&[f64]]) -> (Ldl, Signs) {
        let mut ldl = Ldl::default();
        ldl.start(entries.len());
        for (i, row) in entries.iter().enumerate() {
            row.iter().enumerate().for_each(|(j, x)| *ldl.entry(i, j) = *x);
        }
        let signs = ldl.factor();
        (ldl, signs)
    }

    fn assert_solves(ldl: &Ldl, mut right: [f64; 3], expected: [f64; 3]) {
        ldl.solve(&mut right);
        let near = |(x, expected): (&f64, f64)| (x - expected).abs() < 1e-14;
        assert!(right.iter().zip(expected).all(near), "{right:?}");
    }

    #[test]
    fn systems_are_solved_and_dependent_rows_left_out() {
        let (ldl, signs) = factored(&[&[4.0], &[2.0, 5.0], &[2.0, 3.0, 6.0]]);
        assert_eq!(signs, Signs::default());
        assert_solves(&ldl, [10.0, 7.0, 10.0], [2.0, 0.0, 1.0]);

        // The second row repeats the first.
        let (ldl, signs) = factored(&[&[4.0], &[4.0, 4.0 + 1e-12], &[2.0, 2.0, 5.0]]);
        assert_eq!((signs.dependent, signs.negative), (1, 0));
        assert_solves(&ldl, [10.0, 10.0, 9.0], [2.0, 0.0, 1.0]);
        let (ldl, signs) = factored(&[&[f64::NAN]]);
        assert_eq!((signs.dependent, signs.negative), (1, 0));
        let mut x = [1.0];
        ldl.solve(&mut x);
        assert_eq!(x, [0.0]);
    }

    #[test]
    fn indefinite_systems_are_solved_and_their_signs_counted() {
        // The determinants of the leading minors are 1, -3 and -15.
        let (ldl, signs) = factored(&[&[1.0], &[2.0, 1.0], &[-1.0, 1.0, 3.0]]);
        assert_eq!((signs.dependent, signs.negative), (0, 1));
        assert_solves(&ldl, [6.0, 3.0, -2.0], [1.0, 2.0, -1.0]);
    }

    #[test]
    fn rows_of_several_columns_go_forward_together() {
        let (ldl, _) = factored(&[&[4.0], &[2.0, 5.0], &[2.0, 3.0, 6.0]]);
        let mut x = [1.0, 8.0, 2.0, 4.0, 3.0, 0.0];
        ldl.forward(&mut x, 2);
        for column in 0..2 {
            let mut single = [1.0, 2.0, 3.0, 8.0, 4.0, 0.0];
            let single = &mut single[3 * column..3 * column + 3];
            ldl.forward(single, 1);
            assert_eq!([x[column], x[2 + column], x[4 + column]], single);
        }
        let mut x = [10.0, 4.0, 7.0, 2.0, 10.0, 2.0];
        ldl.solve_rows(&mut x, 2);
        for (x, expected) in x.iter().zip([2.0, 1.0, 0.0, 0.0, 1.0, 0.0]) {
            assert!((x - expected).abs() < 1e-14, "{x} {expected}");
        }
    }
}
