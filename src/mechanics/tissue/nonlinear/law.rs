//! Isotropic material that stiffens above a knee strain.

use crate::base::range::OutOfRange;
use crate::mechanics::tissue::knee::Knee;
use crate::mechanics::tissue::material::Material;

/// Secant law sigma = E(e_r) D epsilon, with D the elasticity of a unit modulus at the material's Poisson's ratio, and
/// E(e_r) = E0 up to the knee e0, E0 (1 + a (e_r - e0)^2) above (Y. Kobayashi et al., "Development of an integrated
/// needle insertion system with image guidance and deformation simulation", Computerized Medical Imaging and Graphics
/// 34, 2010, equations 7, 8 and 11). Small strains.
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
            knee: Knee::NONE,
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

/// Returns the relative strain e_r = sqrt(((e1 - e2)^2 + (e2 - e3)^2 + (e3 - e1)^2) / 2) of a strain (`D` = 2: plane
/// strain, with third principal strain 0), and its deviator within the `D` axes. Computed from invariants, without
/// principal strains: e_r^2 = 3/2 e : e with e the deviator.
#[inline]
pub fn relative_strain<const D: usize>(strain: &[[f64; D]; D]) -> (f64, [[f64; D]; D]) {
    let mean = (0..D).map(|i| strain[i][i]).sum::<f64>() / 3.0;
    let mut deviator = *strain;
    let mut square = (3 - D) as f64 * mean * mean;
    for (i, row) in deviator.iter_mut().enumerate() {
        row[i] -= mean;
        square += row.iter().map(|x| x * x).sum::<f64>();
    }
    ((1.5 * square).sqrt(), deviator)
}
