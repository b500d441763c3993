//! Flexible generalised minimal residual method with right preconditioning (Y. Saad, SIAM Journal on Scientific
//! Computing 14, 1993).
//!
//! The consistent tangent is not symmetric where tissue is both compressed and stiffening; preconditioned by the
//! Cholesky factor of its symmetric part, it needs few iterations. The preconditioned directions are kept, so that a
//! factor in single precision, which is not exactly linear, converges as far as one in double.

use super::anderson::dot;

/// Largest number of directions; any remaining error is left to the next outer iteration.
const MAX: usize = 40;

/// Work vectors, reused between solves.
#[derive(Clone, Debug, Default)]
pub(super) struct Gmres {
    basis: Vec<Vec<f64>>,
    /// Columns of the triangular factor.
    columns: Vec<Vec<f64>>,
    /// Preconditioned directions of the basis.
    preconditioned: Vec<Vec<f64>>,
}

impl Gmres {
    /// Solves A x = b to a residual of `tolerance` relative to b; `rhs` becomes x. `apply(x, y)` writes A x to y,
    /// `precondition` multiplies a vector by about A^-1. Returns the number of applications of A.
    pub(super) fn solve(
        &mut self,
        rhs: &mut [f64],
        tolerance: f64,
        mut apply: impl FnMut(&[f64], &mut [f64]),
        mut precondition: impl FnMut(&mut [f64]),
    ) -> usize {
        let norm = dot(rhs, rhs).sqrt();
        // The right-hand side is zero or not finite.
        if norm == 0.0 || !norm.is_finite() {
            return 0;
        }
        room(&mut self.basis, 0, rhs.len());
        self.basis[0]
            .iter_mut()
            .zip(rhs.iter())
            .for_each(|(v, b)| *v = b / norm);
        let mut right = [0.0; MAX + 1];
        right[0] = norm;
        let mut rotations = [(1.0, 0.0); MAX];
        let mut used = 0;
        while used < MAX {
            room(&mut self.basis, used + 1, rhs.len());
            room(&mut self.preconditioned, used, rhs.len());
            let preconditioned = &mut self.preconditioned[used];
            // Preconditioning on the right leaves the residual that of A x = b, which the tolerance is about.
            preconditioned.copy_from_slice(&self.basis[used]);
            precondition(preconditioned);
            let (old, new) = self.basis.split_at_mut(used + 1);
            let next = &mut new[0];
            apply(preconditioned, next);
            if self.columns.len() == used {
                self.columns.push(vec![0.0; MAX + 1]);
            }
            let column = &mut self.columns[used];
            // One direction at a time, from what the ones before have left: all at once would lose their independence
            // to rounding.
            for (entry, direction) in column.iter_mut().zip(old.iter()) {
                *entry = dot(next, direction);
                let share = *entry;
                next.iter_mut().zip(direction).for_each(|(w, v)| *w -= share * v);
            }
            let left = dot(next, next).sqrt();
            // Rotations keep the small problem triangular: its residual is then known without the solution.
            for (index, &(c, s)) in rotations[..used].iter().enumerate() {
                (column[index], column[index + 1]) = (
                    c * column[index] + s * column[index + 1],
                    c * column[index + 1] - s * column[index],
                );
            }
            // The rotation that clears the entry below the diagonal passes its sine on to the residual.
            let length = column[used].hypot(left);
            if length == 0.0 || !length.is_finite() {
                break;
            }
            let (c, s) = (column[used] / length, left / length);
            rotations[used] = (c, s);
            column[used] = length;
            right[used + 1] = -s * right[used];
            right[used] *= c;
            used += 1;
            // Without a part left, the directions hold the solution: there is no next one.
            if right[used].abs() <= tolerance * norm || left == 0.0 {
                break;
            }
            next.iter_mut().for_each(|w| *w /= left);
        }
        // Back substitution in the triangular factor, only now: no step needs the shares of the directions.
        for index in (0..used).rev() {
            right[index] /= self.columns[index][index];
            for above in 0..index {
                right[above] -= self.columns[index][above] * right[index];
            }
        }
        // A sum of the directions as they were preconditioned, not the preconditioner of their sum: it is not exactly
        // linear.
        rhs.fill(0.0);
        for (share, direction) in right[..used].iter().zip(&self.preconditioned) {
            rhs.iter_mut().zip(direction).for_each(|(x, v)| *x += share * v);
        }
        used
    }
}

fn room(vectors: &mut Vec<Vec<f64>>, index: usize, length: usize) {
    if vectors.len() == index {
        vectors.push(Vec::new());
    }
    vectors[index].resize(length, 0.0);
}
