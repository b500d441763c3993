//! Hyperelastic, incompressible materials in compression (Wang et al. 2023, equations 1 to 3 and 7 to 9).
//!
//! In each of these models, stress is a sum of powers of the compression ratio, so that stress, tangent modulus and its rate
//! follow exactly from one list of terms. With the principal stretches `l1`, `l2 = lambda`, `l3` and the free face along 3,
//! a material `W(I1, I2)` has the true stress `2 (l2^2 - l3^2) (W_1 + l1^2 W_2)`; Ogden's has `(2 mu/alpha) (l2^alpha -
//! l3^alpha)`.

#[cfg(test)]
mod tests;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::spec::LayerSpec;
use insonify_base::range::{OutOfRange, Ranges, check};

/// Largest sum of the coefficients of Mooney and Rivlin, kPa.
const MAX_KPA: f64 = 1e12;
/// Smallest and largest magnitude of Ogden's exponent.
pub(super) const ALPHA: [f64; 2] = [1e-3, 1e3];

/// Material of tissue. Moduli in kPa; the shear modulus at rest is `mu`, or `2 (c10 + c01)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Material {
    /// W = (2 mu/alpha^2) (l1^alpha + l2^alpha + l3^alpha - 3).
    Ogden {
        /// Shear modulus at rest, kPa (0 to 1e12).
        mu_kpa: f64,
        /// Exponent, of either sign (1e-3 to 1e3 in magnitude).
        alpha: f64,
    },
    /// W = (mu/2) (I1 - 3).
    NeoHookean {
        /// Shear modulus, kPa (0 to 1e12).
        mu_kpa: f64,
    },
    /// W = c10 (I1 - 3) + c01 (I2 - 3).
    MooneyRivlin {
        /// First coefficient, kPa; `c10 + c01` is 0 to 1e12.
        c10_kpa: f64,
        /// Second coefficient, kPa.
        c01_kpa: f64,
    },
    /// W = c10 (I1 - 3) + c20 (I1 - 3)^2.
    Yeoh {
        /// First coefficient, kPa (0 to 1e12).
        c10_kpa: f64,
        /// Second coefficient, kPa (-1e12 to 1e12).
        c20_kpa: f64,
    },
}

/// Constraint of the compressed tissue, and kind of stress.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Compression {
    /// Free to widen in both directions; engineering stress (force per area at rest).
    UEng,
    /// Free to widen in both directions; true stress (force per current area).
    UTru,
    /// Free to widen only across the needle's depth; true stress.
    CTru,
}

impl Compression {
    /// All variants.
    pub const ALL: [Compression; 3] = [Compression::UEng, Compression::UTru, Compression::CTru];

    /// Returns the name used by Wang et al. 2023.
    pub fn name(self) -> &'static str {
        match self {
            Compression::UEng => "UEng",
            Compression::UTru => "UTru",
            Compression::CTru => "CTru",
        }
    }
}

impl Material {
    /// Checks every number against its range.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key of the number.
    pub fn check(&self) -> Result<(), OutOfRange> {
        for (key, found) in self.parameters() {
            LayerSpec::check_number(key, found)?;
        }
        match *self {
            Material::Ogden { alpha, .. } => {
                let holds = (ALPHA[0]..=ALPHA[1]).contains(&alpha.abs());
                check("alpha", alpha, holds, "-1000 to -0.001, or 0.001 to 1000")
            }
            Material::NeoHookean { .. } => Ok(()),
            Material::MooneyRivlin { c10_kpa, c01_kpa } => {
                let holds = (0.0..=MAX_KPA).contains(&(c10_kpa + c01_kpa));
                let expected = "such that c10_kpa + c01_kpa is 0 to 1e12 kPa";
                check("c01_kpa", c01_kpa, holds, expected)
            }
            Material::Yeoh { c10_kpa, .. } => check("c10_kpa", c10_kpa, c10_kpa >= 0.0, "0 to 1e12 kPa"),
        }
    }

