//! A factor that iterations lean on: as precise as it has to be, and no more.

use crate::mechanics::tissue::factor::{Factor, FactorError, Symmetric};
use crate::random::pcg_step;

/// What a factor in single precision may leave of a vector that it should give back, as a part of its length. The vector holds
/// every mode of n degrees of freedom alike; one that is off for a single mode, by as much as that mode, leaves 1 / sqrt(n): 0.01
/// at the 10,000 of a mesh of tissue.
const TELLING: f64 = 0.01;

/// A Cholesky factor in single precision, or in double where single does not do.
///
/// An iteration that computes its residual in double precision comes as near to balance by either; the one in single precision
/// takes half the time.
#[derive(Clone, Debug)]
pub struct Approximate {
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
    /// [`FactorError`].
    pub fn new(matrix: &impl Symmetric) -> Result<Self, FactorError> {
        let factor = match Factor::single(matrix) {
            Ok(factor) => Either::Single(factor),
            Err(FactorError::NotPositiveDefinite { .. }) => Either::Double(Factor::new(matrix)?),
            Err(error) => return Err(error),
        };
        let size = matrix.lower().ncols();
        let mut approximate = Approximate {
            factor,
            probe: vec![0.0; size],
            product: vec![0.0; size],
            rounded: vec![0.0; size],
        };
        if !approximate.tells(matrix) {
            approximate.factor = Either::Double(Factor::new(matrix)?);
        }
        Ok(approximate)
    }

    /// Factors a matrix of the same pattern. Once single precision did not do, it is double from there on.
    ///
    /// # Errors
    /// [`FactorError`]; the factor is then that of some matrix before.
    pub fn refactor(&mut self, matrix: &impl Symmetric) -> Result<(), FactorError> {
        let single = match &mut self.factor {
            Either::Double(factor) => return factor.refactor(matrix),
            Either::Single(factor) => factor.refactor(matrix),
        };
        match single {
            Ok(()) if self.tells(matrix) => return Ok(()),
            Ok(()) | Err(FactorError::NotPositiveDefinite { .. }) => {}
            Err(error) => return Err(error),
        }
        self.factor = Either::Double(Factor::new(matrix)?);
        Ok(())
    }

    /// Turns forces into about the displacements that they cause.
    pub fn solve_in_place(&mut self, rhs: &mut [f64]) {
        match &self.factor {
            Either::Double(factor) => factor.solve_in_place(rhs),
            Either::Single(factor) => {
                // Forces may be smaller than single precision tells from none.
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

    /// Whether the factor, if it is in single precision, gives back a vector that the matrix was applied to.
    fn tells(&mut self, matrix: &impl Symmetric) -> bool {
        if matches!(self.factor, Either::Double(_)) {
            return true;
        }
        let mut probe = std::mem::take(&mut self.probe);
        let mut product = std::mem::take(&mut self.product);
        for (at, x) in (0..).zip(&mut probe) {
            *x = if pcg_step(at) >> 31 == 0 { 1.0 } else { -1.0 };
        }
        matrix.product(&probe, &mut product);
        self.solve_in_place(&mut product);
        let off: f64 = product.iter().zip(&probe).map(|(a, b)| (a - b) * (a - b)).sum();
        let tells = off <= TELLING * TELLING * probe.len() as f64;
        (self.probe, self.product) = (probe, product);
        tells
    }

    /// Whether it is in single precision.
    #[cfg(test)]
    pub fn is_single(&self) -> bool {
        matches!(self.factor, Either::Single(_))
    }
}

#[cfg(test)]
mod tests;
