//! `[plan]` table of a scenario file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Default speed of a planned needle, mm/s.
pub const DEFAULT_SPEED_MM_S: f64 = 10.0;
/// Default pause between planned insertions, s.
pub const DEFAULT_PAUSE_S: f64 = 0.5;

/// Plan of insertions: template, needles and targets.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PlanSpec {
    /// Template that guides the needles.
    pub template: Option<TemplateSpec>,
    /// Speed of needles that state none, and of `needle.target`, mm/s (above 0, at most 1000). Default 10.
    pub speed_mm_s: Option<f64>,
    /// Pause at full depth, and outside between insertions, s (0.01 to 1000). Default 0.5.
    pub pause_s: Option<f64>,
    /// Start of the first insertion, s (0 to 1e6). Default 0.
    pub start_s: Option<f64>,
    /// Insertions through the template, in sequence, in place of `needle.motion` and `needle.target`.
    pub needle: Vec<PlannedNeedle>,
    /// Targets of needles or seeds, for the report.
    pub target: Vec<TargetSpec>,
}

/// A plate with rows and columns of holes, perpendicular to the needles that it guides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TemplateSpec {
    /// Hole of the first column and row, in the world (LPS), mm. Depths are measured from here; it lies outside the
    /// body.
    pub origin_mm: [f64; 3],
    /// Direction from column to column; any length.
    pub x_axis: [f64; 3],
    /// Direction from row to row, perpendicular to `x_axis`; any length.
    pub y_axis: [f64; 3],
    /// Direction of needles. Default: `x_axis` cross `y_axis`; if given, it must be that or its opposite.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f64; 3]>,
    /// Distance between holes, mm (above 0, at most 100). Default 5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_mm: Option<f64>,
    /// Whether the hole constrains the needle laterally; otherwise, the template only defines the needle paths. Default
    /// true.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holds: Option<bool>,
    /// Names of columns and rows: hole `C2` is that of column `C` and row `2`.
    pub names: TemplateNames,
}

/// Names of the columns and rows of a template.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TemplateNames {
    /// Column names, in the order of `x_axis`.
    pub columns: Vec<String>,
    /// Row names, in the order of `y_axis`.
    pub rows: Vec<String>,
}

/// An insertion to a depth and back, depositing seeds on withdrawal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlannedNeedle {
    /// Hole: the name of a column followed by that of a row.
    pub hole: String,
    /// Depth of the tip beyond the template, mm (above 0, less than the needle's length).
    pub depth_mm: f64,
    /// Speed of insertion and withdrawal, mm/s (above 0, at most 1000). Default: that of the plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_mm_s: Option<f64>,
    /// Depths at which a seed is deposited during withdrawal, mm (0 to `depth_mm`), in any order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seeds_mm: Vec<f64>,
    /// Roll about the shaft, degrees: it turns a bevel. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_deg: Option<f64>,
}

/// A target of needles or seeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetSpec {
    /// Name in the report.
    pub name: String,
    /// Position in the anatomy at rest (LPS), mm.
    pub at_mm: [f64; 3],
    /// Radius, mm (0 to 100): an image within this distance shows the target. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub radius_mm: Option<f64>,
}
