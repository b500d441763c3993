//! Paths of probe and needle in a scene, evaluated over time.

use std::path::Path;

use nalgebra::{Matrix4, Point3, Vector3};

use super::At;
use super::file::SceneFile;
use super::paths::{MotionSpec, NeedleFrame, NeedleKeyframe, NeedleMotionSpec, NeedleTable};
use super::recording::{Recording, left_out};
use insonify_base::document::{InputError, InvalidFile};
use insonify_base::matrix::Rows;
use insonify_base::note::Notes;
use insonify_tracking::TrackingError;
use insonify_tracking::needle::{DEFAULT_DIAMETER_MM, DEFAULT_LENGTH_MM, NeedlePath, NeedlePose};
use insonify_tracking::plus::PlusConfig;
use insonify_tracking::pose::Pose;
use insonify_tracking::sequence::ends;
use insonify_tracking::trajectory::{Interpolation, ParameterColumn, Trajectory};
use insonify_tracking::world::World;

/// A probe path, whether its poses are frames of their own, as in a recording, and its tracked sequence.
#[derive(Clone, Debug)]
pub(super) struct ProbePath {
    pub trajectory: Trajectory,
    pub recorded: bool,
    pub recording: Option<Recording>,
    /// Columns of parameters beside the poses.
    pub columns: Vec<ParameterColumn>,
}

/// A needle at rest or moving.
#[derive(Clone, Debug)]
pub(super) enum Needle {
    Still(NeedlePose),
    Moving { path: NeedlePath, recorded: bool },
}

