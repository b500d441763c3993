//! Isotropic material that stiffens above a knee strain.

use crate::tissue::knee::Knee;
use crate::tissue::material::Material;
use insonify_base::range::OutOfRange;

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

/// Returns the von Mises stress, sqrt(3/2 s : s) with s the deviator: the stress in uniaxial tension, sqrt(3) times that in simple shear.
pub fn von_mises(stress: &[[f64; 3]; 3]) -> f64 {
    let [[xx, xy, xz], [_, yy, yz], [_, _, zz]] = *stress;
    let apart = (xx - yy).powi(2) + (yy - zz).powi(2) + (zz - xx).powi(2);
    (0.5 * apart + 3.0 * (xy * xy + yz * yz + xz * xz)).sqrt()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tissue::nonlinear::Sheet;

    #[test]
    fn the_von_mises_stress_of_simple_states() {
        let [s, t] = [7.0, 3.0];
        let tension = [[0.0; 3], [0.0, s, 0.0], [0.0; 3]];
        let shear = [[0.0, 0.0, t], [0.0; 3], [t, 0.0, 0.0]];
        let pressure = [[-s, 0.0, 0.0], [0.0, -s, 0.0], [0.0, 0.0, -s]];
        for (stress, expected) in [(tension, s), (shear, 3f64.sqrt() * t), (pressure, 0.0)] {
            assert!((von_mises(&stress) - expected).abs() < 1e-14, "{stress:?}");
            // A pressure changes nothing.
            let mut pressed = stress;
            (0..3).for_each(|i| pressed[i][i] -= 11.0);
            assert!((von_mises(&pressed) - expected).abs() < 1e-14, "{pressed:?}");
        }
    }

    /// In plane strain, uniaxial strain e gives 2 mu e, simple shear g sqrt(3) mu g, whatever Poisson's ratio.
    #[test]
    fn the_von_mises_stress_in_plane_strain() {
        for poisson in [0.0, 0.3, 0.49] {
            let material = Material::new(6.0, poisson).unwrap();
            let [_, mu] = material.lame_kpa();
            let nodes = vec![[0.0, 0.0], [2.0, 0.0], [0.0, 3.0]];
            let sheet = Sheet::plane_strain(nodes, vec![[0, 1, 2]], &[Stiffening::linear(material)], 1.0).unwrap();
            for (u, expected) in [
                ([0.0, 0.0, 0.2, 0.0, 0.0, 0.0], 2.0 * mu * 0.1),
                ([0.0, 0.0, 0.0, 0.0, 0.3, 0.0], 3f64.sqrt() * mu * 0.1),
            ] {
                let found = sheet.von_mises_kpa(&sheet.stresses_kpa(&u, &u))[0];
                assert!((found - expected).abs() < 1e-12, "{poisson}: {found} for {expected}");
            }
        }
    }
}
