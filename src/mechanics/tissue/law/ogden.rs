//! Ogden law.

use nalgebra::SymmetricEigen;

use super::{Deformation, Law, Moduli, Tensor};
use crate::tissue::material::Material;
use insonify_base::range::{OutOfRange, Ranges, parameters};

parameters! {
    /// Keys of the law.
    #[derive(Copy)]
    pub struct OgdenKeys with required keys {
        /// Exponent of the stretches, at least 0.001 away from 0: 2 is neo-Hookean at constant volume; negative ones
        /// are stiffer in compression than in tension, as brain and liver are.
        alpha: f64, in -50..=50;
    }
}

/// Compressible Ogden tissue of one term (R. W. Ogden, "Large deformation isotropic elasticity", Proceedings of the
/// Royal Society A 328, 1972; G. A. Holzapfel, "Nonlinear Solid Mechanics", 2000, sections 6.5 and 6.6):
/// `W = 2 mu / alpha^2 (p_1 + p_2 + p_3 - 3) + K / 2 (J - 1)^2` with the powers `p_i = (J^(-1/3) l_i)^alpha` of the
/// principal stretches at constant volume.
///
/// With `F = sum_i l_i n_i N_i^T`, the stress is `P = sum_i b_i / l_i n_i N_i^T`, where
/// `b_i = l_i dW/dl_i = 2 mu / alpha (p_i - m) + K J (J - 1)` and `m` is the mean of the powers. Its derivative follows
/// from `l_k db_i/dl_k = 2 mu (p_i I_ik - (p_i + p_k - m) / 3) + K J (2 J - 1)` and the rotation of the directions:
/// with the second Piola-Kirchhoff stress `S = sum_a s_a N_a N_a^T`, `s_a = b_a / l_a^2`, and `g_a = F N_a`, the
/// derivative `dP_ij/dF_kl` is `I_ik S_jl`, and the sum over all `a` and `b` of `ds_a/dl_b / l_b g_ai N_aj g_bk N_bl`,
/// and over those that differ of `(s_b - s_a) / (l_b^2 - l_a^2) g_ai N_bj (g_ak N_bl + g_bk N_al)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ogden {
    material: Material,
    alpha: f64,
}

/// Least size of the exponent: powers of stretches with smaller ones differ by little more than rounding.
const LEAST_ALPHA: f64 = 1e-3;

/// Relative difference of squared stretches below which they count as equal.
const EQUAL: f64 = 1e-6;

/// Principal stretches with their directions, and along each the second Piola-Kirchhoff stress with its derivatives by
/// the stretches, kPa.
struct Principal {
    stretches: [f64; 3],
    directions: Tensor,
    stress: [f64; 3],
    slope: [[f64; 3]; 3],
}

impl Ogden {
    fn bulk_kpa(&self) -> f64 {
        let [lambda, mu] = self.material.lame_kpa();
        lambda + 2.0 * mu / 3.0
    }

    /// Isochoric powers of the principal stretches less 1, whose squares less 1 are `strains`.
    fn powers_less_1(&self, strains: [f64; 3], dilation: f64) -> [f64; 3] {
        strains.map(|strain| (self.alpha * (0.5 * strain.ln_1p() - dilation.ln_1p() / 3.0)).exp_m1())
    }

    fn principal(&self, deformation: &Deformation) -> Principal {
        let [_, mu] = self.material.lame_kpa();
        let (alpha, bulk) = (self.alpha, self.bulk_kpa());
        let j = 1.0 + deformation.dilation;
        let eigen = SymmetricEigen::new(deformation.strain);
        let strains = [0, 1, 2].map(|i| eigen.eigenvalues[i]);
        let stretches = strains.map(|strain| (1.0 + strain).sqrt());
        let powers = self.powers_less_1(strains, deformation.dilation);
        let mean = powers.iter().sum::<f64>() / 3.0;
        // dW/dl_i = b_i / l_i; the second Piola-Kirchhoff stress is b_i / l_i^2.
        let b = powers.map(|power| 2.0 * mu / alpha * (power - mean) + bulk * deformation.dilation * j);
        let stress = [0, 1, 2].map(|i| b[i] / stretches[i].powi(2));
        let slope = [0, 1, 2].map(|i| {
            [0, 1, 2].map(|k| {
                // db_i / dl_k
                let power = if i == k { 1.0 + powers[i] } else { 0.0 };
                let shear = 2.0 * mu * (power - (1.0 + powers[i] + powers[k] - mean) / 3.0);
                let change = (shear + bulk * (2.0 * j - 1.0) * j) / stretches[k];
                let of_square = if i == k { 2.0 * b[i] / stretches[i] } else { 0.0 };
                (change - of_square) / stretches[i].powi(2)
            })
        });
        Principal {
            stretches,
            directions: eigen.eigenvectors,
            stress,
            slope,
        }
    }
}