impl SceneFile {
    /// Path of the probe, if the scene has one.
    pub(super) fn probe_path(
        &self,
        base: &Path,
        plus: Option<&PlusConfig>,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Option<ProbePath>, InputError> {
        let Some(motion) = &self.motion else { return Ok(None) };
        let MotionSpec {
            keyframes,
            csv,
            sequence,
            ..
        } = motion;
        let interpolation = motion.interpolation.unwrap_or_default();
        let world = motion.world.unwrap_or_default();
        let keyframed = match (keyframes, csv, sequence) {
            // A pose at rest states its own `world`, for which this one could be mistaken.
            (None, None, None) if motion.world.is_some() => {
                let found = "`world` without a path";
                return Err(self.wrong_keys("motion.world", found, "`keyframes`, `csv` or `sequence` beside it"));
            }
            (None, None, None) => return Ok(None),
            (Some(keyframes), None, None) => Trajectory::from_keyframes(keyframes, world, interpolation)
                .map_err(|error| self.fault(keyframe_key("motion", &error), error))?,
            (None, Some(csv), None) => {
                let known = |name: &str| self.parameter(name).map(drop);
                let table = Trajectory::from_csv_with(&base.join(csv), world, interpolation, &known);
                let (trajectory, columns) = table.at(self, "motion.csv")?;
                return Ok(Some(ProbePath {
                    trajectory,
                    recorded: true,
                    recording: None,
                    columns,
                }));
            }
            (None, None, Some(spec)) => {
                let (frames, recording) = self.recording(spec, base, plus, notes, warnings)?;
                let to_world = world.transform(spec.tracker_to_world.map_or_else(Matrix4::identity, |rows| rows.0));
                let trajectory =
                    Trajectory::from_tracked(&frames, &recording.array_to_marker, &to_world, interpolation)
                        .map_err(|error| self.tracked("motion.sequence", &recording.transform, error))?;
                warnings.extend(left_out("motion.sequence", &trajectory, frames.len()));
                return Ok(Some(ProbePath {
                    trajectory,
                    recorded: true,
                    recording: Some(recording),
                    columns: Vec::new(),
                }));
            }
            _ => {
                let found = "more than one of `keyframes`, `csv` and `sequence`";
                return Err(self.wrong_keys("motion", found, "one of them"));
            }
        };
        Ok(Some(ProbePath {
            trajectory: keyframed,
            recorded: false,
            recording: None,
            columns: Vec::new(),
        }))
    }

    /// Needle of the scene, if it has one.
    pub(super) fn needle(
        &self,
        base: &Path,
        plus: Option<&PlusConfig>,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Option<Needle>, InputError> {
        let Some(table) = &self.needle else { return Ok(None) };
        let in_probe = table.frame == Some(NeedleFrame::Probe);
        if in_probe && table.world.is_some() {
            let found = "`world` of a needle in the frame of the probe";
            return Err(self.wrong_keys("needle.world", found, "one of `world` and `frame = \"probe\"`"));
        }
        if in_probe && table.bending.is_some() {
            let found = "`bending`, whose entry lies in the world, of a needle in the frame of the probe";
            return Err(self.wrong_keys("needle.bending", found, "`frame = \"world\"`"));
        }
        let of_probe = self
            .motion
            .as_ref()
            .and_then(|motion| motion.world)
            .filter(|_| !in_probe);
        // LPS is the default, so that only RAS is a reading that the needle's table does not show.
        if table.world.is_none() && of_probe == Some(World::Ras) {
            let note = "the needle is read as RAS, as [motion] states; `world` under [needle] states its own axes";
            notes.push(note.to_owned());
        }
        let table = &NeedleTable {
            world: table.world.or(of_probe),
            ..table.clone()
        };
        let Some(motion) = &table.motion else {
            if table.bending.is_some() {
                let expected = "`needle.motion`: only a needle that moves bends";
                return Err(self.wrong_keys("needle.bending", "`bending` of a needle at rest", expected));
            }
            let pose = table.pose().pose();
            return pose
                .map(|pose| Some(Needle::Still(pose)))
                .map_err(|error| self.fault(needle_key(&error), error));
        };
        if table.tip_mm.is_some() || table.entry_mm.is_some() || table.direction.is_some() || table.nodes_mm.is_some() {
            let found = "both `motion` and where the needle lies";
            return Err(self.wrong_keys("needle", found, "one of them (`length_mm` and `diameter_mm` suit both)"));
        }
        let world = table.world.unwrap_or_default();
        let (tip, recorded) = self.needle_tip(motion, world, (base, plus), notes, warnings)?;
        let path = self.needle_path(table, tip)?;
        Ok(Some(Needle::Moving { path, recorded }))
    }

    /// The needle in the world, of one that is stated in the frame of the probe.
    pub(super) fn in_world(&self, needle: Option<Needle>, probe: &Trajectory) -> Result<Option<Needle>, InputError> {
        let frame = self.needle.as_ref().and_then(|table| table.frame);
        let Some(needle) = needle else { return Ok(None) };
        if frame != Some(NeedleFrame::Probe) {
            return Ok(Some(needle));
        }
        let fault = |error: TrackingError| self.fault("needle.frame", error);
        Ok(Some(match needle {
            Needle::Moving { path, recorded } => Needle::Moving {
                path: path.with_tip(path.tip().carried(probe).map_err(fault)?),
                recorded,
            },
            Needle::Still(pose) if probe.keys().len() == 1 => {
                Needle::Still(pose.transformed(probe.at(probe.start_s()).probe_to_world()))
            }
            Needle::Still(pose) if pose.nodes_mm().len() > 2 => {
                let found = "a bent needle in the frame of a probe that moves";
                return Err(self.wrong_keys("needle.frame", found, "a straight needle (`tip_mm` and `direction`)"));
            }
            Needle::Still(pose) => {
                let tip = Pose::from_direction(pose.tip_mm(), pose.direction().into_inner(), None).map_err(fault)?;
                let tip = Trajectory::fixed(tip).carried(probe).map_err(fault)?;
                let path = NeedlePath::new(tip, pose.length_mm(), pose.diameter_mm()).map_err(fault)?;
                Needle::Moving { path, recorded: false }
            }
        }))
    }

    fn needle_path(&self, table: &NeedleTable, tip: Trajectory) -> Result<NeedlePath, InputError> {
        let length = table.length_mm.unwrap_or(DEFAULT_LENGTH_MM);
        let diameter = table.diameter_mm.unwrap_or(DEFAULT_DIAMETER_MM);
        let path = NeedlePath::new(tip, length, diameter).map_err(|error| self.fault(needle_key(&error), error))?;
        let Some(bending) = &table.bending else { return Ok(path) };
        let world = table.world.unwrap_or_default();
        path.constrained(
            bending.constraint(),
            Point3::from(world.vector(bending.entry_mm)),
            Vector3::from(world.vector(bending.entry_direction)),
        )
        .map_err(|error| self.fault(needle_key(&error).replace("needle.", "needle.bending."), error))
    }

    fn needle_tip(
        &self,
        motion: &NeedleMotionSpec,
        world: World,
        (base, plus): (&Path, Option<&PlusConfig>),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<(Trajectory, bool), InputError> {
        let interpolation = motion.interpolation.unwrap_or_default();
        match (&motion.keyframes, &motion.csv, &motion.sequence) {
            (Some(keyframes), None, None) => {
                let key = |key: &NeedleKeyframe| {
                    let [tip, direction] = [key.tip_mm, key.direction].map(|stated| world.vector(stated));
                    (key.time_s, Point3::from(tip), Vector3::from(direction))
                };
                let keys: Vec<_> = keyframes.iter().map(key).collect();
                let tip = NeedlePath::tip_trajectory(&keys, interpolation)
                    .map_err(|error| self.fault(keyframe_key("needle.motion", &error), error))?;
                Ok((self.rolled(tip, keyframes, interpolation)?, false))
            }
            (None, Some(csv), None) => {
                let tip = Trajectory::from_csv(&base.join(csv), world, interpolation).at(self, "needle.motion.csv")?;
                Ok((tip, true))
            }
            (None, None, Some(spec)) => {
                let key = "needle.motion.sequence";
                let configuration = spec
                    .plus_config
                    .as_ref()
                    .map(|config| PlusConfig::read(&base.join(config)));
                let configuration = configuration
                    .transpose()
                    .at(self, "needle.motion.sequence.plus_config")?;
                let transform = spec.transform.as_deref().unwrap_or("NeedleToTracker");
                // One tracker often records both tools: the configuration of the probe applies unless the
                // needle has its own.
                let from = (spec.file.as_deref(), transform, configuration.as_ref().or(plus));
                let (frames, path) = self.frames(key, from, base, notes)?;
                warnings.extend(path.warnings);
                let matrix = |rows: Option<Rows>| rows.map_or_else(Matrix4::identity, |rows| rows.0);
                let axis = Vector3::from(spec.shaft_axis.unwrap_or([0.0, 0.0, 1.0]));
                let to_marker = matrix(spec.tip_to_marker);
                let tracker_to_world = match spec.tracker_to_world {
                    None => self.tracker_of_probe(transform, world, notes),
                    stated => stated,
                };
                let to_world = world.transform(matrix(tracker_to_world));
                let tip = NeedlePath::tip_from_tracked(&frames, &to_marker, axis, &to_world, interpolation)
                    .map_err(|error| self.tracked(key, transform, error))?;
                warnings.extend(left_out(key, &tip, frames.len()));
                Ok((tip, true))
            }
            (None, None, None) => {
                let found = "none of `keyframes`, `csv` and `sequence`";
                Err(self.wrong_keys("needle.motion", found, "one of them"))
            }
            _ => {
                let found = "more than one of `keyframes`, `csv` and `sequence`";
                Err(self.wrong_keys("needle.motion", found, "one of them"))
            }
        }
    }

    /// The `tracker_to_world` of the probe's sequence, for a needle in the world whose `transform` leads where that of
    /// the probe does, in the same axes.
    fn tracker_of_probe(&self, transform: &str, world: World, notes: &mut Notes) -> Option<Rows> {
        const KEY: &str = "needle.motion.sequence: `tracker_to_world`";
        let motion = self.motion.as_ref()?;
        let sequence = motion.sequence.as_ref()?;
        let to_world = sequence.tracker_to_world?;
        if self.needle.as_ref()?.frame == Some(NeedleFrame::Probe) {
            return None;
        }
        let target = |transform| ends(transform).map(|(_, to)| to);
        let of_probe = sequence.transform();
        if target(transform) == target(of_probe) && world == motion.world.unwrap_or_default() {
            notes.push(format!("{KEY} is that of [motion.sequence]"));
            return Some(to_world);
        }
        notes.push(format!(
            "{KEY} is not that of [motion.sequence], as `{transform}` leads to another frame or other axes than `{of_probe}`"
        ));
        None
    }

    /// Error of a path from the recorded poses of a transform.
    fn tracked(&self, table: &str, transform: &str, error: TrackingError) -> InputError {
        let key = tracked_key(table, &error);
        match error {
            TrackingError::NoValidPose { .. } => {
                self.fault(key, InvalidFile::Unknown(format!("`{transform}`: {error}")))
            }
            error => self.fault(key, error),
        }
    }

    /// Applies the roll of keyframes about the shaft to a path.
    fn rolled(
        &self,
        tip: Trajectory,
        keyframes: &[NeedleKeyframe],
        interpolation: Interpolation,
    ) -> Result<Trajectory, InputError> {
        let mut keys = Vec::with_capacity(keyframes.len());
        for (index, (key, keyframe)) in tip.keys().iter().zip(keyframes).enumerate() {
            let roll = keyframe.roll_deg.unwrap_or(0.0);
            if !roll.is_finite() {
                let key = format!("needle.motion.keyframes[{index}].roll_deg");
                let (found, expected) = (roll, "a finite number of degrees");
                return Err(self.fault(key, InvalidFile::number(found, expected)));
            }
            keys.push((key.time_s, key.pose.turned(roll.to_radians(), 0.0, 0.0)));
        }
        Trajectory::from_keys(keys, interpolation)
            .map_err(|error| self.fault(keyframe_key("needle.motion", &error), error))
    }
}

/// Key concerned by an error about keyframes.
fn keyframe_key(table: &str, error: &TrackingError) -> String {
    match error {
        TrackingError::Keyframe { index, key, .. } => match key {
            Some("position_mm") if table.starts_with("needle") => format!("{table}.keyframes[{index}].tip_mm"),
            Some(key) => format!("{table}.keyframes[{index}].{key}"),
            None => format!("{table}.keyframes[{index}]"),
        },
        _ => format!("{table}.keyframes"),
    }
}

/// Key concerned by an error about a tracked path.
fn tracked_key(table: &str, error: &TrackingError) -> String {
    let key = match error {
        TrackingError::Transform { which, .. } if *which == "tracker-to-world" => "tracker_to_world",
        TrackingError::Transform { .. } if table.starts_with("needle") => "tip_to_marker",
        TrackingError::Transform { .. } => "transducer_to_probe",
        TrackingError::Keyframe { .. } => "shaft_axis",
        TrackingError::NoValidPose { .. } => "transform",
        _ => "file",
    };
    format!("{table}.{key}")
}

fn needle_key(error: &TrackingError) -> String {
    error
        .key()
        .map_or_else(|| "needle".to_owned(), |key| format!("needle.{key}"))
}
