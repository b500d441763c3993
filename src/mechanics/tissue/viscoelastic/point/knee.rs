//! Stiffening at large strain.

use super::{PointError, check};

/// `G = G0` up to a knee, `G0 (1 + a (|gamma| - gamma0)^2)` above (paper 3, equation 3).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Knee {
    /// gamma0: shear strain at which the tissue begins to stiffen, 0 or more; infinite where it never does. Key `knee_strain`.
    pub strain: f64,
    /// a, 0 or more. Key `stiffening`.
    pub stiffening: f64,
}

impl Knee {
    /// Tissue that never stiffens.
    pub const NONE: Knee = Knee {
        strain: f64::INFINITY,
        stiffening: 0.0,
    };

    pub(super) fn check(&self) -> Result<(), PointError> {
        let Knee { strain, stiffening } = *self;
        check("knee_strain", strain, strain >= 0.0, "a shear strain, 0 or more")?;
        let right = stiffening >= 0.0 && stiffening.is_finite();
        check("stiffening", stiffening, right, "a finite number, 0 or more")
    }

    /// G over G0 at a shear strain.
    pub fn factor(&self, strain: f64) -> f64 {
        let above = self.above(strain);
        1.0 + self.stiffening * above * above
    }

    /// Derivative of [`factor`](Knee::factor) by the strain.
    pub fn slope(&self, strain: f64) -> f64 {
        2.0 * self.stiffening * self.above(strain).copysign(strain)
    }

    fn above(&self, strain: f64) -> f64 {
        (strain.abs() - self.strain).max(0.0)
    }
}
