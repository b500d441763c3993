//! Scenario files for needle insertions: scene, deformable tissue, needle and probe in one TOML file.
//!
//! [`ScenarioFile`] is the file as written; [`ScenarioFile::resolve`] loads what it names, makes the mesh and checks
//! every number; [`run`](crate::run::run) moves needle and probe through it, step by step. Errors point at the line.
//!
//! ```
//! use insonify::ScenarioFile;
//!
//! let text = r#"
//! scene = "prostate-trus"
//! [[needle.motion.keyframes]]
//! time_s = 0
//! tip_mm = [0, -5, -60]
//! direction = [0, 0, 1]
//! [[needle.motion.keyframes]]
//! time_s = 4
//! tip_mm = [0, -5, 0]
//! direction = [0, 0, 1]
//! "#;
//! let file = ScenarioFile::parse(text, "insert.toml")?;
//! assert!(file.plan.is_none());
//!
//! let error = ScenarioFile::parse(&text.replace("tip_mm", "tip"), "insert.toml").unwrap_err();
//! assert_eq!(error.location(), Some(("insert.toml", 5)));
//! # Ok::<(), insonify::InputError>(())
//! ```

pub mod aim;
pub mod clearance;
pub mod file;
mod finite_element;
pub mod guidance;
pub mod instruments;
mod labels;
pub mod manipulator;
mod mass_spring;
mod mesh;
mod needle;
pub mod nonlinear_tissue;
pub mod plan;
pub mod planning_study;
mod probe;
mod regions;
pub mod reported_points;
mod resolve;
mod rewritten;
mod scene;
mod section;
pub mod tissue;
mod tissue_box;
mod tissue_setup;

pub use file::{ScenarioFile, SceneSource};
pub use finite_element::{FiniteElement, Remeshing};
pub use insonify_mechanics::needle::{NeedleKeys, NeedleModel};
pub use instruments::{CommonNeedleKeys, NeedleTable};
pub use needle::NeedleSettings;
pub use nonlinear_tissue::NonlinearTissue;
pub use plan::{Deposit, Guide, Target};
pub use probe::Contact;
pub use resolve::{Scenario, Timing};
pub use rewritten::ScenarioText;
pub use section::PlaneSection;
pub use tissue::{DEFAULT_NODES, TissueModel};
pub use tissue_setup::TissueSetup;

use std::path::Path;

use nalgebra::Point3;

use insonify_base::document::{InputError, InvalidFile};
use insonify_imaging::scene::{SceneFile, Version};
use insonify_mesh::generate::{GenerateReport, NEAR_MM};
use insonify_tracking::trajectory::Trajectory;

/// Built-in scenarios, by name.
pub const EXAMPLES: &[(&str, &str)] = &[
    ("liver-biopsy", include_str!("../../assets/liver-biopsy.toml")),
    ("liver-training", include_str!("../../assets/liver-training.toml")),
    ("liver-puncture", include_str!("../../assets/liver-puncture.toml")),
    (
        "prostate-brachytherapy",
        include_str!("../../assets/prostate-brachytherapy.toml"),
    ),
    ("prostate-implant", include_str!("../../assets/prostate-implant.toml")),
    ("spine-injection", include_str!("../../assets/spine-injection.toml")),
    (
        "segmentation-biopsy",
        include_str!("../../assets/segmentation-biopsy.toml"),
    ),
    (
        "two-layer-insertion",
        include_str!("../../assets/two-layer-insertion.toml"),
    ),
];

/// Name and text of the built-in scenario that a path names, unless there is such a file.
pub fn bundled(path: &Path) -> Option<(&'static str, &'static str)> {
    insonify_base::document::bundled(EXAMPLES, path)
}

/// Reference scenario that explains every key.
pub const REFERENCE: &str = include_str!("../../assets/scenario.toml");

/// The JSON schema of a scenario file.
pub fn schema() -> serde_json::Value {
    schemars::schema_for!(ScenarioFile).to_value()
}