impl Law for Ogden {
    type Keys = OgdenKeys;

    const EXAMPLE: OgdenKeys = OgdenKeys { alpha: -5.0 };

    fn new(material: Material, keys: OgdenKeys) -> Result<Self, OutOfRange> {
        keys.check_ranges()?;
        let alpha = keys.alpha;
        if alpha.abs() < LEAST_ALPHA {
            Err(OutOfRange::new(
                "alpha",
                alpha,
                "an exponent from -50 to 50, and at least 0.001 away from 0",
            ))
        } else {
            Ok(Self { material, alpha })
        }
    }

    fn at_rest(&self) -> Material {
        self.material
    }

    fn energy_kpa(&self, gradient: &Tensor) -> Option<f64> {
        let [_, mu] = self.material.lame_kpa();
        let energy = Deformation::new(gradient).map(|deformation| {
            let powers = self.powers_less_1(deformation.strain.symmetric_eigenvalues().into(), deformation.dilation);
            let sum: f64 = powers.iter().sum();
            2.0 * mu / self.alpha.powi(2) * sum + 0.5 * self.bulk_kpa() * deformation.dilation.powi(2)
        });
        Some(energy.unwrap_or(f64::NAN))
    }

    fn stress_kpa(&self, gradient: &Tensor) -> Tensor {
        let stress = Deformation::new(gradient).map(|deformation| {
            let Principal { directions, stress, .. } = self.principal(&deformation);
            deformation.f * directions * Tensor::from_diagonal(&stress.into()) * directions.transpose()
        });
        stress.unwrap_or(Tensor::repeat(f64::NAN))
    }

    fn moduli_kpa(&self, gradient: &Tensor) -> Moduli {
        let Some(deformation) = Deformation::new(gradient) else {
            return Moduli::repeat(f64::NAN);
        };
        let Principal {
            stretches,
            directions,
            stress,
            slope,
        } = self.principal(&deformation);
        let second = directions * Tensor::from_diagonal(&stress.into()) * directions.transpose();
        // Directions carried along, F N_i: the moduli in the deformed state need no further product.
        let carried = deformation.f * directions;
        let shear = |a: usize, b: usize| {
            let (x, y) = (stretches[a].powi(2), stretches[b].powi(2));
            if (x - y).abs() < EQUAL * (x + y) {
                // The limit for equal stretches.
                (slope[b][b] - slope[a][b]) / (2.0 * stretches[b])
            } else {
                (stress[b] - stress[a]) / (y - x)
            }
        };
        let shears: [[f64; 3]; 3] = [0, 1, 2].map(|a| [0, 1, 2].map(|b| if a == b { 0.0 } else { shear(a, b) }));
        Moduli::from_fn(|row, column| {
            let ([i, j], [k, l]) = ([row / 3, row % 3], [column / 3, column % 3]);
            let mut entry = if i == k { second[(j, l)] } else { 0.0 };
            for a in 0..3 {
                for b in 0..3 {
                    let (carried_a, carried_b) =
                        ([carried[(i, a)], carried[(k, a)]], [carried[(i, b)], carried[(k, b)]]);
                    let [ja, la, jb, lb] = [
                        directions[(j, a)],
                        directions[(l, a)],
                        directions[(j, b)],
                        directions[(l, b)],
                    ];
                    entry += slope[a][b] / stretches[b] * carried_a[0] * ja * carried_b[1] * lb;
                    entry += shears[a][b] * carried_a[0] * jb * (carried_a[1] * lb + carried_b[1] * la);
                }
            }
            entry
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::uniaxial_kpa;
    use super::*;

    /// Incompressible tissue in tension: P = 2 mu / alpha (l^(alpha - 1) - l^(-alpha / 2 - 1)) (Ogden 1972).
    #[test]
    fn a_bar_has_its_closed_form() {
        for alpha in [2.0, -5.0, 9.0f64] {
            for stretch in [0.7, 1.3, 2.0f64] {
                let (stress_kpa, mu) = uniaxial_kpa::<Ogden>(OgdenKeys { alpha }, stretch);
                let expected = 2.0 * mu / alpha * (stretch.powf(alpha - 1.0) - stretch.powf(-alpha / 2.0 - 1.0));
                assert!(
                    (stress_kpa / expected - 1.0).abs() < 1e-4,
                    "{alpha} {stretch}: {stress_kpa} {expected}"
                );
            }
        }
    }
}
