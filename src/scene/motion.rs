//! From the paths that a scene names to where probe and needle are at a time.

use std::path::Path;

use nalgebra::{Matrix4, Point3, Vector3};

use super::error::{At, Problem, SceneError};
use super::file::SceneFile;
use super::paths::{MotionSpec, NeedleKeyframe, NeedleMotionSpec, NeedleSequenceSpec, NeedleTable, SequenceSpec};
use crate::tracking::calibration::{PlusCalibration, transducer_to_probe};
use crate::tracking::needle::{DEFAULT_DIAMETER_MM, DEFAULT_LENGTH_MM, NeedlePath, NeedlePose};
use crate::tracking::sequence::{Sequence, ends};
use crate::tracking::trajectory::{Interpolation, TrackedFrame, Trajectory, TrajectoryError};

/// A path, and whether its poses are frames of their own, as those of a recording are.
#[derive(Clone, Debug)]
pub(super) struct ProbePath {
    pub trajectory: Trajectory,
    pub recorded: bool,
}

/// A needle that lies or moves.
#[derive(Clone, Debug)]
pub(super) enum Needle {
    Still(NeedlePose),
    Moving { path: NeedlePath, recorded: bool },
}

impl SceneFile {
    /// The path of the probe, if the scene names one.
    pub(super) fn probe_path(&self, base: &Path, warnings: &mut Vec<String>) -> Result<Option<ProbePath>, SceneError> {
        let Some(motion) = &self.motion else { return Ok(None) };
        let MotionSpec {
            keyframes,
            csv,
            sequence,
            ..
        } = motion;
        let interpolation = motion.interpolation.unwrap_or_default();
        let keyframed = match (keyframes, csv, sequence) {
            (None, None, None) => return Ok(None),
            (Some(keyframes), None, None) => Trajectory::from_keyframes(keyframes, interpolation)
                .map_err(|error| self.fault(keyframe_key("motion", &error), error))?,
            (None, Some(csv), None) => {
                let trajectory = Trajectory::from_csv(&base.join(csv), interpolation).at(self, "motion.csv")?;
                return Ok(Some(ProbePath {
                    trajectory,
                    recorded: true,
                }));
            }
            (None, None, Some(spec)) => {
                let (frames, path) =
                    self.frames("motion.sequence", spec.file.as_deref(), probe_transform(spec), base)?;
                warnings.extend(path.warnings);
                let to_marker = self.array_to_marker(spec, base)?;
                let to_world = spec.tracker_to_world.map_or_else(Matrix4::identity, |rows| rows.0);
                let trajectory = Trajectory::from_tracked(&frames, &to_marker, &to_world, interpolation)
                    .map_err(|error| self.fault(tracked_key("motion.sequence", &error), error))?;
                warnings.extend(left_out("motion.sequence", &trajectory, frames.len()));
                return Ok(Some(ProbePath {
                    trajectory,
                    recorded: true,
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
        }))
    }

    /// The needle, if the scene names one.
    pub(super) fn needle(&self, base: &Path, warnings: &mut Vec<String>) -> Result<Option<Needle>, SceneError> {
        let Some(table) = &self.needle else { return Ok(None) };
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
        let (tip, recorded) = self.needle_tip(motion, base, warnings)?;
        let path = self.needle_path(table, tip)?;
        Ok(Some(Needle::Moving { path, recorded }))
    }

    fn needle_path(&self, table: &NeedleTable, tip: Trajectory) -> Result<NeedlePath, SceneError> {
        let length = table.length_mm.unwrap_or(DEFAULT_LENGTH_MM);
        let diameter = table.diameter_mm.unwrap_or(DEFAULT_DIAMETER_MM);
        let path = NeedlePath::new(tip, length, diameter).map_err(|error| self.fault(needle_key(&error), error))?;
        let Some(bending) = &table.bending else { return Ok(path) };
        path.constrained(
            bending.constraint(),
            Point3::from(bending.entry_mm),
            Vector3::from(bending.entry_direction),
        )
        .map_err(|error| self.fault(needle_key(&error).replace("needle.", "needle.bending."), error))
    }

    fn needle_tip(
        &self,
        motion: &NeedleMotionSpec,
        base: &Path,
        warnings: &mut Vec<String>,
    ) -> Result<(Trajectory, bool), SceneError> {
        let interpolation = motion.interpolation.unwrap_or_default();
        match (&motion.keyframes, &motion.csv, &motion.sequence) {
            (Some(keyframes), None, None) => {
                let keys: Vec<_> = keyframes
                    .iter()
                    .map(|key| (key.time_s, Point3::from(key.tip_mm), Vector3::from(key.direction)))
                    .collect();
                let tip = NeedlePath::tip_trajectory(&keys, interpolation)
                    .map_err(|error| self.fault(keyframe_key("needle.motion", &error), error))?;
                Ok((self.rolled(tip, keyframes, interpolation)?, false))
            }
            (None, Some(csv), None) => {
                let tip = Trajectory::from_csv(&base.join(csv), interpolation).at(self, "needle.motion.csv")?;
                Ok((tip, true))
            }
            (None, None, Some(spec)) => {
                let key = "needle.motion.sequence";
                let (frames, path) = self.frames(key, spec.file.as_deref(), needle_transform(spec), base)?;
                warnings.extend(path.warnings);
                let matrix =
                    |rows: Option<crate::tracking::matrix::Rows>| rows.map_or_else(Matrix4::identity, |rows| rows.0);
                let axis = Vector3::from(spec.shaft_axis.unwrap_or([0.0, 0.0, 1.0]));
                let (to_marker, to_world) = (matrix(spec.tip_to_marker), matrix(spec.tracker_to_world));
                let tip = NeedlePath::tip_from_tracked(&frames, &to_marker, axis, &to_world, interpolation)
                    .map_err(|error| self.fault(tracked_key(key, &error), error))?;
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

    /// The path with the needle turned about its shaft.
    fn rolled(
        &self,
        tip: Trajectory,
        keyframes: &[NeedleKeyframe],
        interpolation: Interpolation,
    ) -> Result<Trajectory, SceneError> {
        let mut keys = Vec::with_capacity(keyframes.len());
        for (at, (key, of)) in tip.keys().iter().zip(keyframes).enumerate() {
            let roll = of.roll_deg.unwrap_or(0.0);
            if !roll.is_finite() {
                let key = format!("needle.motion.keyframes[{at}].roll_deg");
                let (found, expected) = (roll, "a finite number of degrees");
                return Err(self.fault(key, Problem::Number { found, expected }));
            }
            keys.push((key.time_s, key.pose.turned(roll.to_radians(), 0.0, 0.0)));
        }
        Trajectory::from_keys(keys, interpolation)
            .map_err(|error| self.fault(keyframe_key("needle.motion", &error), error))
    }

    /// What a sequence recorded of one transform.
    fn frames(
        &self,
        key: &str,
        file: Option<&Path>,
        transform: &str,
        base: &Path,
    ) -> Result<(Vec<TrackedFrame>, Sequence), SceneError> {
        let Some(file) = file else {
            return Err(self.wrong_keys(key, "no `file`", "the path of a tracked sequence"));
        };
        let path = base.join(file);
        let sequence = Sequence::read_poses(&path).at(self, &format!("{key}.file"))?;
        let Some((from, to)) = ends(transform) else {
            let (found, expected) = (transform.to_owned(), "a transform such as `ProbeToTracker`".to_owned());
            return Err(self.fault(format!("{key}.transform"), Problem::Name { found, expected }));
        };
        let named = |frame: &crate::tracking::sequence::SequenceFrame| frame.transforms.contains_key(transform);
        let frames: Vec<TrackedFrame> = (0..sequence.frames.len())
            .map(|at| TrackedFrame {
                time_s: sequence.frames[at].timestamp,
                tool_to_tracker: match sequence.frames[at].transforms.get(transform) {
                    Some(recorded) => recorded.valid.then_some(recorded.matrix),
                    None => sequence.transform(at, from, to),
                },
            })
            .collect();
        let connected = frames.iter().any(|frame| frame.tool_to_tracker.is_some());
        if connected || sequence.frames.iter().any(named) {
            return Ok((frames, sequence));
        }
        let names: std::collections::BTreeSet<&str> = sequence
            .frames
            .iter()
            .flat_map(|frame| frame.transforms.keys().map(String::as_str))
            .collect();
        let has = if names.is_empty() {
            "no transforms".to_owned()
        } else {
            names.into_iter().collect::<Vec<_>>().join(", ")
        };
        let transform = transform.to_owned();
        Err(self.fault(
            format!("{key}.transform"),
            Problem::NoTransform { path, transform, has },
        ))
    }

    /// The transform from the centre of the array to the marker on the probe.
    fn array_to_marker(&self, spec: &SequenceSpec, base: &Path) -> Result<Matrix4<f64>, SceneError> {
        const KEY: &str = "motion.sequence";
        let ways = [
            spec.transducer_to_probe.is_some(),
            spec.image_to_probe.is_some(),
            spec.plus_config.is_some(),
        ];
        if ways.iter().filter(|given| **given).count() > 1 {
            let found = "more than one of `transducer_to_probe`, `image_to_probe` and `plus_config`";
            return Err(self.wrong_keys(KEY, found, "at most one calibration"));
        }
        if let Some(config) = &spec.plus_config {
            let key = "motion.sequence.plus_config";
            let plus = PlusCalibration::read(&base.join(config)).at(self, key)?;
            let marker = ends(probe_transform(spec)).map_or("Probe", |(from, _)| from);
            let image_to_probe = plus.transform("Image", marker).at(self, key)?;
            let Some(centre) = spec.array_centre_px.or_else(|| plus.array_centre_px()) else {
                let found = format!("no `TransducerCenterPixel` in {}", base.join(config).display());
                return Err(self.wrong_keys(key, found, "`array_centre_px` beside it"));
            };
            return transducer_to_probe(&image_to_probe, centre).at(self, key);
        }
        match (&spec.image_to_probe, spec.array_centre_px) {
            (Some(image), Some(centre)) => {
                transducer_to_probe(&image.0, centre).at(self, "motion.sequence.image_to_probe")
            }
            (Some(_), None) => Err(self.wrong_keys(
                "motion.sequence.image_to_probe",
                "`image_to_probe` without `array_centre_px`",
                "the pixel (column, row) at the centre of the array",
            )),
            (None, Some(_)) => Err(self.wrong_keys(
                "motion.sequence.array_centre_px",
                "`array_centre_px` without `image_to_probe` or `plus_config`",
                "the calibration that it belongs to",
            )),
            (None, None) => Ok(spec.transducer_to_probe.map_or_else(Matrix4::identity, |rows| rows.0)),
        }
    }
}

fn probe_transform(spec: &SequenceSpec) -> &str {
    spec.transform.as_deref().unwrap_or("ProbeToTracker")
}

fn needle_transform(spec: &NeedleSequenceSpec) -> &str {
    spec.transform.as_deref().unwrap_or("NeedleToTracker")
}

/// The key that an error about keyframes is about.
fn keyframe_key(table: &str, error: &TrajectoryError) -> String {
    match error {
        TrajectoryError::Time { index, .. } | TrajectoryError::Order { index, .. } => {
            format!("{table}.keyframes[{index}].time_s")
        }
        TrajectoryError::Pose { index, source } => match source.key() {
            Some("position_mm") if table.starts_with("needle") => format!("{table}.keyframes[{index}].tip_mm"),
            Some(key) => format!("{table}.keyframes[{index}].{key}"),
            None => format!("{table}.keyframes[{index}]"),
        },
        _ => format!("{table}.keyframes"),
    }
}

/// The key that an error about a tracked path is about.
fn tracked_key(table: &str, error: &TrajectoryError) -> String {
    let key = match error {
        TrajectoryError::Transform { which, .. } if *which == "tracker-to-world" => "tracker_to_world",
        TrajectoryError::Transform { .. } if table.starts_with("needle") => "tip_to_marker",
        TrajectoryError::Transform { .. } => "transducer_to_probe",
        TrajectoryError::Pose { .. } => "shaft_axis",
        _ => "file",
    };
    format!("{table}.{key}")
}

fn needle_key(error: &crate::tracking::needle::InvalidNeedle) -> String {
    error
        .key()
        .map_or_else(|| "needle".to_owned(), |key| format!("needle.{key}"))
}

/// What is said of frames of a recording that make no pose, or the same pose again.
fn left_out(key: &str, path: &Trajectory, frames: usize) -> Vec<String> {
    let mut said = Vec::new();
    if let Some(first) = path.skipped().first() {
        said.push(format!(
            "{key}: {} of {frames} frames skipped; frame {}: {}",
            path.skipped().len(),
            first.frame,
            first.reason
        ));
    }
    if path.repeated() > 0 {
        said.push(format!(
            "{key}: {} of {frames} frames repeat the pose before them (a tool at rest, or a tracker that stalled)",
            path.repeated()
        ));
    }
    said
}
