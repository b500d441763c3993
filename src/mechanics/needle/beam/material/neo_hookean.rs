//! Neo-Hookean material.

use super::ogden::Ogden;
use super::{Compression, Hyperelastic, Law};
use crate::needle::beam::fit::{Sample, factor};
use insonify_base::range::parameters;

parameters! {
    /// W = (mu/2) (I1 - 3).
    #[derive(Copy)]
    pub struct NeoHookean with required keys {
        /// Shear modulus at rest.
        mu_kpa: f64, in 0..=1e12 "kPa";
    }
}

impl Hyperelastic for NeoHookean {
    #[cfg(test)]
    const EXAMPLES: &'static [Self] = &[Self { mu_kpa: 7.0 }];

    fn scaled(self, stiffness: f64, _exponent: f64) -> Self {
        let mu_kpa = stiffness * self.mu_kpa;
        Self { mu_kpa }
    }

    #[cfg(test)]
    fn energy_kpa(&self, stretches: [f64; 3]) -> f64 {
        self.mu_kpa / 2.0 * super::tests::sum(stretches, 2.0)
    }

    fn true_stress(&self, constrained: bool) -> Vec<(f64, f64)> {
        let mu_kpa = self.mu_kpa;
        Ogden { mu_kpa, alpha: 2.0 }.true_stress(constrained)
    }

    fn fitted(samples: &[Sample], compression: Compression) -> Self {
        let unit = Self { mu_kpa: 1.0 };
        let mu_kpa = factor(samples, &Law::new(&unit.into(), compression));
        Self { mu_kpa }
    }
}
