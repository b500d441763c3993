//! Cholesky factor of a stiffness matrix, and solutions with their residual.
//!
//! The factorisation is faer's sparse one (approximate minimum degree ordering, simplicial or supernodal depending on
//! fill), on one thread: at the sizes of tissue meshes a second thread makes it slower. Single precision halves the
//! times of factorisation and solution, for iterations that correct its errors.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltError;
use faer::sparse::linalg::cholesky::{
    LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{FaerError, SparseColMatRef};
use faer::{Conj, MatMut, MatRef, Par, Side};

use super::assembly::Stiffness;
use crate::tissue::error::LinearError;
use insonify_base::real::Real;

/// Backward error beyond which [`Factor::solve_refined`] takes a step of iterative refinement.
const REFINE_ABOVE: f64 = 1e-14;

/// Sparse symmetric matrix over free degrees of freedom, the input of a [`Factor`].
pub trait Symmetric {
    /// Lower triangle, rows ascending in each column.
    fn lower(&self) -> SparseColMatRef<'_, u32, f64>;

    /// Node and axis of a degree of freedom, for error messages.
    fn node_of(&self, dof: u32) -> (u32, u8);

    /// Writes the product of the matrix and `x` to `y`.
    ///
    /// # Panics
    /// If a slice does not have one entry per degree of freedom.
    fn product(&self, x: &[f64], y: &mut [f64]) {
        let lower = self.lower();
        let size = lower.ncols();
        assert!(x.len() == size && y.len() == size, "one entry a degree of freedom");
        let (starts, rows, values) = (lower.col_ptr(), lower.row_idx(), lower.val());
        y.fill(0.0);
        for column in 0..size {
            let span = starts[column] as usize..starts[column + 1] as usize;
            let factor = x[column];
            let mut sum = 0.0;
            for (&row, &value) in rows[span.clone()].iter().zip(&values[span]) {
                let row = row as usize;
                y[row] += value * factor;
                if row != column {
                    sum += value * x[row];
                }
            }
            y[column] += sum;
        }
    }
}

impl Symmetric for Stiffness {
    fn lower(&self) -> SparseColMatRef<'_, u32, f64> {
        Stiffness::lower(self)
    }

    fn node_of(&self, dof: u32) -> (u32, u8) {
        self.dofs().node_of(dof)
    }
}

impl<T: Symmetric> Symmetric for Arc<T> {
    fn lower(&self) -> SparseColMatRef<'_, u32, f64> {
        (**self).lower()
    }

    fn node_of(&self, dof: u32) -> (u32, u8) {
        (**self).node_of(dof)
    }
}

/// Factor L of K = L L^T in precision `R`, with its symbolic analysis for refactorisation with other values.
///
/// Threads can share it for solves: each borrows pooled scratch memory, so the steady state allocates nothing.
#[derive(Clone, Debug)]
pub struct Factor<R = f64> {
    symbolic: Arc<SymbolicCholesky<u32>>,
    /// Entries of the analysed lower triangle.
    entries: usize,
    /// Matrix values rounded to the factor's precision.
    rounded: Vec<R>,
    values: Vec<R>,
    /// Values of the next factorisation, so that a failure leaves the current factor unchanged.
    spare: Vec<R>,
    scratch: Scratch,
}

/// Scalar of a [`Factor`]: `f32` or `f64`. Its functions are those of faer, compiled here and not in every crate that
/// has a factor.
pub trait Precision: Real + faer::traits::RealField {
    #[doc(hidden)]
    fn factor(
        symbolic: &SymbolicCholesky<u32>,
        lower: SparseColMatRef<'_, u32, Self>,
        values: &mut [Self],
        stack: &mut MemStack,
    ) -> Result<(), LltError>;