    /// Returns the name of the model in case files.
    pub fn model(&self) -> &'static str {
        match self {
            Material::Ogden { .. } => "ogden",
            Material::NeoHookean { .. } => "neo-hookean",
            Material::MooneyRivlin { .. } => "mooney-rivlin",
            Material::Yeoh { .. } => "yeoh",
        }
    }

    /// Returns the parameters with their keys in case files.
    pub fn parameters(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Material::Ogden { mu_kpa, alpha } => vec![("mu_kpa", mu_kpa), ("alpha", alpha)],
            Material::NeoHookean { mu_kpa } => vec![("mu_kpa", mu_kpa)],
            Material::MooneyRivlin { c10_kpa, c01_kpa } => vec![("c10_kpa", c10_kpa), ("c01_kpa", c01_kpa)],
            Material::Yeoh { c10_kpa, c20_kpa } => vec![("c10_kpa", c10_kpa), ("c20_kpa", c20_kpa)],
        }
    }

    /// Returns the true stress as coefficients (kPa) and powers of the compression ratio, unconstrained or constrained.
    fn true_stress(&self, constrained: bool) -> Vec<(f64, f64)> {
        // Exponent of the free face: l3 = lambda^-1/2, or lambda^-1.
        let free = if constrained { -1.0 } else { -0.5 };
        let ogden = |mu: f64, alpha: f64| vec![(2.0 * mu / alpha, alpha), (-2.0 * mu / alpha, free * alpha)];
        match *self {
            Material::Ogden { mu_kpa, alpha } => ogden(mu_kpa, alpha),
            Material::NeoHookean { mu_kpa } => ogden(mu_kpa, 2.0),
            // l1 = 1: both invariants have the same effect.
            Material::MooneyRivlin { c10_kpa, c01_kpa } if constrained => ogden(2.0 * (c10_kpa + c01_kpa), 2.0),
            Material::MooneyRivlin { c10_kpa: a, c01_kpa: b } => {
                vec![(2.0 * a, 2.0), (-2.0 * a, -1.0), (2.0 * b, 1.0), (-2.0 * b, -2.0)]
            }
            // 2 (l^2 - l3^2) (c10 + 2 c20 (I1 - 3)), expanded.
            Material::Yeoh { c10_kpa: a, c20_kpa: b } if constrained => {
                let [a, b] = [2.0 * a, 4.0 * b];
                vec![(a - 2.0 * b, 2.0), (2.0 * b - a, -2.0), (b, 4.0), (-b, -4.0)]
            }
            Material::Yeoh { c10_kpa: a, c20_kpa: b } => {
                let [a, b] = [2.0 * a, 4.0 * b];
                vec![
                    (b, 4.0),
                    (a - 3.0 * b, 2.0),
                    (b, 1.0),
                    (3.0 * b - a, -1.0),
                    (-2.0 * b, -2.0),
                ]
            }
        }
    }
}

/// A material in compression: stress and its derivatives by the compression ratio.
#[derive(Clone, Debug, PartialEq)]
pub struct Law {
    /// Coefficients, kPa, and powers of the stress.
    terms: Vec<(f64, f64)>,
}

/// Stress and its derivatives at a compression ratio.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Response {
    /// Stress S, kPa; negative in compression.
    pub stress_kpa: f64,
    /// Tangent modulus dS/d lambda, kPa.
    pub tangent_kpa: f64,
    /// Second derivative d^2S/d lambda^2, kPa.
    pub rate_kpa: f64,
}

impl Law {
    /// Builds the law of a material, whose parameters are not checked.
    pub fn new(material: &Material, compression: Compression) -> Law {
        let mut terms = material.true_stress(compression == Compression::CTru);
        if compression == Compression::UEng {
            // The area grows as the length shrinks: P = s/lambda.
            terms.iter_mut().for_each(|term| term.1 -= 1.0);
        }
        Law { terms }
    }

    /// Returns stress and derivatives at a compression ratio (above 0; above 1 for stretched tissue).
    pub fn at(&self, ratio: f64) -> Response {
        let (log, mut response) = (ratio.ln(), Response::default());
        for &(coefficient, power) in &self.terms {
            let stress = coefficient * (power * log).exp();
            let tangent = power * stress / ratio;
            response.stress_kpa += stress;
            response.tangent_kpa += tangent;
            response.rate_kpa += (power - 1.0) * tangent / ratio;
        }
        response
    }
}
