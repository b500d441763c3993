//! Scenario files for needle insertions: scene, deformable tissue, needle and probe in one TOML file.
//!
//! [`ScenarioFile`] is the file as written; [`ScenarioFile::resolve`] loads what it names, makes the mesh and checks every
//! number; [`run`](run::run) moves needle and probe through it, step by step. Errors point at the line.
//!
//! ```
//! use insonify::ScenarioFile;
//!
//! let text = r#"
//! version = 1
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
//! assert_eq!(error.location(), Some(("insert.toml", 6)));
//! # Ok::<(), insonify::input::InputError>(())
//! ```

pub(crate) mod aim;
mod along;
pub(crate) mod carried;
pub(crate) mod clearance;
mod cut;
mod cylinder;
pub mod deformed;
mod error;
pub mod file;
pub mod guidance;
pub mod instruments;
mod labels;
pub mod manipulator;
mod mesh;
mod model;
mod modelling;
mod needle;
mod plan;
pub mod planned;
pub mod points;
mod probe;
#[cfg(feature = "cli")]
pub mod record;
mod regions;
mod resolve;
pub mod run;
mod scene;
#[cfg(feature = "cli")]
mod section;
pub mod stiffened;
mod summary;
#[cfg(test)]
mod tests;
pub mod tissue;
mod trial;

use std::path::Path;

use crate::base::document;
use crate::input::scene::SceneFile;

pub use file::{ScenarioFile, SceneSource};
pub use instruments::{NeedleModel, NeedleTable};
pub use resolve::Scenario;
pub use summary::Summary;
pub use tissue::{DEFAULT_NODES, TissueModel};
pub use trial::Trial;

/// Built-in scenarios, by name.
pub const EXAMPLES: &[(&str, &str)] = &[
    ("liver-biopsy", include_str!("../../assets/liver-biopsy.toml")),
    ("liver-training", include_str!("../../assets/liver-training.toml")),
    ("liver-puncture", include_str!("../../assets/liver-puncture.toml")),
    (
        "prostate-brachytherapy",
        include_str!("../../assets/prostate-brachytherapy.toml"),
    ),
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
            version: Some(document::Version),
            scene: Some(SceneSource::Inline(Box::new(SceneFile::for_labels(path)))),
            needle: Some(NeedleTable {
                target: Some(target.to_owned()),
                ..NeedleTable::default()
            }),
            ..Self::default()
        }
    }
}