    #[doc(hidden)]
    fn solve(symbolic: &SymbolicCholesky<u32>, values: &[Self], rhs: MatMut<'_, Self>, stack: &mut MemStack);
}

macro_rules! precision {
    ($($scalar:ty),*) => {
        $(impl Precision for $scalar {
            fn factor(
                symbolic: &SymbolicCholesky<u32>,
                lower: SparseColMatRef<'_, u32, Self>,
                values: &mut [Self],
                stack: &mut MemStack,
            ) -> Result<(), LltError> {
                let (sequential, regularised, options) = (Par::Seq, Default::default(), Default::default());
                symbolic
                    .factorize_numeric_llt(values, lower, Side::Lower, regularised, sequential, stack, options)
                    .map(drop)
            }

            fn solve(symbolic: &SymbolicCholesky<u32>, values: &[Self], rhs: MatMut<'_, Self>, stack: &mut MemStack) {
                LltRef::new(symbolic, values).solve_in_place_with_conj(Conj::No, rhs, Par::Seq, stack);
            }
        })*
    };
}

precision!(f32, f64);

/// Pivots of the Cholesky factor of a dense symmetric matrix, of which the lower triangle is read; `None` if it is not
/// positive definite.
pub fn pivots(matrix: MatRef<'_, f64>) -> Option<Vec<f64>> {
    let factor = matrix.llt(Side::Lower).ok()?;
    let lower = factor.L();
    Some((0..matrix.nrows()).map(|i| lower[(i, i)] * lower[(i, i)]).collect())
}

impl Factor {
    /// Analyses and factors a stiffness matrix.
    ///
    /// # Errors
    /// [`LinearError`] where the matrix is not positive definite or the factor does not fit into memory.
    pub fn new(stiffness: &dyn Symmetric) -> Result<Factor, LinearError> {
        Factor::analyse(stiffness)
    }
}

impl Factor<f32> {
    /// Analyses and factors a stiffness matrix in single precision.
    ///
    /// # Errors
    /// [`LinearError`] where the rounded matrix is not positive definite or the factor does not fit into memory.
    pub fn single(stiffness: &dyn Symmetric) -> Result<Factor<f32>, LinearError> {
        Factor::analyse(stiffness)
    }
}

impl<R: Precision> Factor<R> {
    fn analyse(stiffness: &dyn Symmetric) -> Result<Self, LinearError> {
        let size = stiffness.lower().ncols();
        let pattern = stiffness.lower().symbolic();
        let ordering = SymmetricOrdering::Amd;
        let symbolic = factorize_symbolic_cholesky(pattern, Side::Lower, ordering, Default::default())
            .map_err(|_: FaerError| LinearError::FactorMemory { size, bytes: None })?;
        let mut factor = Factor {
            symbolic: Arc::new(symbolic),
            entries: pattern.row_idx().len(),
            rounded: Vec::new(),
            values: Vec::new(),
            spare: Vec::new(),
            scratch: Scratch::default(),
        };
        factor.refactor(stiffness)?;
        Ok(factor)
    }

    /// Refactors with a matrix of the same pattern: other positions or materials, but the same elements and degrees of
    /// freedom.
    ///
    /// # Errors
    /// [`LinearError`]; the factor is then unchanged.
    pub fn refactor(&mut self, stiffness: &dyn Symmetric) -> Result<(), LinearError> {
        self.check_pattern(stiffness)?;
        let length = self.symbolic.len_val();
        let memory = LinearError::FactorMemory {
            size: self.size(),
            bytes: length.checked_mul(size_of::<R>()),
        };
        // Into spare memory: a matrix that is not positive definite leaves the factor as it was.
        if self.spare.len() != length {
            let needed = length.saturating_mul(size_of::<R>());
            if insonify_base::memory::available().is_some_and(|available| needed > available) {
                return Err(memory);
            }
            self.spare.try_reserve_exact(length).map_err(|_| memory.clone())?;
            self.spare.resize(length, R::of(0.0));
        }
        let lower = stiffness.lower();
        self.rounded.clear();
        self.rounded.extend(lower.val().iter().map(|entry| R::of(*entry)));
        let lower = SparseColMatRef::new(lower.symbolic(), &self.rounded[..]);
        let need = self
            .symbolic
            .factorize_numeric_llt_scratch::<R>(Par::Seq, Default::default());
        let result = self
            .scratch
            .with(need, |stack| R::factor(&self.symbolic, lower, &mut self.spare, stack));
        match result {
            None => Err(memory),
            Some(Err(LltError::NonPositivePivot { index })) => Err(self.bad_pivot(stiffness, index)),
            Some(Ok(())) => {
                std::mem::swap(&mut self.values, &mut self.spare);
                Ok(())
            }
        }
    }

    fn check_pattern(&self, stiffness: &dyn Symmetric) -> Result<(), LinearError> {
        let lower = stiffness.lower();
        let (found, found_entries) = (lower.ncols(), lower.row_idx().len());
        let (expected, expected_entries) = (self.size(), self.entries);
        if (found, found_entries) == (expected, expected_entries) {
            return Ok(());
        }
        Err(LinearError::Pattern {
            found,
            found_entries,
            expected,
            expected_entries,
        })
    }

    /// Returns the error for a pivot of the permuted matrix, with its degree of freedom.
    fn bad_pivot(&self, stiffness: &dyn Symmetric, index: usize) -> LinearError {
        // faer counts columns from 1 in the simplicial factorisation, from 0 in the supernodal one.
        let column = match self.symbolic.raw() {
            SymbolicCholeskyRaw::Simplicial(_) => index.saturating_sub(1),
            SymbolicCholeskyRaw::Supernodal(_) => index,
        };
        let dof = match self.symbolic.perm() {
            Some(order) => order.arrays().0[column],
            None => column as u32,
        };
        let (node, axis) = stiffness.node_of(dof);
        LinearError::NotPositiveDefinite { node, axis }
    }