impl ScenarioFile {
    /// Scenario for a needle to a target in a label file: the probe is placed over the target, the needle enters beside
    /// it.
    pub fn for_labels(path: &Path, target: &str) -> Self {
        Self {
            version: Some(Version::NEWEST),
            scene: Some(SceneSource::Inline(Box::new(SceneFile::for_labels(path)))),
            needle: Some(NeedleTable::from(CommonNeedleKeys {
                target: Some(target.to_owned()),
                ..CommonNeedleKeys::default()
            })),
            ..Self::default()
        }
    }
}

/// Minimum length of a piece of the path, mm: shorter ones are merged.
const PIECE_MM: f64 = 2.0;

/// Straight pieces of the tip's path, mm.
fn path_pieces(tip: &Trajectory) -> Vec<[Point3<f64>; 2]> {
    let mut places = tip.keys().iter().map(|key| key.pose.position_mm());
    let Some(mut start) = places.next() else {
        return Vec::new();
    };
    let mut pieces = Vec::new();
    for end in places {
        if (end - start).norm() >= PIECE_MM {
            pieces.push([start, end]);
            start = end;
        }
    }
    pieces
}

/// Note about a generated mesh.
fn mesh_note(report: &GenerateReport, along_path: bool) -> String {
    let GenerateReport { nodes, elements, .. } = report;
    let mislabelled = report.mislabelled_percent;
    let finer = if along_path {
        "finer along the needle's path"
    } else {
        "no finer along the needle's path"
    };
    match report.near_mislabelled_percent {
        None => format!(
            "mesh: {nodes} nodes, {elements} tetrahedra; {mislabelled:.0} % of the tissue lie in elements of another region"
        ),
        Some(near) => format!(
            "mesh: {nodes} nodes, {elements} tetrahedra, {finer}; {near:.0} % of the tissue within {NEAR_MM} mm of the path and \
             {mislabelled:.0} % of all tissue lie in elements of another region"
        ),
    }
}

impl ScenarioFile {
    /// Returns a number of this file if it is within its range.
    fn number(
        &self,
        key: impl Into<String>,
        found: f64,
        holds: impl FnOnce(f64) -> bool,
        expected: &'static str,
    ) -> Result<f64, InputError> {
        if found.is_finite() && holds(found) {
            Ok(found)
        } else {
            Err(self.fault(key, InvalidFile::number(found, expected)))
        }
    }

    /// Returns a direction vector of this file.
    fn direction(&self, key: &str, found: [f64; 3]) -> Result<nalgebra::Unit<nalgebra::Vector3<f64>>, InputError> {
        let finite = found.iter().all(|x| x.is_finite());
        nalgebra::Unit::try_new(nalgebra::Vector3::from(found), 1e-9)
            .filter(|_| finite)
            .ok_or_else(|| {
                let expected = "finite numbers that are not all zero";
                self.wrong_keys(key, format!("{found:?}"), expected)
            })
    }

    /// Returns a point of this file.
    fn place(&self, key: &str, found: [f64; 3]) -> Result<nalgebra::Point3<f64>, InputError> {
        if found.iter().all(|x| x.abs() <= insonify_base::matrix::FARTHEST_MM) {
            Ok(found.into())
        } else {
            let expected = "finite coordinates of at most 1e6 mm";
            Err(self.wrong_keys(key, format!("{found:?}"), expected))
        }
    }

    /// Converts an error of the scene, which lies in its own file or inline in this one.
    fn of_scene(&self, mut error: InputError, is_inline: bool) -> InputError {
        let key = error.key().map(str::to_owned);
        let is_written = self.source.as_ref().is_some_and(|source| source.is_file());
        if is_inline && key.as_deref() == Some("volume.file") && is_written {
            let help = "the key `file` under [scene.volume] names the label file: put the path of your own there";
            error = error.with_help(Some(help.to_owned()));
        }
        match key {
            Some(key) if key.starts_with("needle") => error.at_key(key, self.source.as_ref()),
            Some(key) if is_inline => error.at_key(format!("scene.{key}"), self.source.as_ref()),
            _ => error,
        }
    }
}

#[cfg(test)]
mod tests;
