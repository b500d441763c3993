//! Hyperelastic, incompressible materials in compression (Wang et al. 2023, equations 1 to 3 and 7 to 9).
//!
//! In each of these models, stress is a sum of powers of the compression ratio, so that stress, tangent modulus and its
//! rate follow exactly from one list of terms. With the principal stretches `l1`, `l2 = lambda`, `l3` and the free face
//! along 3, a material `W(I1, I2)` has the true stress `2 (l2^2 - l3^2) (W_1 + l1^2 W_2)`; Ogden's has
//! `(2 mu/alpha) (l2^alpha - l3^alpha)`.

#[cfg(test)]
mod tests;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fit::Sample;
use insonify_base::document::word;
use insonify_base::kinds::{self, KeyedKind};
use insonify_base::range::{Kind, OutOfRange, Ranges};

/// A material: its keys in files, all numbers, each with a range. Moduli, whose keys end in `_kpa`, scale its stress.
/// A key that several materials have has the same text and range in all: one schema describes it. What a range does not
/// say is for [`Self::check`].
pub(super) trait Hyperelastic: Ranges + Copy {
    /// Usual ones, for tests of all materials.
    #[cfg(test)]
    const EXAMPLES: &'static [Self];

    /// Checks what the ranges of single keys do not say.
    ///
    /// # Errors
    /// [`OutOfRange`] with the key of the number.
    fn check(&self) -> Result<(), OutOfRange> {
        Ok(())
    }

    /// The material with its moduli and its exponents, if it has any, multiplied.
    fn scaled(self, stiffness: f64, exponent: f64) -> Self;

    /// Strain energy at principal stretches, kPa.
    #[cfg(test)]
    fn energy_kpa(&self, stretches: [f64; 3]) -> f64;

    /// The true stress as coefficients (kPa) and powers of the compression ratio; `constrained` where tissue cannot
    /// widen along the needle.
    fn true_stress(&self, constrained: bool) -> Vec<(f64, f64)>;

    /// The least-squares fit to samples of a stress.
    fn fitted(samples: &[Sample], compression: Compression) -> Self;
}

/// Exponent of the free face: l3 = lambda^-1/2, or lambda^-1 if tissue cannot widen along the needle.
fn free_exponent(constrained: bool) -> f64 {
    if constrained { -1.0 } else { -0.5 }
}

/// Declares the materials in the order of fits: the names of files, each with its module, the type of its keys and its
/// description.
macro_rules! materials {
    ($($name:literal $module:ident: $Material:ident = $doc:literal;)+) => {
        $(mod $module; pub use $module::$Material;)+

        /// Material of tissue. Moduli in kPa.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub enum Material {
            $(#[doc = $doc] $Material($Material),)+
        }

        /// Hyperelastic model.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
        pub enum ModelName {
            $(
                #[doc = $doc]
                #[serde(rename = $name)]
                $Material,
            )+
        }

        impl KeyedKind for ModelName {
            type Keys = Material;
            const ALL: &'static [Self] = &[$(Self::$Material),+];

            fn keys(self) -> &'static [&'static str] {
                match self {
                    $(Self::$Material => $Material::KEYS,)+
                }
            }

            fn schema(self, generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                match self {
                    $(Self::$Material => $Material::json_schema(generator),)+
                }
            }

            fn read<'de, D: serde::Deserializer<'de>>(self, keys: D) -> Result<Material, D::Error> {
                match self {
                    $(Self::$Material => $Material::deserialize(keys).map(Material::$Material),)+
                }
            }

            fn value<'de, D: serde::Deserializer<'de>>(self, _: &'static str, value: D) -> Result<kinds::Value, D::Error> {
                f64::deserialize(value).map(kinds::Value::Float)
            }
        }

        impl Material {
            /// Checks every number against its range.
            ///
            /// # Errors
            /// [`OutOfRange`] with the key of the number.
            pub fn check(&self) -> Result<(), OutOfRange> {
                match self {
                    $(Self::$Material(material) => {
                        material.check_ranges()?;
                        material.check()
                    })+
                }
            }

            /// Returns the name of the model in case files.
            pub fn model(&self) -> &'static str {
                match self {
                    $(Self::$Material(_) => $name,)+
                }
            }

            /// Returns the parameters with their keys in case files.
            pub fn parameters(&self) -> Vec<(&'static str, f64)> {
                match self {
                    $(Self::$Material(material) => {
                        let ranges = $Material::RANGES.iter();
                        ranges.filter_map(|range| Some((range.key, (range.stated)(material)?))).collect()
                    })+
                }
            }

            /// Returns the material with its moduli and its exponents, if it has any, multiplied.
            pub fn scaled(self, stiffness: f64, exponent: f64) -> Self {
                match self {
                    $(Self::$Material(material) => Self::$Material(material.scaled(stiffness, exponent)),)+
                }
            }

            fn true_stress(&self, constrained: bool) -> Vec<(f64, f64)> {
                match self {
                    $(Self::$Material(material) => material.true_stress(constrained),)+
                }
            }

            /// The best fit of each material to samples of a stress.
            pub(super) fn fitted(samples: &[Sample], compression: Compression) -> Vec<Self> {
                vec![$(Self::$Material($Material::fitted(samples, compression))),+]
            }

            #[cfg(test)]
            pub(super) fn examples() -> Vec<Self> {
                [$($Material::EXAMPLES.iter().copied().map(Self::$Material).collect::<Vec<_>>()),+].concat()
            }

            #[cfg(test)]
            fn energy_kpa(&self, stretches: [f64; 3]) -> f64 {
                match self {
                    $(Self::$Material(material) => material.energy_kpa(stretches),)+
                }
            }
        }

        $(impl From<$Material> for Material {
            fn from(material: $Material) -> Self {
                Self::$Material(material)
            }
        })+
    };
}

materials! {
    "neo-hookean" neo_hookean: NeoHookean = "Neo-Hookean: W = (mu/2) (I1 - 3).";
    "mooney-rivlin" mooney_rivlin: MooneyRivlin = "Mooney-Rivlin: W = c10 (I1 - 3) + c01 (I2 - 3).";
    "yeoh" yeoh: Yeoh = "Yeoh: W = c10 (I1 - 3) + c20 (I1 - 3)^2.";
    "ogden" ogden: Ogden = "Ogden: W = (2 mu/alpha^2) (l1^alpha + l2^alpha + l3^alpha - 3).";
}

impl Kind for ModelName {
    fn stated_as(self) -> String {
        format!("`model = {}`", word(&self))
    }
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
