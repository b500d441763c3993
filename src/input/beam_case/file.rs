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

/// A round rod or tube; its bending stiffness follows from the material and the diameters, or is given.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NeedleSpec {
    /// Young's modulus, GPa (1e-3 to 1e4): 200 for steel.
    pub young_gpa: Option<f64>,
    /// Outer diameter, mm (0.01 to 10).
    pub diameter_mm: Option<f64>,
    /// Inner diameter of a hollow needle, mm (0 to below the outer one). Default 0: solid.
    pub inner_diameter_mm: Option<f64>,
    /// Bending stiffness EI, N mm^2 (1e-6 to 1e12), in place of modulus and diameters.
    pub bending_stiffness_nmm2: Option<f64>,
    /// Depth of the tip, mm (0 to the sum of the layers). Default: that sum.
    pub inserted_mm: Option<f64>,
    /// Measured shape: pairs of position along the undeflected needle and deflection, mm, from base to tip (`insonify beam measure`).
    /// It is drawn, and compared with the computed shape (`insonify beam compare`).
    pub measured_mm: Option<Vec<[f64; 2]>>,
}

/// Motion of the base.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BaseSpec {
    /// Distance from the base to the point of entry, mm (0 to 1e4).
    pub control_distance_mm: f64,
    /// Lateral displacement, mm; with `pivot_mm` that of the axis.
    pub displacement_mm: f64,
    /// Slope du/dx. Default: the base rotates freely, without moment.
    pub slope: Option<f64>,
    /// Without `slope`: distance from the base back to the axis about which it rotates freely, mm (0 to 1e4). Default 0.
    pub pivot_mm: Option<f64>,
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
    /// Compression ratio (length over uncompressed length) below which `insonify beam inverse` rejects a motion of the base (0 to below
    /// 1). Default 0: no limit.
    #[serde(default)]
    pub min_compression_ratio: f64,
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
