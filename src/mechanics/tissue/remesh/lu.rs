//! LU factorisation with partial pivoting of the small update matrices, with a condition estimate.

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::lu::partial_pivoting::{factor, solve};
use faer::linalg::matmul::matmul;
use faer::perm::PermRef;
use faer::prelude::ReborrowMut;
use faer::{Accum, MatMut, MatRef, Par};

use super::growable::{Growable, symmetrise};

/// Most steps of the condition estimate; it seldom takes more than two.
const ESTIMATE_STEPS: usize = 5;

/// Matrix and, once factored, its LU factors; the memory is reused.
#[derive(Default)]
pub(super) struct Lu {
    matrix: Growable,
    forward: Vec<u32>,
    inverse: Vec<u32>,
    memory: Option<MemBuffer>,
    probe: Growable,
}

impl Lu {
    /// Returns a matrix of `size` rows with arbitrary values, to be filled before [`factor`](Self::factor).
    pub(super) fn space(&mut self, size: usize) -> MatMut<'_, f64> {
        self.matrix.shape(size, size)
    }

    /// Factors the matrix and estimates its reciprocal condition number in the 1-norm: 1 at best, 0 for a singular
    /// matrix or one that is not finite.
    pub(super) fn factor(&mut self) -> f64 {
        let size = self.matrix.rows();
        if size == 0 {
            return 1.0;
        }
        let norm = norm_one(self.matrix.get());
        if !norm.is_finite() {
            return 0.0;
        }
        self.forward.resize(size, 0);
        self.inverse.resize(size, 0);
        let need = factor::lu_in_place_scratch::<u32, f64>(size, size, Par::Seq, Default::default());
        let stack = stack(&mut self.memory, need);
        factor::lu_in_place(
            self.matrix.get_mut(),
            &mut self.forward,
            &mut self.inverse,
            Par::Seq,
            stack,
            Default::default(),
        );
        let condition = norm * self.inverse_norm();
        if condition.is_finite() && condition > 0.0 {
            1.0 / condition
        } else {
            0.0
        }
    }

    /// Solves A X = B in place.
    pub(super) fn solve(&mut self, rhs: MatMut<'_, f64>) {
        self.solve_either(rhs, false);
    }

    /// Solves A^T X = B in place.
    pub(crate) fn solve_transpose(&mut self, rhs: MatMut<'_, f64>) {
        self.solve_either(rhs, true);
    }

    fn solve_either(&mut self, rhs: MatMut<'_, f64>, transpose: bool) {
        let size = self.matrix.rows();
        if size == 0 {
            return;
        }
        let factors = self.matrix.get();
        let order = PermRef::new_checked(&self.forward, &self.inverse, size);
        let need = solve::solve_in_place_scratch::<u32, f64>(size, rhs.ncols(), Par::Seq);
        let stack = stack(&mut self.memory, need);
        if transpose {
            solve::solve_transpose_in_place(factors, factors, order, rhs, Par::Seq, stack);
        } else {
            solve::solve_in_place(factors, factors, order, rhs, Par::Seq, stack);
        }
    }

    /// Returns a lower bound, seldom off by more than a factor of three, of the 1-norm of the inverse (W. W. Hager,
    /// "Condition estimates", SIAM J. Sci. Stat. Comput. 5, 1984; N. J. Higham, "FORTRAN codes for estimating the
    /// one-norm of a real or complex matrix", ACM TOMS 14, 1988).
    fn inverse_norm(&mut self) -> f64 {
        let size = self.matrix.rows();
        let mut probe = std::mem::take(&mut self.probe);
        probe.shape(size, 1).fill(1.0 / size as f64);
        let mut best = 0.0f64;
        let mut last_peak = None;
        for _ in 0..ESTIMATE_STEPS {
            self.solve(probe.get_mut());
            let norm = norm_one(probe.get());
            if norm <= best || norm.is_nan() {
                best = if norm.is_nan() { norm } else { best };
                break;
            }
            best = norm;
            let signs = probe.get_mut().col_mut(0);
            signs.iter_mut().for_each(|x| *x = f64::copysign(1.0, *x));
            self.solve_transpose(probe.get_mut());
            let steepest = largest(probe.get());
            if last_peak == Some(steepest) {
                break;
            }
            last_peak = Some(steepest);
            let mut unit = probe.get_mut();
            unit.fill(0.0);
            unit[(steepest, 0)] = 1.0;
        }
        // A growing vector of alternating signs catches matrices on which the ascent stalls.
        let steps = (size.max(2) - 1) as f64;
        for (i, x) in probe.get_mut().col_mut(0).iter_mut().enumerate() {
            *x = (1.0 + i as f64 / steps) * if i % 2 == 0 { 1.0 } else { -1.0 };
        }
        self.solve(probe.get_mut());
        let alternative = 2.0 * norm_one(probe.get()) / (3.0 * size as f64);
        self.probe = probe;
        if best.is_nan() || alternative.is_nan() {
            f64::NAN
        } else {
            best.max(alternative)
        }
    }

    pub(super) fn bytes(&self) -> usize {
        self.matrix.bytes() + self.memory.as_ref().map_or(0, |memory| memory.len())
    }
}

/// Computes D = (I + d H)^-1 d, exactly symmetric, for symmetric d and H of the same size, and returns the reciprocal
/// condition of I + d H. Where that is 0, `out` is undefined.
pub(super) fn capacitance(lu: &mut Lu, d: MatRef<'_, f64>, h: MatRef<'_, f64>, out: MatMut<'_, f64>) -> f64 {
    let mut out = out;
    let size = d.nrows();
    let mut matrix = lu.space(size);
    matmul(matrix.rb_mut(), Accum::Replace, d, h, 1.0, Par::Seq);
    for i in 0..size {
        matrix[(i, i)] += 1.0;
    }
    let condition = lu.factor();
    if condition == 0.0 {
        return condition;
    }
    out.copy_from(d);
    lu.solve(out.rb_mut());
    symmetrise(out);
    condition
}

/// Returns memory for `need` at any alignment, reused between calls.
fn stack(memory: &mut Option<MemBuffer>, need: StackReq) -> &mut MemStack {
    let bytes = need.unaligned_bytes_required();
    if memory.as_ref().is_none_or(|memory| memory.len() < bytes) {
        *memory = None;
    }
    MemStack::new(memory.get_or_insert_with(|| MemBuffer::new(StackReq::new::<u8>(bytes))))
}

/// Returns the largest absolute column sum; NaN if an entry is NaN.
fn norm_one(matrix: MatRef<'_, f64>) -> f64 {
    let sums = matrix
        .col_iter()
        .map(|column| column.iter().map(|x| x.abs()).sum::<f64>());
    sums.fold(0.0, |a, b| if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) })
}

/// Returns the row of the largest magnitude, the first of equals.
fn largest(column: MatRef<'_, f64>) -> usize {
    let values = column.col(0);
    (1..values.nrows()).fold(0, |best, i| if values[i].abs() > values[best].abs() { i } else { best })
}

#[cfg(test)]
mod tests;
