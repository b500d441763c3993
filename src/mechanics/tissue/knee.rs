//! Strain-stiffening law.

use insonify_base::range::OutOfRange;

/// Constant stiffness up to a knee, and 1 + a (|e| - e0)^2 times as much above (Y. Kobayashi et al., "Development of an
/// integrated needle insertion system with image guidance and deformation simulation", Computerized Medical Imaging and
/// Graphics 34, 2010, equations 3 and 8). The strain e is the shear strain of a point in shear, and the relative strain
/// of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knee {
    /// Knee strain e0 at which stiffening begins, 0 or more; infinite for none. Key `knee_strain`.
    pub strain: f64,
    /// Stiffening coefficient a, 0 or more. Key `stiffening`.
    pub stiffening: f64,
}

impl Knee {
    /// Law without stiffening: a knee that no strain reaches.
    pub const INFINITE: Knee = Knee {
        strain: f64::INFINITY,
        stiffening: 0.0,
    };

    /// Checks both parameters.
    ///
    /// # Errors
    /// [`OutOfRange`] for a parameter that is out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let Knee { strain, stiffening } = *self;
        let wrong = |key, found: f64, expected| Err(OutOfRange::new(key, found, expected));
        if strain.is_nan() || strain < 0.0 {
            return wrong(
                "knee_strain",
                strain,
                "a strain, 0 or more (inf for tissue that never stiffens)",
            );
        }
        if !(stiffening.is_finite() && stiffening >= 0.0) {
            return wrong("stiffening", stiffening, "a finite number, 0 or more");
        }
        Ok(())
    }

    /// Returns the stiffness at a strain relative to that below the knee.
    #[inline]
    pub fn factor(&self, strain: f64) -> f64 {
        let above = self.above(strain);
        1.0 + self.stiffening * above * above
    }

    /// Returns the derivative of [`factor`](Knee::factor) with respect to the strain.
    #[inline]
    pub fn slope(&self, strain: f64) -> f64 {
        2.0 * self.stiffening * self.above(strain).copysign(strain)
    }

    #[inline]
    fn above(&self, strain: f64) -> f64 {
        (strain.abs() - self.strain).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knees_from_zero_to_infinity_are_allowed() {
        let check = |strain, stiffening| Knee { strain, stiffening }.check().map_err(|error| error.key);
        for strain in [0.0, 0.3, f64::INFINITY] {
            assert_eq!(check(strain, 0.0), Ok(()));
        }
        for strain in [-1e-300, f64::NAN] {
            assert_eq!(check(strain, 1.0), Err("knee_strain".to_owned()));
        }
        for stiffening in [-1e-300, f64::NAN, f64::INFINITY] {
            assert_eq!(check(0.1, stiffening), Err("stiffening".to_owned()));
        }
    }
}
