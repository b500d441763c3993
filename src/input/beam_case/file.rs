//! Serde types of a case file, and its errors.

use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::base::document::{self, Source, Version};
use crate::input::Cause;
use crate::mechanics::needle::beam::Compression;

/// A needle in layers of tissue whose base is moved sideways. It lies along x, from the base (before 0) through the entry (0) to
/// the tip; u is its lateral deflection.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// The needle.
    pub needle: NeedleSpec,
    /// Motion of the base.
    pub base: BaseSpec,
    /// Discretisation of the needle.
    #[serde(default)]
    pub mesh: MeshSpec,
    /// Tissue layers, starting at the entry.
    #[serde(default)]
    pub layer: Vec<LayerSpec>,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

document::input_file!(CaseFile, Cause);

/// A solid round rod.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NeedleSpec {
    /// Young's modulus, GPa (1e-3 to 1e4): 200 for steel.
    pub young_gpa: f64,
    /// Diameter, mm (0.01 to 10).
    pub diameter_mm: f64,
    /// Depth of the tip, mm (0 to the sum of the layers). Default: that sum.
    pub inserted_mm: Option<f64>,
}

/// Motion of the base.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BaseSpec {
    /// Distance from the base to the point of entry, mm (0 to 1e4).
    pub control_distance_mm: f64,
    /// Lateral displacement, mm.
    pub displacement_mm: f64,
    /// Slope du/dx. Default: the base rotates freely, without moment.
    pub slope: Option<f64>,
}

/// Discretisation of the needle.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MeshSpec {
    /// Longest element, mm (above 0). Default 1.
    pub element_mm: f64,
}

impl Default for MeshSpec {
    fn default() -> Self {
        Self { element_mm: 1.0 }
    }
}

/// A tissue layer.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerSpec {
    /// Thickness, mm (above 0, at most 1e4).
    pub thickness_mm: f64,
    /// Hyperelastic model.
    pub model: ModelName,
    /// `ogden` and `neo-hookean`: shear modulus, kPa (0 to 1e12).
    pub mu_kpa: Option<f64>,
    /// `ogden`: exponent, of either sign (magnitude 0.001 to 1000).
    pub alpha: Option<f64>,
    /// `mooney-rivlin` and `yeoh`: coefficient of I1 - 3, kPa.
    pub c10_kpa: Option<f64>,
    /// `mooney-rivlin`: coefficient of I2 - 3, kPa.
    pub c01_kpa: Option<f64>,
    /// `yeoh`: coefficient of (I1 - 3)^2, kPa.
    pub c20_kpa: Option<f64>,
    /// Compression model and stress measure.
    pub compression: Compression,
    /// Uncompressed length of the tissue beside the needle, mm (above 0); `inf`: it stays linear.
    pub initial_length_mm: f64,
    /// Friction between needle and tissue (0 to 1). Default 0.
    #[serde(default)]
    pub friction: f64,
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
