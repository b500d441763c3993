//! `[manipulator]` of a scenario: a needle guide mounted on the probe, its drive, and its force sensor.

use std::path::Path;
use std::sync::Arc;

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::Deserialize;

use super::file::ScenarioFile;
use super::resolve::Scenario;
use insonify_base::document::InputError;
use insonify_base::random::{normal, seed_words};
use insonify_base::range::parameters;
use insonify_imaging::scene::{NeedleKeyframe, Scene};
use insonify_mechanics::insertion::Wrench;
use insonify_tracking::TrackingError;
use insonify_tracking::manipulator::drive::{Control, Drive, Driven, PERIOD_S, follow};
use insonify_tracking::manipulator::{Guide, InPlane, Posture};
use insonify_tracking::needle::NeedlePath;
use insonify_tracking::pose::Pose;
use insonify_tracking::trajectory::{Interpolation, Trajectory};

/// Longest motion of a guide, s.
const LONGEST_S: f64 = 1000.0;
/// Maximum number of poses of the needle's path.
const MAX_POSES: usize = 100_000;

/// Needle guide of three degrees of freedom mounted on the probe (Kobayashi et al. 2010, section 2): it holds the
/// needle in the image plane and makes its motion, whatever states it, within its ranges and the errors of its drive.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ManipulatorSpec {
    /// Dimensions.
    pub guide: Guide,
    /// Flexible racks, ball screws and controllers of the three slides.
    pub drive: Drive,
    /// Control of the slides. Default `closed-loop`.
    pub control: Control,
    /// Force sensor at the base of the needle.
    pub sensor: SensorSpec,
    /// Motion in the degrees of freedom, in place of `needle.motion`, `needle.target` and `plan.needle`; linear between
    /// the times.
    pub keyframes: Vec<PostureKey>,
}

/// Timed posture of the guide.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PostureKey {
    /// Time, s; later than that of the previous keyframe.
    pub time_s: f64,
    /// Horizontal positioning (A), mm from the middle of its range (-20 to 20).
    pub position_mm: f64,
    /// Posture (B), degrees from the middle of its range (-30 to 30), positive towards the marked side.
    pub posture_deg: f64,
    /// Insertion (C), mm from the withdrawn needle (0 to 60).
    pub insertion_mm: f64,
}

impl PostureKey {
    fn posture(&self) -> Posture {
        Posture {
            position_mm: self.position_mm,
            posture_deg: self.posture_deg,
            insertion_mm: self.insertion_mm,
        }
    }
}

parameters! {
    /// Six-axis force sensor: the force and torque on the base of the needle, with white noise.
    #[derive(Copy)]
    pub struct SensorSpec {
        /// Standard deviation of each component of the force in a step.
        noise_n: f64 = 0.02, in 0..=100 "N";
        /// Standard deviation of each component of the torque in a step.
        noise_nmm: f64 = 0.5, in 0..=1e4 "N mm";
        /// Seed of the noise. Default 0.
        seed: u64;
    }
}

impl SensorSpec {
    /// Reading of force (N) and torque (N mm) in a step.
    pub fn reading(&self, step: u64, wrench: &Wrench) -> [Vector3<f64>; 2] {
        let [low, high] = [step as i32, (step >> 32) as i32];
        let noise = |row: i32, size: f64| {
            Vector3::from_fn(|axis, _| size * normal([low, high, 3 * row + axis as i32], seed_words(self.seed)))
        };
        [
            wrench.force_n + noise(0, self.noise_n),
            wrench.torque_nmm + noise(1, self.noise_nmm),
        ]
    }
}

/// Motion of a guide: commands and what became of them, every millisecond.
#[derive(Clone, Debug, PartialEq)]
pub struct GuideMotion {
    /// Dimensions.
    pub guide: Guide,
    /// Force sensor.
    pub sensor: SensorSpec,
    /// Drive of the slides.
    pub drive: Drive,
    /// Periods of the controller, in order.
    pub driven: Vec<Driven>,
}

impl GuideMotion {
    /// Period of the controller at a time, s; the first or last one beyond the ends.
    pub fn at(&self, time_s: f64) -> &Driven {
        let since = (time_s - self.driven[0].time_s) / PERIOD_S;
        &self.driven[(since.round().max(0.0) as usize).min(self.driven.len() - 1)]
    }

    /// Path of the tip in the world, for the path of the probe.
    ///
    /// # Errors
    /// [`TrackingError`] for poses beyond the range of positions.
    pub(crate) fn tip(&self, probe: &Trajectory) -> Result<Trajectory, TrackingError> {
        let every = self.driven.len().div_ceil(MAX_POSES);
        let last_index = self.driven.len() - 1;
        let shown = self
            .driven
            .iter()
            .enumerate()
            .filter(|(index, _)| index % every == 0 || *index == last_index);
        let poses: Result<Vec<(f64, Pose)>, TrackingError> = shown
            .map(|(_, driven)| Ok((driven.time_s, self.guide.needle(&driven.posture).pose()?)))
            .collect();
        Trajectory::from_keys(poses?, Interpolation::Linear)?.carried(probe)
    }

