//! Isotropic material that stiffens above a knee strain.

use super::{Law, Moduli, Tensor};
use crate::tissue::knee::Knee;
use crate::tissue::material::Material;
use crate::tissue::nonlinear::relative_strain;
use insonify_base::range::{OutOfRange, parameters};

parameters! {
    /// Keys of the law.
    #[derive(Copy)]
    pub struct KneeKeys with required keys {
        /// Relative strain, 0 or more, above which the tissue stiffens. In simple shear the relative strain is 0.866 of
        /// the shear.
        knee_strain: f64;
        /// Stiffening coefficient, a in E (1 + a (e - knee)^2).
        stiffening: f64, in 0;
    }
}

/// Secant law of small strain, `P = E(e_r) D e` with the strain `e = (H + H^T) / 2`, the elasticity `D` of a unit
/// modulus at the material's Poisson's ratio, and `E(e_r) = E0` up to the knee `e0`, `E0 (1 + a (e_r - e0)^2)` above
/// (Y. Kobayashi et al., "Development of an integrated needle insertion system with image guidance and deformation
/// simulation", Computerized Medical Imaging and Graphics 34, 2010, equations 7, 8 and 11). The relative
/// strain is `e_r = sqrt(3 / 2 d : d)` with the deviator `d` of `e`.
///
/// The derivative is `dP = E(e_r) D de + 3 / 2 E'(e_r) / e_r (d : de) D e`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stiffening {
    material: Material,
    knee: Knee,
}

impl Stiffening {
    /// Creates a law with `material` below the relative strain `knee` (0 or more), stiffening above by `rate` (0 or
    /// more) times the square of the excess strain.
    ///
    /// # Errors
    /// [`OutOfRange`] for a parameter that is out of range.
    pub fn new(material: Material, knee: f64, rate: f64) -> Result<Stiffening, OutOfRange> {
        let knee = Knee {
            strain: knee,
            stiffening: rate,
        };
        knee.check()?;
        Ok(Stiffening { material, knee })
    }

    /// Creates a law without stiffening.
    pub const fn linear(material: Material) -> Stiffening {
        Stiffening {
            material,
            knee: Knee::INFINITE,
        }
    }

    /// Material below the knee.
    pub const fn material(&self) -> &Material {
        &self.material
    }

    /// Knee strain and stiffening coefficient.
    pub const fn knee(&self) -> &Knee {
        &self.knee
    }

    /// Returns E over E0 at a relative strain.
    #[inline]
    pub fn secant(&self, relative: f64) -> f64 {
        self.knee.factor(relative)
    }

    /// Returns the derivative of [`Self::secant`] with respect to the relative strain.
    #[inline]
    pub fn slope(&self, relative: f64) -> f64 {
        self.knee.slope(relative)
    }

    /// Returns Kobayashi et al.'s tangent over E0, 1 + a (e_r - e0)^2 + 2 a (e_r - e0) e_r (their equation 15): the
    /// derivative of the stress where strain grows in proportion, and an upper bound of it in other directions of pure
    /// shear.
    #[inline]
    pub fn tangent(&self, relative: f64) -> f64 {
        self.secant(relative) + self.slope(relative) * relative
    }
}

/// Stress and its derivative, kPa; no energy, as the pressure changes with the shear but not the shear stress with the
/// volume.
impl Law for Stiffening {
    type Keys = KneeKeys;

    const EXAMPLE: KneeKeys = KneeKeys {
        knee_strain: 0.1,
        stiffening: 20.0,
    };

    fn new(material: Material, keys: KneeKeys) -> Result<Self, OutOfRange> {
        Stiffening::new(material, keys.knee_strain, keys.stiffening)
    }

    fn at_rest(&self) -> Material {
        self.material
    }

    fn stress_kpa(&self, gradient: &Tensor) -> Tensor {
        let strain = symmetric(gradient);
        elastic(&self.material, &strain) * self.secant(relative(&strain).0)
    }

    fn moduli_kpa(&self, gradient: &Tensor) -> Moduli {
        let strain = symmetric(gradient);
        let (relative, deviator) = relative(&strain);
        let normal = if relative > 0.0 {
            deviator * (1.5 / relative)
        } else {
            Tensor::zeros()
        };
        let rise = elastic(&self.material, &strain) * self.slope(relative);
        Moduli::from_fn(|row, column| {
            let mut unit = Tensor::zeros();
            unit[(column / 3, column % 3)] = 1.0;
            let change = symmetric(&unit);
            let entry = (row / 3, row % 3);
            self.secant(relative) * elastic(&self.material, &change)[entry] + normal.dot(&change) * rise[entry]
        })
    }

    fn as_secant(&self) -> Option<Stiffening> {
        Some(*self)
    }
}

fn symmetric(gradient: &Tensor) -> Tensor {
    (gradient + gradient.transpose()) * 0.5
}

fn elastic(material: &Material, strain: &Tensor) -> Tensor {
    let [lambda, mu] = material.lame_kpa();
    Tensor::identity() * (lambda * strain.trace()) + strain * (2.0 * mu)
}

fn relative(strain: &Tensor) -> (f64, Tensor) {
    let rows = std::array::from_fn(|i| std::array::from_fn(|j| strain[(i, j)]));
    let (relative, deviator) = relative_strain::<3>(&rows);
    (relative, Tensor::from_fn(|i, j| deviator[i][j]))
}
