//! A scenario file as it is written.

use std::fmt;
use std::sync::Arc;

use schemars::JsonSchema;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, Serialize};

use super::instruments::{ContactProbeSpec, NeedleTable};
use super::planned::PlanSpec;
use super::tissue::{LevelName, TissueSpec};
use crate::document::{Source, Version};
use crate::gpu::AdapterChoice;
use crate::quality::QualitySpec;
use crate::scene::SceneFile;

/// A needle insertion: a scene, the tissue that yields in it, and how needle and probe move. Paths are relative to the folder
/// that the file lies in.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenarioFile {
    /// Version of the format: 1, which is the default.
    pub version: Option<Version>,
    /// What is imaged, and how the probe lies or moves: the name of a scene that comes with the program, the path of a scene
    /// file, or a scene as a table. It has no needle and no deformation of its own: the scenario makes both.
    #[schemars(required)]
    pub scene: Option<SceneSource>,
    /// How long steps and frames may take: what the scenario and its scene leave open is picked from what it costs on this machine.
    /// Default: that of a scene that is written here.
    pub quality: Option<QualitySpec>,
    /// How long it runs, and in what steps.
    #[serde(default)]
    pub run: RunSpec,
    /// How tissue yields.
    #[serde(default)]
    pub tissue: TissueSpec,
    /// The needle and its motion.
    #[schemars(required)]
    pub needle: Option<NeedleTable>,
    /// The probe as a cylinder that tissue lies against. Without it the probe only looks.
    pub contact_probe: Option<ContactProbeSpec>,
    /// What is to be done: template, needles, seeds, targets.
    pub plan: Option<PlanSpec>,
    /// The text that it was read from, for errors that point into it.
    #[serde(skip)]
    pub(super) source: Option<Arc<Source>>,
    /// The adapter of `tissue.device = "gpu"`. Default: that of the environment, else the best.
    #[serde(skip)]
    pub adapter: Option<AdapterChoice>,
}

impl ScenarioFile {
    /// How long steps and frames may take: as stated, or by a scene that is written here.
    pub fn quality(&self) -> QualitySpec {
        let of_scene = match &self.scene {
            Some(SceneSource::Inline(scene)) => scene.quality,
            _ => None,
        };
        self.quality.or(of_scene).unwrap_or_default()
    }
}

/// Where a scene comes from.
#[derive(Clone, Debug, PartialEq, JsonSchema)]
#[schemars(untagged)]
pub enum SceneSource {
    /// The name of a scene that comes with the program (`insonify scene` lists them), or the path of a scene file.
    Named(String),
    /// The scene itself.
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

/// How long a scenario runs, and in what steps.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RunSpec {
    /// Time of a step, ms (0.01 to 100). Default 1, the rate at which a hand is given its force.
    pub dt_ms: Option<f64>,
    /// How long it runs, s (above 0, at most 1e7 steps). Default: to the end of the motions of needle and probe.
    pub duration_s: Option<f64>,
    /// Frames a second of simulated time (above 0, at most 1000). Default 25.
    pub frame_rate_hz: Option<f64>,
    /// Levels of remeshing that it changes to on its way (finite elements), ascending in time.
    pub change: Vec<ChangeSpec>,
}

/// Another level of remeshing from a time on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ChangeSpec {
    /// When, s, in the time of the motions and within the run: before the step that reaches it.
    pub at_s: f64,
    /// The level from then on. One that needs the first dense inverse of the run computes it then, unless `tissue.columns` is `dense`.
    pub level: LevelName,
}
