//! Cholesky factor for iterations, in the lowest sufficient precision.

use crate::tissue::error::LinearError;
use crate::tissue::factor::{Factor, Symmetric};
use insonify_base::random::pcg_step;

/// Largest relative error with which a factor in single precision may reproduce a test vector. The vector contains all
/// modes of n degrees of freedom equally; an error in a single mode, as large as that mode, leaves 1 / sqrt(n): 0.01 at
/// the 10,000 of a tissue mesh.
const SINGLE_TOLERANCE: f64 = 0.01;

/// Cholesky factor in single precision, or in double where single does not suffice.
///
/// An iteration that computes its residual in double precision converges to the same balance with either; single
/// precision takes half the time.
#[derive(Clone, Debug)]
pub(crate) struct Approximate {
    factor: Either,
    probe: Vec<f64>,
    product: Vec<f64>,
    rounded: Vec<f32>,
}

#[derive(Clone, Debug)]
enum Either {
    Single(Factor<f32>),
    Double(Factor),
}

impl Approximate {
    /// Analyses and factors a matrix.
    ///
    /// # Errors
    /// [`LinearError`] where the matrix cannot be factored.
    pub(super) fn new(matrix: &impl Symmetric) -> Result<Self, LinearError> {
        let factor = match Factor::single(matrix) {
            Ok(factor) => Either::Single(factor),
            Err(LinearError::NotPositiveDefinite { .. }) => Either::Double(Factor::new(matrix)?),
            Err(error) => return Err(error),
        };
        let size = matrix.lower().ncols();
        let mut approximate = Approximate {
            factor,
            probe: vec![0.0; size],
            product: vec![0.0; size],
            rounded: vec![0.0; size],
        };
        if !approximate.is_accurate(matrix) {
            approximate.factor = Either::Double(Factor::new(matrix)?);
        }
        Ok(approximate)
    }

    /// Factors a matrix of the same pattern. Once single precision has failed, double precision is kept.
    ///
    /// # Errors
    /// [`LinearError`]; the factor is then that of an earlier matrix.
    pub(super) fn refactor(&mut self, matrix: &impl Symmetric) -> Result<(), LinearError> {
        let single = match &mut self.factor {
            Either::Double(factor) => return factor.refactor(matrix),
            Either::Single(factor) => factor.refactor(matrix),
        };
        match single {
            Ok(()) if self.is_accurate(matrix) => return Ok(()),
            Ok(()) | Err(LinearError::NotPositiveDefinite { .. }) => {}
            Err(error) => return Err(error),
        }
        self.factor = Either::Double(Factor::new(matrix)?);
        Ok(())
    }

    /// Replaces forces by the approximate displacements that they cause.
    pub(super) fn solve_in_place(&mut self, rhs: &mut [f64]) {
        match &self.factor {
            Either::Double(factor) => factor.solve_in_place(rhs),
            Either::Single(factor) => {
                // Scaled, as forces may underflow in single precision.
                let size = rhs.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
                if size == 0.0 {
                    return;
                }
                let scale = 1.0 / size;
                for (rounded, x) in self.rounded.iter_mut().zip(&*rhs) {
                    *rounded = (x * scale) as f32;
                }
                factor.solve_in_place(&mut self.rounded);
                for (x, rounded) in rhs.iter_mut().zip(&self.rounded) {
                    *x = f64::from(*rounded) * size;
                }
            }
        }
    }

    /// Whether the factor, if in single precision, reproduces a vector from its product with the matrix.
    fn is_accurate(&mut self, matrix: &impl Symmetric) -> bool {
        if matches!(self.factor, Either::Double(_)) {
            return true;
        }
        let mut probe = std::mem::take(&mut self.probe);
        let mut product = std::mem::take(&mut self.product);
        for (index, x) in (0..).zip(&mut probe) {
            *x = if pcg_step(index) >> 31 == 0 { 1.0 } else { -1.0 };
        }
        matrix.product(&probe, &mut product);
        self.solve_in_place(&mut product);
        let square_error: f64 = product.iter().zip(&probe).map(|(a, b)| (a - b) * (a - b)).sum();
        let accurate = square_error <= SINGLE_TOLERANCE * SINGLE_TOLERANCE * probe.len() as f64;
        (self.probe, self.product) = (probe, product);
        accurate
    }

    /// Whether the factor is in single precision.
    #[cfg(test)]
    pub(crate) fn is_single(&self) -> bool {
        matches!(self.factor, Either::Single(_))
    }
}

#[cfg(test)]
mod tests;
