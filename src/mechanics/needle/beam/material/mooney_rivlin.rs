//! Material of Mooney and Rivlin.

use super::ogden::Ogden;
use super::{Compression, Hyperelastic, Law};
use crate::needle::beam::fit::{Sample, factor, factors};
use insonify_base::range::{OutOfRange, check, parameters};

/// Largest sum of the coefficients, kPa.
const MAX_KPA: f64 = 1e12;

parameters! {
    /// W = c10 (I1 - 3) + c01 (I2 - 3); the shear modulus at rest is 2 (c10 + c01).
    #[derive(Copy)]
    pub struct MooneyRivlin with required keys {
        /// Coefficient of I1 - 3; for `yeoh` 0 or more.
        c10_kpa: f64, in -1e12..=1e12 "kPa";
        /// Coefficient of I2 - 3; `c10_kpa + c01_kpa` is 0 to 1e12 kPa.
        c01_kpa: f64, in -1e12..=2e12 "kPa";
    }
}

impl Hyperelastic for MooneyRivlin {
    #[cfg(test)]
    const EXAMPLES: &'static [Self] = &[Self {
        c10_kpa: 2.0,
        c01_kpa: 1.5,
    }];

    fn check(&self) -> Result<(), OutOfRange> {
        let holds = (0.0..=MAX_KPA).contains(&(self.c10_kpa + self.c01_kpa));
        let expected = "such that c10_kpa + c01_kpa is 0 to 1e12 kPa";
        check("c01_kpa", self.c01_kpa, holds, expected)
    }

    fn scaled(self, stiffness: f64, _exponent: f64) -> Self {
        let [c10_kpa, c01_kpa] = [self.c10_kpa, self.c01_kpa].map(|modulus| modulus * stiffness);
        Self { c10_kpa, c01_kpa }
    }

    /// I2 of incompressible tissue is the sum of inverse squares.
    #[cfg(test)]
    fn energy_kpa(&self, stretches: [f64; 3]) -> f64 {
        let sum = |power| super::tests::sum(stretches, power);
        self.c10_kpa * sum(2.0) + self.c01_kpa * sum(-2.0)
    }

    fn true_stress(&self, constrained: bool) -> Vec<(f64, f64)> {
        let [a, b] = [self.c10_kpa, self.c01_kpa];
        if constrained {
            // l1 = 1: both invariants have the same effect.
            let mu_kpa = 2.0 * (a + b);
            Ogden { mu_kpa, alpha: 2.0 }.true_stress(constrained)
        } else {
            vec![(2.0 * a, 2.0), (-2.0 * a, -1.0), (2.0 * b, 1.0), (-2.0 * b, -2.0)]
        }
    }

    fn fitted(samples: &[Sample], compression: Compression) -> Self {
        let law = |c10_kpa, c01_kpa| Law::new(&Self { c10_kpa, c01_kpa }.into(), compression);
        let [c10_kpa, c01_kpa] = match compression {
            // Tissue that cannot widen along the needle does not distinguish the two invariants.
            Compression::CTru => [factor(samples, &law(1.0, 0.0)), 0.0],
            _ => factors(samples, [&law(1.0, 0.0), &law(0.0, 1.0)]),
        };
        Self { c10_kpa, c01_kpa }
    }
}
