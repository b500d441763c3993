//! Serde types of a scenario file.

use std::fmt;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};

use super::instruments::ContactProbeSpec;
use super::instruments::NeedleTable;
use super::manipulator::ManipulatorSpec;
use super::plan::PlanSpec;
use super::reported_points::ReportSpec;
use super::tissue::TissueSpec;
use insonify_base::document::{self, Source};
use insonify_base::range::parameters;
use insonify_gpu::AdapterChoice;
use insonify_imaging::quality::QualitySpec;
use insonify_imaging::scene::{SceneFile, Version};
use insonify_mechanics::tissue::remesh::Level;

/// A needle insertion: scene, deformable tissue, and the motion of needle and probe. Paths are relative to the folder
/// of the file.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenarioFile {
    /// Version of the format: 1 or 2, which is the default, as of scenes; `[scene]` has that of the scenario.
    pub version: Option<Version>,
    /// Imaged scene and pose or motion of the probe: the name of a scene that comes with the program, the path of a
    /// scene file, or a scene as a table. It has neither needle nor `deform`: the scenario provides both. With
    /// `motion.breathing` and `motion.pulse` the needle meets a body that breathes (finite elements).
    #[schemars(required)]
    pub scene: Option<SceneSource>,
    /// Time budgets of steps and frames: settings left open are chosen by their measured cost on this machine.
    /// Default: that of a scene written inline.
    pub quality: Option<QualitySpec>,
    /// Duration and time step of the run.
    #[serde(default)]
    pub run: RunSpec,
    /// Tissue model.
    #[serde(default)]
    pub tissue: TissueSpec,
    /// Needle and its motion.
    #[schemars(required)]
    pub needle: Option<NeedleTable>,
    /// Probe as a cylinder in contact with tissue. Without it the probe only images.
    pub contact_probe: Option<ContactProbeSpec>,
    /// Needle guide mounted on the probe. Without it the needle moves exactly as stated.
    pub manipulator: Option<ManipulatorSpec>,
    /// Plan: template, needles, seeds, targets.
    pub plan: Option<PlanSpec>,
    /// Points of the tissue whose displacement is reported.
    #[serde(default)]
    pub report: Vec<ReportSpec>,
    /// Source text, for errors that point into it.
    #[serde(skip)]
    pub source: Option<Arc<Source>>,
    /// Adapter for `tissue.device = "gpu"`. Default: that of the environment, else the best.
    #[serde(skip)]
    pub adapter: Option<AdapterChoice>,
}

document::input_file!(ScenarioFile, in_ranges);

impl ScenarioFile {
    /// Time budgets of steps and frames, as stated in the scenario or in an inline scene.
    pub fn quality(&self) -> QualitySpec {
        let of_scene = match &self.scene {
            Some(SceneSource::Inline(scene)) => scene.quality,
            _ => None,
        };
        self.quality.or(of_scene).unwrap_or_default()
    }
}

/// Source of a scene.
#[derive(Clone, Debug, PartialEq, JsonSchema)]
#[schemars(untagged)]
pub enum SceneSource {
    /// The name of a scene that comes with the program (`insonify scene` lists them), or the path of a scene file.
    Named(String),
    /// An inline scene.
    Inline(Box<SceneFile>),
}

impl<'de> Deserialize<'de> for SceneSource {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = SceneSource;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the name of a scene, its path, or a scene as a table")
            }

            fn visit_str<E>(self, name: &str) -> Result<Self::Value, E> {
                Ok(SceneSource::Named(name.to_owned()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
                SceneFile::deserialize(MapAccessDeserializer::new(map)).map(|file| SceneSource::Inline(Box::new(file)))
            }
        }
        deserializer.deserialize_any(Either)
    }
}

parameters! {
    /// Duration and time step of a run.
    pub struct RunSpec {
        /// Time step: 1 ms is the usual haptic rate.
        dt_ms: f64 = 1.0, in 0.01..=100 "ms";
        /// Duration, s (above 0, at most 1e7 steps). Default: to the end of the motions of needle and probe.
        duration_s: Option<f64>;
        /// Frames per second of simulated time.
        frame_rate_hz: f64 = 25.0, above 0..=1000 "frames a second";
        /// Changes of the level of remeshing during the run (finite elements), ascending in time.
        change: Vec<ChangeSpec>;
    }
}

/// A change of the level of remeshing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChangeSpec {
    /// Time of the change, s, on the clock of the motions and within the run: it takes effect before the step that
    /// reaches this time.
    pub at_s: f64,
    /// New level. One that needs the first dense inverse of the run computes it then, unless `tissue.columns` is
    /// `dense`.
    pub level: Level,
}