    /// Distance of the tip from where it is commanded to be, mm.
    pub fn off_mm(&self, driven: &Driven) -> f64 {
        let [a, b] = [driven.command, driven.posture].map(|posture| self.guide.needle(&posture).tip_mm);
        (a[0] - b[0]).hypot(a[1] - b[1])
    }
}

impl Scenario {
    /// The scenario with another path of the needle's tip, from its start to its end, as the guide on the probe makes
    /// it if there is one.
    ///
    /// # Errors
    /// [`InputError`] for a path beyond the ranges of the guide.
    pub fn commanded(&self, tip: Trajectory) -> Result<Self, InputError> {
        let (file, probe) = (&self.file, self.scene.probe_path());
        let spec = file.manipulator.as_ref();
        let guided = spec.map(|spec| file.along(spec, &tip, probe)).transpose()?;
        let mut commanded = self.moved(tip, None);
        commanded.path = file.through_guide(commanded.path, guided.as_ref(), probe)?;
        commanded.manipulator = guided.map(Arc::new);
        Ok(commanded)
    }
}

impl ScenarioFile {
    /// The scene, and the motion of the guide or why it cannot make that of the needle, without tissue and mesh.
    ///
    /// # Errors
    /// [`InputError`] with the key; also if the scenario has no `[manipulator]`.
    pub fn resolve_guided(&self, base_dir: &Path) -> Result<(Scene, Result<GuideMotion, InputError>), InputError> {
        let needle = self.needle_settings()?;
        self.motion_key()?;
        self.guide()?;
        let (scene, ..) = self.scene_with(&needle, base_dir)?;
        let path = scene.needle_path().map(|path| path.tip());
        let guided = path.map_or(Ok(None), |path| self.guided(path, scene.probe_path()));
        let still = || self.wrong_keys("needle", "a needle that does not move", "one that does");
        let guided = guided.and_then(|guided| guided.ok_or_else(still));
        Ok((scene, guided))
    }

    /// Checked dimensions of the guide.
    ///
    /// # Errors
    /// [`InputError`] with the key; also if the scenario has no `[manipulator]`.
    pub fn guide(&self) -> Result<Guide, InputError> {
        let spec = self.manipulator.as_ref();
        let spec = spec
            .ok_or_else(|| self.wrong_keys("manipulator", "no `[manipulator]`", "the guide that moves the needle"))?;
        self.check_guide(spec)?;
        Ok(spec.guide)
    }

    /// Times of the keyframes of the guide, if it has any.
    pub fn guide_times(&self) -> Option<Vec<f64>> {
        let spec = self.manipulator.as_ref().filter(|spec| !spec.keyframes.is_empty())?;
        Some(spec.keyframes.iter().map(|key| key.time_s).collect())
    }

    /// Motion of the guide for the planned paths of tip and probe in the world, if the scenario has one.
    pub(crate) fn guided(&self, tip: &Trajectory, probe: &Trajectory) -> Result<Option<GuideMotion>, InputError> {
        let Some(spec) = &self.manipulator else {
            return Ok(None);
        };
        self.check_guide(spec)?;
        let keys = &spec.keyframes;
        match (keys.first(), keys.last()) {
            (Some(first), Some(last)) => {
                self.driven(spec, [first.time_s, last.time_s], &|time_s| Ok(between(keys, time_s)))
            }
            _ => self.along(spec, tip, probe),
        }
        .map(Some)
    }

    /// Motion of the guide for a path of the tip in the world.
    fn along(&self, spec: &ManipulatorSpec, tip: &Trajectory, probe: &Trajectory) -> Result<GuideMotion, InputError> {
        self.driven(spec, [tip.start_s(), tip.end_s()], &|time_s| {
            let in_probe = probe.at(time_s).world_to_probe() * tip.at(time_s).probe_to_world();
            spec.guide.reaching(&InPlane::of(&Pose::from_matrix(&in_probe)?)?)
        })
    }

