//! Material of Yeoh, of two terms.

use super::{Compression, Hyperelastic, Law};
use crate::needle::beam::fit::{Sample, factors};
use insonify_base::range::{OutOfRange, check, parameters};

parameters! {
    /// W = c10 (I1 - 3) + c20 (I1 - 3)^2; the shear modulus at rest is 2 c10.
    #[derive(Copy)]
    pub struct Yeoh with required keys {
        /// Coefficient of I1 - 3; for `yeoh` 0 or more.
        c10_kpa: f64, in -1e12..=1e12 "kPa";
        /// Coefficient of (I1 - 3)^2.
        c20_kpa: f64, in -1e12..=1e12 "kPa";
    }
}

impl Hyperelastic for Yeoh {
    #[cfg(test)]
    const EXAMPLES: &'static [Self] = &[Self {
        c10_kpa: 3.0,
        c20_kpa: 0.8,
    }];

    fn check(&self) -> Result<(), OutOfRange> {
        check("c10_kpa", self.c10_kpa, self.c10_kpa >= 0.0, "0 to 1e12 kPa")
    }

    fn scaled(self, stiffness: f64, _exponent: f64) -> Self {
        let [c10_kpa, c20_kpa] = [self.c10_kpa, self.c20_kpa].map(|modulus| modulus * stiffness);
        Self { c10_kpa, c20_kpa }
    }

    #[cfg(test)]
    fn energy_kpa(&self, stretches: [f64; 3]) -> f64 {
        let i1 = super::tests::sum(stretches, 2.0);
        self.c10_kpa * i1 + self.c20_kpa * i1.powi(2)
    }

    /// 2 (l^2 - l3^2) (c10 + 2 c20 (I1 - 3)), expanded.
    fn true_stress(&self, constrained: bool) -> Vec<(f64, f64)> {
        let [a, b] = [2.0 * self.c10_kpa, 4.0 * self.c20_kpa];
        if constrained {
            vec![(a - 2.0 * b, 2.0), (2.0 * b - a, -2.0), (b, 4.0), (-b, -4.0)]
        } else {
            vec![
                (b, 4.0),
                (a - 3.0 * b, 2.0),
                (b, 1.0),
                (3.0 * b - a, -1.0),
                (-2.0 * b, -2.0),
            ]
        }
    }

    fn fitted(samples: &[Sample], compression: Compression) -> Self {
        let law = |c10_kpa, c20_kpa| Law::new(&Self { c10_kpa, c20_kpa }.into(), compression);
        let [c10_kpa, c20_kpa] = factors(samples, [&law(1.0, 0.0), &law(0.0, 1.0)]);
        Self { c10_kpa, c20_kpa }
    }
}
