//! A case file as it is written.

use std::path::Path;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::BeamCaseError;
use crate::document::{self, Source, Version};

/// A needle in layers of tissue whose base is moved sideways. It lies along x, from the base (before 0) through the entry (0) to
/// the tip; u is its deflection across.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// The needle.
    pub needle: NeedleSpec,
    /// How its base is moved.
    pub base: BaseSpec,
    /// How it is divided.
    #[serde(default)]
    pub mesh: MeshSpec,
    /// Layers of tissue, from the entry on.
    #[serde(default)]
    pub layer: Vec<LayerSpec>,
    /// The text that it was read from, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

/// A solid round rod.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NeedleSpec {
    /// Young's modulus, GPa (1e-3 to 1e4): 200 of steel.
    pub young_gpa: f64,
    /// mm (0.01 to 10).
    pub diameter_mm: f64,
    /// How deep the tip is, mm (0 to the sum of the layers). Default: that sum.
    pub inserted_mm: Option<f64>,
}

/// How the base is moved.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BaseSpec {
    /// From the base to the point of entry, mm (0 to 1e4).
    pub control_distance_mm: f64,
    /// Displacement across the needle, mm.
    pub displacement_mm: f64,
    /// Slope du/dx. Default: the base turns freely, without moment.
    pub slope: Option<f64>,
}

/// How the needle is divided.
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

/// A layer of tissue.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LayerSpec {
    /// mm (above 0, at most 1e4).
    pub thickness_mm: f64,
    /// Model of the material.
    pub model: ModelName,
    /// `ogden` and `neo-hookean`: shear modulus, kPa (0 to 1e12).
    pub mu_kpa: Option<f64>,
    /// `ogden`: exponent, of either sign (0.001 to 1000 in size).
    pub alpha: Option<f64>,
    /// `mooney-rivlin` and `yeoh`: factor of I1 - 3, kPa.
    pub c10_kpa: Option<f64>,
    /// `mooney-rivlin`: factor of I2 - 3, kPa.
    pub c01_kpa: Option<f64>,
    /// `yeoh`: factor of (I1 - 3)^2, kPa.
    pub c20_kpa: Option<f64>,
    /// How it is compressed, and which stress is meant.
    pub compression: CompressionName,
    /// Length of the tissue beside the needle before it is compressed, mm (above 0); `inf`: it stays linear.
    pub initial_length_mm: f64,
    /// Friction between needle and tissue (0 to 1). Default 0.
    #[serde(default)]
    pub friction: f64,
}

/// Models of materials.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ModelName {
    /// W = (2 mu/alpha^2) (l1^alpha + l2^alpha + l3^alpha - 3).
    Ogden,
    /// W = (mu/2) (I1 - 3).
    NeoHookean,
    /// W = c10 (I1 - 3) + c01 (I2 - 3).
    MooneyRivlin,
    /// W = c10 (I1 - 3) + c20 (I1 - 3)^2.
    Yeoh,
}

/// Models of compression.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum CompressionName {
    /// Unconstrained, engineering stress.
    UEng,
    /// Unconstrained, true stress.
    UTru,
    /// Constrained along the needle, true stress.
    CTru,
}

impl CaseFile {
    /// Reads a case file.
    ///
    /// # Errors
    /// [`BeamCaseError`] for a file that cannot be read or is no case.
    pub fn read(path: &Path) -> Result<Self, BeamCaseError> {
        Self::parse(&document::read(path)?, &path.display().to_string())
    }

    /// Parses the text of a case file; `name` names it in errors.
    ///
    /// # Errors
    /// [`BeamCaseError`] that points at what is no TOML, at a key that no case has, or at a value of the wrong type.
    pub fn parse(text: &str, name: &str) -> Result<Self, BeamCaseError> {
        let (mut file, source): (Self, _) = document::parse(text, name)?;
        file.source = Some(source);
        Ok(file)
    }
}
