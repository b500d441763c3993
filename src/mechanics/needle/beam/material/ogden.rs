//! Ogden's material of one term.

use super::{Compression, Hyperelastic, Law, free_exponent};
use crate::needle::beam::fit::{Sample, factor, residual};
use insonify_base::range::{OutOfRange, check, parameters};

/// Smallest and largest magnitude of the exponent.
const ALPHA: [f64; 2] = [1e-3, 1e3];
/// Largest exponent that a fit tries, and the initial spacing of exponents.
const EXPONENTS: f64 = 60.0;
const APART: f64 = 0.25;

parameters! {
    /// W = (2 mu/alpha^2) (l1^alpha + l2^alpha + l3^alpha - 3).
    #[derive(Copy)]
    pub struct Ogden with required keys {
        /// Shear modulus at rest.
        mu_kpa: f64, in 0..=1e12 "kPa";
        /// Exponent, of either sign (magnitude 0.001 to 1000).
        alpha: f64, in -1000..=1000;
    }
}

impl Hyperelastic for Ogden {
    #[cfg(test)]
    const EXAMPLES: &'static [Self] = &[
        Self {
            mu_kpa: 12.72,
            alpha: -1.0,
        },
        Self {
            mu_kpa: 3.63,
            alpha: 8.74,
        },
        Self {
            mu_kpa: 5.0,
            alpha: -20.0,
        },
    ];

    fn check(&self) -> Result<(), OutOfRange> {
        let holds = (ALPHA[0]..=ALPHA[1]).contains(&self.alpha.abs());
        check("alpha", self.alpha, holds, "-1000 to -0.001, or 0.001 to 1000")
    }

    fn scaled(self, stiffness: f64, exponent: f64) -> Self {
        Self {
            mu_kpa: stiffness * self.mu_kpa,
            alpha: exponent * self.alpha,
        }
    }

    #[cfg(test)]
    fn energy_kpa(&self, stretches: [f64; 3]) -> f64 {
        2.0 * self.mu_kpa / (self.alpha * self.alpha) * super::tests::sum(stretches, self.alpha)
    }

    fn true_stress(&self, constrained: bool) -> Vec<(f64, f64)> {
        let Self { mu_kpa, alpha } = *self;
        let free = free_exponent(constrained);
        vec![(2.0 * mu_kpa / alpha, alpha), (-2.0 * mu_kpa / alpha, free * alpha)]
    }

    /// Each exponent has its best modulus: a line search over exponents.
    fn fitted(samples: &[Sample], compression: Compression) -> Self {
        let best = |alpha: f64| {
            let unit = Self { mu_kpa: 1.0, alpha };
            let mu_kpa = factor(samples, &Law::new(&unit.into(), compression));
            Self { mu_kpa, alpha }
        };
        let misfit = |alpha: f64| {
            let misfit = residual(samples, &best(alpha).into(), compression);
            if misfit.is_finite() { misfit } else { f64::INFINITY }
        };
        // Exponents around 0 are invalid, though those on either side of it are nearly equivalent.
        let usable = |alpha: f64| if alpha.abs() < ALPHA[0] { ALPHA[0] } else { alpha };
        let count = (2.0 * EXPONENTS / APART) as usize;
        let exponents = (0..=count).map(|index| usable(-EXPONENTS + APART * index as f64));
        let start = exponents
            .min_by(|a, b| misfit(*a).total_cmp(&misfit(*b)))
            .unwrap_or(1.0);
        // Golden-section search.
        let (mut low, mut high) = (start - APART, start + APART);
        let golden = 0.5 * (5.0f64.sqrt() - 1.0);
        while high - low > 1e-9 * (1.0 + start.abs()) {
            let [a, b] = [high - golden * (high - low), low + golden * (high - low)];
            if misfit(usable(a)) < misfit(usable(b)) {
                high = b;
            } else {
                low = a;
            }
        }
        best(usable(0.5 * (low + high)))
    }
}