    /// Number of degrees of freedom.
    pub fn size(&self) -> usize {
        self.symbolic.nrows()
    }

    /// Number of stored entries of L.
    pub fn entries(&self) -> usize {
        self.symbolic.len_val()
    }

    /// Solves K x = b in place: `rhs` (N) becomes the solution (mm).
    ///
    /// # Panics
    /// If `rhs` does not have one entry per degree of freedom, or scratch memory of that size cannot be allocated.
    pub fn solve_in_place(&self, rhs: &mut [R]) {
        let rows = rhs.len();
        self.solve_many_in_place(MatMut::from_column_major_slice_mut(rhs, rows, 1));
    }

    /// Solves K X = B in place for many right-hand sides, one per column (N), which become the solutions (mm).
    ///
    /// # Panics
    /// If `rhs` does not have one row per degree of freedom, or scratch memory of twice that size cannot be allocated.
    pub fn solve_many_in_place(&self, rhs: MatMut<'_, R>) {
        assert_eq!(rhs.nrows(), self.size(), "one row a degree of freedom");
        let need = self.symbolic.solve_in_place_scratch::<R>(rhs.ncols(), Par::Seq);
        let done = self.scratch.with(need, |stack| {
            R::solve(&self.symbolic, &self.values, rhs, stack);
        });
        assert!(done.is_some(), "no memory for a solve");
    }
}

impl Factor {
    /// Solves K x = b (N, mm) with one step of iterative refinement where the residual exceeds 1e-14.
    /// Returns the solution and its residual.
    ///
    /// The residual is the normwise backward error |b - K x| / (|K| |x| + |b|) in maximum norms (J. L. Rigal and J.
    /// Gaches, "On the compatibility of a given solution with the data of a linear system", JACM 14, 1967): the least
    /// relative change of K and b for which x is exact.
    ///
    /// # Panics
    /// If `rhs` does not have one entry per degree of freedom, or the matrix has another size.
    pub fn solve_refined(&self, stiffness: &Stiffness, rhs: &[f64]) -> (Vec<f64>, f64) {
        let mut solution = rhs.to_vec();
        self.solve_in_place(&mut solution);
        let (mut correction, residual) = defect(stiffness, &solution, rhs);
        if residual <= REFINE_ABOVE {
            return (solution, residual);
        }
        self.solve_in_place(&mut correction);
        correction
            .iter_mut()
            .zip(&solution)
            .for_each(|(better, x)| *better += x);
        let (_, refined) = defect(stiffness, &correction, rhs);
        if refined < residual {
            (correction, refined)
        } else {
            (solution, residual)
        }
    }
}

/// Returns b - K x and its backward error.
fn defect(stiffness: &Stiffness, solution: &[f64], rhs: &[f64]) -> (Vec<f64>, f64) {
    let mut defect = vec![0.0; rhs.len()];
    stiffness.multiply(solution, &mut defect);
    defect
        .iter_mut()
        .zip(rhs)
        .for_each(|(product, b)| *product = b - *product);
    let largest = |values: &[f64]| {
        values.iter().fold(0.0, |a: f64, x| {
            if a.is_nan() || x.is_nan() {
                f64::NAN
            } else {
                a.max(x.abs())
            }
        })
    };
    let (top, scale) = (
        largest(&defect),
        stiffness.norm_inf() * largest(solution) + largest(rhs),
    );
    let residual = if top == 0.0 { 0.0 } else { top / scale };
    (defect, residual)
}

/// Buffers that are not in use.
#[derive(Default)]
pub struct Scratch(Mutex<Vec<MemBuffer>>);

impl Scratch {
    /// Runs `work` on a stack of size `need`; `None` if that memory cannot be allocated.
    pub fn with<T>(&self, need: StackReq, work: impl FnOnce(&mut MemStack) -> T) -> Option<T> {
        let mut buffer = match self.store().pop().filter(|buffer| fits(buffer, need)) {
            Some(buffer) => buffer,
            None => MemBuffer::try_new(need).ok()?,
        };
        let result = work(MemStack::new(&mut buffer));
        self.store().push(buffer);
        Some(result)
    }

    fn store(&self) -> std::sync::MutexGuard<'_, Vec<MemBuffer>> {
        // A panic elsewhere leaves the list intact.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn fits(buffer: &MemBuffer, need: StackReq) -> bool {
    buffer.len() >= need.unaligned_bytes_required()
}

/// A clone starts without buffers.
impl Clone for Scratch {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl fmt::Debug for Scratch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Scratch({} buffers)", self.store().len())
    }
}

#[cfg(test)]
mod tests;
