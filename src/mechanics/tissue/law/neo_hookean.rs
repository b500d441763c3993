//! Neo-Hookean law.

use super::{Deformation, Law, Moduli, NoKeys, Tensor};
use crate::tissue::material::Material;
use insonify_base::range::OutOfRange;

/// Compressible neo-Hookean tissue (J. Bonet and R. D. Wood, "Nonlinear Continuum Mechanics for Finite Element
/// Analysis", 2nd edition, 2008, section 6.4.3): `W = mu / 2 (tr C - 3) - mu ln J + lambda / 2 (ln J)^2`, so that
/// `P = mu (F - F^-T) + lambda ln J F^-T`.
///
/// The derivative of `ln J` is `F^-T`, and that of `F^-T_ij` by `F_kl` is `-F^-T_il F^-T_kj`; therefore
/// `dP_ij/dF_kl = mu I_ik I_jl + (mu - lambda ln J) F^-T_il F^-T_kj + lambda F^-T_ij F^-T_kl`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeoHookean(Material);

impl Law for NeoHookean {
    type Keys = NoKeys;

    const EXAMPLE: NoKeys = NoKeys {};

    fn new(material: Material, _: NoKeys) -> Result<Self, OutOfRange> {
        Ok(Self(material))
    }

    fn at_rest(&self) -> Material {
        self.0
    }

    fn energy_kpa(&self, gradient: &Tensor) -> Option<f64> {
        let [lambda, mu] = self.0.lame_kpa();
        let energy = Deformation::new(gradient).map(|deformation| {
            let log = deformation.dilation.ln_1p();
            0.5 * mu * deformation.strain.trace() - mu * log + 0.5 * lambda * log * log
        });
        Some(energy.unwrap_or(f64::NAN))
    }

    fn stress_kpa(&self, gradient: &Tensor) -> Tensor {
        let [lambda, mu] = self.0.lame_kpa();
        // F - F^-T = F^-T (C - I).
        let stress = Deformation::new(gradient).map(|deformation| {
            let volumetric = Tensor::from_diagonal_element(lambda * deformation.dilation.ln_1p());
            deformation.inverse * (deformation.strain * mu + volumetric)
        });
        stress.unwrap_or(Tensor::repeat(f64::NAN))
    }

    fn moduli_kpa(&self, gradient: &Tensor) -> Moduli {
        let [lambda, mu] = self.0.lame_kpa();
        let Some(Deformation { inverse, dilation, .. }) = Deformation::new(gradient) else {
            return Moduli::repeat(f64::NAN);
        };
        let coupling = mu - lambda * dilation.ln_1p();
        Moduli::from_fn(|row, column| {
            let ([i, j], [k, l]) = ([row / 3, row % 3], [column / 3, column % 3]);
            let identity = if i == k && j == l { mu } else { 0.0 };
            identity + coupling * inverse[(i, l)] * inverse[(k, j)] + lambda * inverse[(i, j)] * inverse[(k, l)]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::uniaxial_kpa;
    use super::*;

    /// Incompressible tissue in tension: P = mu (l - 1 / l^2) (Holzapfel 2000, section 6.5).
    #[test]
    fn a_bar_has_its_closed_form() {
        for stretch in [0.7, 1.3, 2.0f64] {
            let (stress_kpa, mu) = uniaxial_kpa::<NeoHookean>(NoKeys {}, stretch);
            let expected = mu * (stretch - stretch.powi(-2));
            assert!(
                (stress_kpa / expected - 1.0).abs() < 1e-4,
                "{stretch}: {stress_kpa} {expected}"
            );
        }
    }
}
