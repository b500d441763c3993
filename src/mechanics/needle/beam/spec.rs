//! Tables of a case file: needle, base, elements and layers, with the ranges of their numbers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Compression, Material};
use insonify_base::range::parameters;

parameters! {
    /// A round rod or tube; its bending stiffness follows from the material and the diameters, or is given.
    pub struct NeedleSpec {
        /// Young's modulus: 200 for steel.
        young_gpa: Option<f64>, in 1e-3..=1e4 "GPa";
        /// Outer diameter.
        diameter_mm: Option<f64>, in 0.01..=10 "mm";
        /// Inner diameter of a hollow needle, mm (0 to below the outer one). Default 0: solid.
        inner_diameter_mm: Option<f64>;
        /// Bending stiffness EI, in place of modulus and diameters.
        bending_stiffness_nmm2: Option<f64>, in 1e-6..=1e12 "N mm^2";
        /// Depth of the tip, mm (0 to the sum of the layers). Default: that sum.
        inserted_mm: Option<f64>;
        /// Measured shape: pairs of position along the undeflected needle and deflection, mm, from base to tip (`insonify beam measure`).
        /// It is drawn, and compared with the computed shape (`insonify beam compare`).
        measured_mm: Option<Vec<[f64; 2]>>;
    }
}

parameters! {
    /// Motion of the base.
    pub struct BaseSpec with required keys {
        /// Distance from the base to the point of entry.
        control_distance_mm: f64, in 0..=1e4 "mm";
        /// Lateral displacement; with `pivot_mm` that of the axis.
        displacement_mm: f64, in -1e6..=1e6 "mm";
        /// Slope du/dx. Default: the base rotates freely, without moment.
        slope: Option<f64>, in -1e6..=1e6;
        /// Without `slope`: distance from the base back to the axis about which it rotates freely. Default 0.
        pivot_mm: Option<f64>, in 0..=1e4 "mm";
    }
}

parameters! {
    /// Discretisation of the needle.
    pub struct MeshSpec {
        /// Longest element.
        element_mm: f64 = 1.0, above 0 "mm";
    }
}

parameters! {
    /// A tissue layer.
    pub struct LayerSpec with required keys {
        /// Thickness.
        thickness_mm: f64, above 0..=1e4 "mm";
        /// Hyperelastic model.
        model: ModelName;
        /// `ogden` and `neo-hookean`: shear modulus.
        mu_kpa: Option<f64>, in 0..=1e12 "kPa";
        /// `ogden`: exponent, of either sign (magnitude 0.001 to 1000).
        alpha: Option<f64>;
        /// `mooney-rivlin` and `yeoh` (0 or more): coefficient of I1 - 3.
        c10_kpa: Option<f64>, in -1e12..=1e12 "kPa";
        /// `mooney-rivlin`: coefficient of I2 - 3, kPa.
        c01_kpa: Option<f64>;
        /// `yeoh`: coefficient of (I1 - 3)^2.
        c20_kpa: Option<f64>, in -1e12..=1e12 "kPa";
        /// Compression model and stress measure.
        compression: Compression;
        /// Uncompressed length of the tissue beside the needle, mm (above 0); `inf`: it stays linear.
        initial_length_mm: f64;
        /// Friction between needle and tissue. Default 0.
        #[serde(default)]
        friction: f64, in 0..=1;
        /// Compression ratio (length over uncompressed length) below which `insonify beam inverse` rejects a motion of the base. Default 0: no limit.
        #[serde(default)]
        min_compression_ratio: f64, in 0..1;
    }
}

/// Hyperelastic model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ModelName {
    /// Ogden: W = (2 mu/alpha^2) (l1^alpha + l2^alpha + l3^alpha - 3).
    Ogden,
    /// Neo-Hookean: W = (mu/2) (I1 - 3).
    NeoHookean,
    /// Mooney-Rivlin: W = c10 (I1 - 3) + c01 (I2 - 3).
    MooneyRivlin,
    /// Yeoh: W = c10 (I1 - 3) + c20 (I1 - 3)^2.
    Yeoh,
}

impl LayerSpec {
    /// Returns the material, or the key that is missing (`false`) or superfluous (`true`).
    pub fn material(&self) -> Result<Material, (&'static str, bool)> {
        let given = [
            ("mu_kpa", self.mu_kpa),
            ("alpha", self.alpha),
            ("c10_kpa", self.c10_kpa),
            ("c01_kpa", self.c01_kpa),
            ("c20_kpa", self.c20_kpa),
        ];
        let keys = self.model.keys();
        // Ignored, a key of another model would leave the layer with a stiffness that its author did not
        // mean.
        if let Some((key, _)) = given.iter().find(|(key, value)| value.is_some() && !keys.contains(key)) {
            return Err((key, true));
        }
        let number = |key: &'static str| {
            let value = given
                .iter()
                .find(|(name, _)| *name == key)
                .and_then(|(_, value)| *value);
            value.ok_or((key, false))
        };
        Ok(match self.model {
            ModelName::Ogden => Material::Ogden {
                mu_kpa: number("mu_kpa")?,
                alpha: number("alpha")?,
            },
            ModelName::NeoHookean => Material::NeoHookean {
                mu_kpa: number("mu_kpa")?,
            },
            ModelName::MooneyRivlin => Material::MooneyRivlin {
                c10_kpa: number("c10_kpa")?,
                c01_kpa: number("c01_kpa")?,
            },
            ModelName::Yeoh => Material::Yeoh {
                c10_kpa: number("c10_kpa")?,
                c20_kpa: number("c20_kpa")?,
            },
        })
    }
}

impl ModelName {
    /// Name in case files.
    pub fn name(self) -> &'static str {
        match self {
            ModelName::Ogden => "ogden",
            ModelName::NeoHookean => "neo-hookean",
            ModelName::MooneyRivlin => "mooney-rivlin",
            ModelName::Yeoh => "yeoh",
        }
    }

    /// Keys of the parameters of a model.
    pub fn keys(self) -> &'static [&'static str] {
        match self {
            ModelName::Ogden => &["mu_kpa", "alpha"],
            ModelName::NeoHookean => &["mu_kpa"],
            ModelName::MooneyRivlin => &["c10_kpa", "c01_kpa"],
            ModelName::Yeoh => &["c10_kpa", "c20_kpa"],
        }
    }
}
