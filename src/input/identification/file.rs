//! Serde types of a case file.

use std::path::PathBuf;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::base::document::{self, RegionName, Source, Version};
use crate::base::range::parameters;
use crate::input::Cause;

/// A measured insertion, and the scenario that is to reproduce it. Paths are relative to the folder of the file.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CaseFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// Scenario: mesh or volume, fixed nodes, straight line of the needle, probe. The name of one that comes with the program, or the path of
    /// one (linear finite elements).
    pub scenario: String,
    /// Measured force.
    pub force: ForceSpec,
    /// Measured displacement of the tissue; required unless every Young's modulus is known.
    pub motion: Option<MotionSpec>,
    /// Poisson's ratios (0 to below 0.5): an identification for each, with all layers of that ratio. Default: one, with those of the scenario.
    #[serde(default)]
    pub poisson: Vec<f64>,
    /// Quantity that is minimised. Default `points`.
    #[serde(default)]
    pub cost: Cost,
    /// Weight W of the displacements measured in each region of the force, two regions a layer (0 or more, not all 0). Default 1 while a layer
    /// is punctured, 4 behind.
    pub weights: Option<Vec<f64>>,
    /// Layers whose Young's modulus is known, or where its search starts.
    #[serde(default)]
    pub layer: Vec<LayerSpec>,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
}

document::input_file!(CaseFile, Cause);

/// Measured force.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ForceSpec {
    /// CSV file with the columns `tip_mm` (way of the needle's tip beyond the surface at rest) and `force_n` (positive while the needle is
    /// pushed in); or a table `steps.csv` of `insonify insert`.
    pub file: PathBuf,
}

/// Measured displacement of the tissue.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionSpec {
    /// CSV file: the table of `insonify motion`, or of `insonify rf --truth`; or the columns `tip_mm`, `node` or `x_mm,y_mm,z_mm` (at rest), and
    /// `ux_mm`, `uy_mm`, `uz_mm` (some of them; empty cells are not measured).
    pub file: PathBuf,
    /// With frames: CSV file with the columns `frame` and `tip_mm`. Default: frames at the rate of the scenario, during its motion of the
    /// needle.
    pub frames: Option<PathBuf>,
}

/// Cost function.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Cost {
    /// Sum of the squared errors of all displacements (Dehghan et al. 2008, equation 1).
    #[default]
    Points,
    /// Squared error of the mean displacement (Dehghan et al. 2007).
    Mean,
}

parameters! {
    /// A layer.
    pub struct LayerSpec with required keys {
        /// Region: its name, a part of its name, or its number.
        region: RegionName;
        /// Young's modulus. Default: that of the scenario.
        young_kpa: Option<f64>, above 0 "kPa";
        /// Whether the modulus is known; otherwise the search starts there. Default false.
        #[serde(default)]
        known: bool;
    }
}
