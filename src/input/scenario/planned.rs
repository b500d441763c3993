//! `[plan]` table of a scenario file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use insonify_base::range::parameters;

parameters! {
    /// Plan of insertions: template, needles and targets.
    pub struct PlanSpec {
        /// Template that guides the needles.
        template: Option<TemplateSpec>;
        /// Speed of needles that state none, and of `needle.target`.
        speed_mm_s: f64 = 10.0, above 0..=1000 "mm/s";
        /// Pause at full depth, and outside between insertions.
        pause_s: f64 = 0.5, in 0.01..=1000 "s";
        /// Start of the first insertion.
        start_s: f64 = 0.0, in 0..=1e6 "s";
        /// Insertions through the template, in sequence, in place of `needle.motion` and `needle.target`.
        needle: Vec<PlannedNeedle>;
        /// Targets of needles or seeds, for the report.
        target: Vec<TargetSpec>;
    }
}

parameters! {
    /// A plate with rows and columns of holes, perpendicular to the needles that it guides.
    pub struct TemplateSpec with required keys {
        /// Hole of the first column and row, in the world (LPS), mm. Depths are measured from here; it lies outside the body.
        origin_mm: [f64; 3];
        /// Direction from column to column; any length.
        x_axis: [f64; 3];
        /// Direction from row to row, perpendicular to `x_axis`; any length.
        y_axis: [f64; 3];
        /// Direction of needles. Default: `x_axis` cross `y_axis`; if given, it must be that or its opposite.
        direction: Option<[f64; 3]>;
        /// Distance between holes. Default 5 mm.
        spacing_mm: Option<f64>, above 0..=100 "mm";
        /// Whether the hole constrains the needle laterally; otherwise, the template only defines the needle paths. Default true.
        holds: Option<bool>;
        /// Names of columns and rows: hole `C2` is that of column `C` and row `2`.
        names: TemplateNames;
    }
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

parameters! {
    /// An insertion to a depth and back, depositing seeds on withdrawal.
    pub struct PlannedNeedle with required keys {
        /// Hole: the name of a column followed by that of a row.
        hole: String;
        /// Depth of the tip beyond the template, mm (above 0, less than the needle's length).
        depth_mm: f64;
        /// Speed of insertion and withdrawal. Default: that of the plan.
        speed_mm_s: Option<f64>, above 0..=1000 "mm/s";
        /// Depths at which a seed is deposited during withdrawal, mm (0 to `depth_mm`), in any order.
        #[serde(default)]
        seeds_mm: Vec<f64>;
        /// Roll about the shaft, degrees: it turns a bevel. Default 0.
        roll_deg: Option<f64>;
    }
}

parameters! {
    /// A target of needles or seeds.
    pub struct TargetSpec with required keys {
        /// Name in the report.
        name: String;
        /// Position in the anatomy at rest (LPS), mm.
        at_mm: [f64; 3];
        /// Radius: an image within this distance shows the target. Default 0.
        #[serde(default)]
        radius_mm: f64, in 0..=100 "mm";
    }
}
