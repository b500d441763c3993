//! A plan as it is written.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Speed of a planned needle, mm/s.
pub const DEFAULT_SPEED_MM_S: f64 = 10.0;
/// Pause between planned insertions, s.
pub const DEFAULT_PAUSE_S: f64 = 0.5;

/// What is to be done.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PlanSpec {
    /// The template that guides the needles.
    pub template: Option<TemplateSpec>,
    /// Speed of needles that state none, and of `needle.target`, mm/s (above 0, at most 1000). Default 10.
    pub speed_mm_s: Option<f64>,
    /// Time at full depth, and outside between one insertion and the next, s (0.01 to 1000). Default 0.5.
    pub pause_s: Option<f64>,
    /// When the first insertion starts, s (0 to 1e6). Default 0.
    pub start_s: Option<f64>,
    /// Insertions through the template, one after another, in place of `needle.motion` and `needle.target`.
    pub needle: Vec<PlannedNeedle>,
    /// Places that needles or seeds are to reach, for the report.
    pub target: Vec<TargetSpec>,
}

/// A plate with rows and columns of holes, square to the needles that it guides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TemplateSpec {
    /// The hole of the first column and row, in the world (LPS), mm. Depths count from here; it lies outside the body.
    pub origin_mm: [f64; 3],
    /// Direction from column to column; any length.
    pub x_axis: [f64; 3],
    /// Direction from row to row, square to `x_axis`; any length.
    pub y_axis: [f64; 3],
    /// Where needles go. Default: `x_axis` cross `y_axis`; given, it must be that or its opposite.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f64; 3]>,
    /// Distance between holes, mm (above 0, at most 100). Default 5.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_mm: Option<f64>,
    /// Whether a needle is held across its shaft by the hole that it runs through; without, the template only says where
    /// needles go. Default true.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub holds: Option<bool>,
    /// Names of the columns and of the rows: hole `C2` is that of column `C` and row `2`.
    pub names: TemplateNames,
}

/// What columns and rows of a template are called.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TemplateNames {
    /// Of the columns, in the order of `x_axis`.
    pub columns: Vec<String>,
    /// Of the rows, in the order of `y_axis`.
    pub rows: Vec<String>,
}

/// An insertion: in to a depth, out again, seeds left on the way out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlannedNeedle {
    /// The hole: a column's name and a row's.
    pub hole: String,
    /// How far the tip goes beyond the template, mm (above 0, less than the needle's length).
    pub depth_mm: f64,
    /// Speed in and out, mm/s (above 0, at most 1000). Default: that of the plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_mm_s: Option<f64>,
    /// Depths at which a seed is left as the tip comes back, mm (0 to `depth_mm`), in any order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub seeds_mm: Vec<f64>,
    /// Turn about the shaft, degrees: it turns a bevel. Default 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roll_deg: Option<f64>,
}

/// A place that a needle or a seed is to reach.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetSpec {
    /// What it is called in the report.
    pub name: String,
    /// Where it is in the anatomy at rest (LPS), mm.
    pub at_mm: [f64; 3],
}