    /// Motion of the guide for postures over a span of time, s.
    fn driven(
        &self,
        spec: &ManipulatorSpec,
        span: [f64; 2],
        command: &dyn Fn(f64) -> Result<Posture, TrackingError>,
    ) -> Result<GuideMotion, InputError> {
        let motion_key = self.motion_key()?;
        if span[1] - span[0] > LONGEST_S {
            let found = format!("a motion of {} s", span[1] - span[0]);
            return Err(self.wrong_keys(
                motion_key,
                found,
                "at most 1000 s for a guide, which is controlled every millisecond",
            ));
        }
        let periods = ((span[1] - span[0]) / PERIOD_S).ceil() as usize;
        let commands: Result<Vec<Posture>, InputError> = (0..=periods)
            .map(|period| {
                // The last period ends after the motion, unless this is a whole number of them.
                let time = (span[0] + period as f64 * PERIOD_S).min(span[1]);
                command(time).map_err(|error| {
                    let text = format!("at {time:.3} s the guide would have to hold {error}");
                    self.fault(motion_key, TrackingError::new(text))
                })
            })
            .collect();
        let driven = follow(&spec.guide, &spec.drive, spec.control, span[0], &commands?);
        Ok(GuideMotion {
            guide: spec.guide,
            sensor: spec.sensor,
            drive: spec.drive,
            driven: driven.map_err(|error| self.fault("manipulator", error))?,
        })
    }

    /// The needle on the path that the guide makes of the planned one.
    pub(crate) fn through_guide(
        &self,
        path: NeedlePath,
        guided: Option<&GuideMotion>,
        probe: &Trajectory,
    ) -> Result<NeedlePath, InputError> {
        let Some(guided) = guided else { return Ok(path) };
        let tip = guided.tip(probe).map_err(|error| self.fault("manipulator", error))?;
        Ok(path.with_tip(tip))
    }

    fn check_guide(&self, spec: &ManipulatorSpec) -> Result<(), InputError> {
        for (table, checked) in [("guide", spec.guide.check()), ("drive", spec.drive.check())] {
            checked.map_err(|error| {
                self.fault(
                    format!("manipulator.{table}.{}", error.key().unwrap_or_default()),
                    error,
                )
            })?;
        }
        self.in_ranges("manipulator.sensor", &spec.sensor)?;
        for (index, key) in spec.keyframes.iter().enumerate() {
            let path = format!("manipulator.keyframes[{index}]");
            let after = index
                .checked_sub(1)
                .map_or(f64::NEG_INFINITY, |before| spec.keyframes[before].time_s);
            let range = |x: f64| x > after && x.abs() <= 1e9;
            self.number(
                format!("{path}.time_s"),
                key.time_s,
                range,
                "a time after that of the keyframe before",
            )?;
            let posture = key.posture().check();
            posture.map_err(|error| self.fault(format!("{path}.{}", error.key().unwrap_or_default()), error))?;
        }
        // The guide moves a needle in a plane and along itself, without a drive about its axis; a roll of 0
        // asks for none.
        let turns = |roll: Option<f64>| roll.is_some_and(|roll| roll != 0.0);
        let motion = self.needle.as_ref().and_then(|needle| needle.motion.as_ref());
        let mut rolls = motion
            .iter()
            .flat_map(|motion| motion.keyframes.iter().flatten())
            .map(|key| key.roll_deg);
        let planned = self
            .plan
            .iter()
            .flat_map(|plan| &plan.needle)
            .map(|needle| needle.roll_deg);
        if rolls.any(turns) || planned.into_iter().any(turns) {
            let found = "a needle that turns about its axis (`roll_deg`), which the guide does not";
            return Err(self.wrong_keys("manipulator", found, "no `roll_deg`"));
        }
        Ok(())
    }

    /// Motion of the tip in the frame of the probe by the keyframes of the guide, if there are any.
    pub(crate) fn guide_keyframes(&self) -> Result<Option<Vec<NeedleKeyframe>>, InputError> {
        let Some(spec) = self.manipulator.as_ref().filter(|spec| !spec.keyframes.is_empty()) else {
            return Ok(None);
        };
        self.check_guide(spec)?;
        let keyframe = |key: &PostureKey| {
            let needle = spec.guide.needle(&key.posture());
            let (sin, cos) = needle.angle_deg.to_radians().sin_cos();
            NeedleKeyframe {
                time_s: key.time_s,
                tip_mm: [needle.tip_mm[0], needle.tip_mm[1], 0.0],
                direction: [sin, cos, 0.0],
                roll_deg: None,
            }
        };
        Ok(Some(spec.keyframes.iter().map(keyframe).collect()))
    }
}

/// Posture at a time, linear between keyframes.
fn between(keys: &[PostureKey], time_s: f64) -> Posture {
    let after = keys.partition_point(|key| key.time_s <= time_s);
    let (Some(a), Some(b)) = (
        after.checked_sub(1).and_then(|before| keys.get(before)),
        keys.get(after),
    ) else {
        return keys[after.min(keys.len() - 1)].posture();
    };
    a.posture()
        .lerp(&b.posture(), (time_s - a.time_s) / (b.time_s - a.time_s))
}
