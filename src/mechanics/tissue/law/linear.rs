//! Linear elasticity at small strain.

use super::{Law, Moduli, NoKeys, Stiffening, Tensor};
use crate::tissue::material::Material;
use insonify_base::range::OutOfRange;

/// Linear, isotropic elasticity at small strain: `W = lambda / 2 (tr e)^2 + mu e : e` and `P = lambda tr(e) I + 2 mu e`
/// with the strain `e = (H + H^T) / 2`. A turned element counts as strained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Linear(Material);

impl Law for Linear {
    type Keys = NoKeys;

    const EXAMPLE: NoKeys = NoKeys {};

    fn new(material: Material, _: NoKeys) -> Result<Self, OutOfRange> {
        Ok(Self(material))
    }

    fn at_rest(&self) -> Material {
        self.0
    }

    fn energy_kpa(&self, gradient: &Tensor) -> Option<f64> {
        Some(0.5 * self.stress_kpa(gradient).dot(gradient))
    }

    fn stress_kpa(&self, gradient: &Tensor) -> Tensor {
        Stiffening::linear(self.0).stress_kpa(gradient)
    }

    fn moduli_kpa(&self, gradient: &Tensor) -> Moduli {
        Stiffening::linear(self.0).moduli_kpa(gradient)
    }

    fn as_secant(&self) -> Option<Stiffening> {
        Some(Stiffening::linear(self.0))
    }
}
