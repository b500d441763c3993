//! Stiffening at large strain.

/// Stiffness as it is up to a knee, and 1 + a (|e| - e0)^2 times that above (Y. Kobayashi et al., "Development of an integrated needle
/// insertion system with image guidance and deformation simulation", Computerized Medical Imaging and Graphics 34, 2010, equations 3
/// and 8). Of a point in shear the strain is the shear strain, of a body the relative strain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knee {
    /// e0: strain at which the tissue begins to stiffen, 0 or more; infinite where it never does. Key `knee_strain`.
    pub strain: f64,
    /// a, 0 or more. Key `stiffening`.
    pub stiffening: f64,
}

/// Why numbers make no stiffening material.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{key} is {found}; expected {expected}")]
pub struct InvalidStiffening {
    /// Which number.
    pub key: &'static str,
    /// As given.
    pub found: f64,
    /// What it must be.
    pub expected: &'static str,
}

impl Knee {
    /// Tissue that never stiffens.
    pub const NONE: Knee = Knee {
        strain: f64::INFINITY,
        stiffening: 0.0,
    };

    /// Checks both numbers.
    ///
    /// # Errors
    /// [`InvalidStiffening`], with the one that is out of range.
    pub fn check(&self) -> Result<(), InvalidStiffening> {
        let Knee { strain, stiffening } = *self;
        let wrong = |key, found, expected| Err(InvalidStiffening { key, found, expected });
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

    /// Stiffness at a strain over that below the knee.
    #[inline]
    pub fn factor(&self, strain: f64) -> f64 {
        let above = self.above(strain);
        1.0 + self.stiffening * above * above
    }

    /// Derivative of [`factor`](Knee::factor) by the strain.
    #[inline]
    pub fn slope(&self, strain: f64) -> f64 {
        2.0 * self.stiffening * self.above(strain).copysign(strain)
    }

    #[inline]
    fn above(&self, strain: f64) -> f64 {
        (strain.abs() - self.strain).max(0.0)
    }
}
