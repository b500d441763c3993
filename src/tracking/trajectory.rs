//! Poses over time: keyframes, CSV paths and tracked sequences.

mod csv_path;
mod tracked;

pub use csv_path::ParameterColumn;
pub use tracked::{SkipReason, Skipped, TrackedFrame};

use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::TrackingError;
use super::pose::{Pose, PoseSpec, pose_table};
use super::world::World;

/// Interpolation of positions between keyframes. Rotations follow the shortest arc at constant speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Straight lines between keyframes.
    #[default]
    Linear,
    /// A Catmull-Rom spline through every keyframe, with tangents that respect uneven times.
    CatmullRom,
}

/// A pose of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Time, s.
    pub time_s: f64,
    /// Pose at this time.
    pub pose: Pose,
    /// Index of the keyframe, CSV row or frame of the source, from 0.
    pub source: usize,
}

/// Poses in ascending order of time; at least one.
///
/// ```
/// use insonify_tracking::pose::Pose;
/// use insonify_tracking::trajectory::{Interpolation, Trajectory};
/// use nalgebra::{Point3, UnitQuaternion};
///
/// let at = |x| Pose::from_rotation(Point3::new(x, 0.0, 0.0), &UnitQuaternion::identity());
/// let sweep = Trajectory::from_keys([(0.0, at(0.0)?), (2.0, at(30.0)?)], Interpolation::Linear)?;
/// assert!((sweep.at(1.0).position_mm().x - 15.0).abs() < 1e-12);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    keys: Vec<Key>,
    interpolation: Interpolation,
    skipped: Vec<Skipped>,
    repeated: usize,
}

/// Time between the poses of a carried trajectory, s, and most of them.
const CARRIED_S: f64 = 1e-3;
const MAX_CARRIED: f64 = 1e5;

/// Largest time, s.
const LATEST_S: f64 = 1e9;

impl Trajectory {
    /// A trajectory with a constant pose.
    pub fn fixed(pose: Pose) -> Self {
        Self {
            keys: vec![Key {
                time_s: 0.0,
                pose,
                source: 0,
            }],
            interpolation: Interpolation::Linear,
            skipped: Vec::new(),
            repeated: 0,
        }
    }

    /// Creates a trajectory through poses at strictly increasing times, s.
    pub fn from_keys(
        keys: impl IntoIterator<Item = (f64, Pose)>,
        interpolation: Interpolation,
    ) -> Result<Self, TrackingError> {
        let mut checked: Vec<Key> = Vec::new();
        for (source, (time_s, pose)) in keys.into_iter().enumerate() {
            check_time(source, time_s, checked.last().map(|key| key.time_s))?;
            checked.push(Key { time_s, pose, source });
        }
        if checked.is_empty() {
            return Err(empty());
        }
        Ok(Self {
            keys: checked,
            interpolation,
            skipped: Vec::new(),
            repeated: 0,
        })
    }

    /// Creates a trajectory through the keyframes of a scene file, stated in the axes of `world`. A direction without
    /// `lateral` is reached by the smallest rotation from the previous keyframe.
    pub fn from_keyframes(
        keyframes: &[KeyframeSpec],
        world: World,
        interpolation: Interpolation,
    ) -> Result<Self, TrackingError> {
        let mut keys: Vec<(f64, Pose)> = Vec::with_capacity(keyframes.len());
        for (index, keyframe) in keyframes.iter().enumerate() {
            let pose = PoseSpec::from(keyframe)
                .in_lps(world)
                .pose(keys.last().map(|(_, pose)| pose))
                .map_err(|error| error.of_keyframe(index))?;
            keys.push((keyframe.time_s, pose));
        }
        Self::from_keys(keys, interpolation)
    }

    /// Poses in ascending order of time.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Time of the first pose, s.
    pub fn start_s(&self) -> f64 {
        self.keys[0].time_s
    }

    /// Time of the last pose, s.
    pub fn end_s(&self) -> f64 {
        self.keys[self.keys.len() - 1].time_s
    }

    /// Pose at a time, s; constant beyond the ends.
    pub fn at(&self, time_s: f64) -> Pose {
        let after = self.keys.partition_point(|key| key.time_s <= time_s);
        let Some(before) = after.checked_sub(1) else {
            return self.keys[0].pose;
        };
        let (Some(a), Some(b)) = (self.keys.get(before), self.keys.get(after)) else {
            return self.keys[self.keys.len() - 1].pose;
        };
        if time_s == a.time_s {
            return a.pose;
        }
        let share = (time_s - a.time_s) / (b.time_s - a.time_s);
        let position = match self.interpolation {
            Interpolation::Linear => a.pose.position_mm().coords.lerp(&b.pose.position_mm().coords, share),
            Interpolation::CatmullRom => self.spline(before, share),
        };
        let rotation = a.pose.rotation();
        let rotation = rotation.try_slerp(&b.pose.rotation(), share, 1e-12).unwrap_or(rotation);
        Pose::from_rotation(Point3::from(position), &rotation).unwrap_or(a.pose)
    }

    /// Cubic Hermite curve between keys `before` and `before + 1` whose tangents are the slopes between their
    /// neighbours.
    fn spline(&self, before: usize, share: f64) -> Vector3<f64> {
        let point = |key: usize| self.keys[key].pose.position_mm().coords;
        let slope = |key: usize| {
            let (low, high) = (key.saturating_sub(1), (key + 1).min(self.keys.len() - 1));
            (point(high) - point(low)) / (self.keys[high].time_s - self.keys[low].time_s)
        };
        let span = self.keys[before + 1].time_s - self.keys[before].time_s;
        let (s, s2, s3) = (share, share * share, share * share * share);
        point(before) * (2.0 * s3 - 3.0 * s2 + 1.0)
            + slope(before) * (span * (s3 - 2.0 * s2 + s))
            + point(before + 1) * (3.0 * s2 - 2.0 * s3)
            + slope(before + 1) * (span * (s3 - s2))
    }

    /// The trajectory of poses in a frame that moves itself: at each time the pose of `carrier` times this one. A
    /// carrier that moves is followed in steps of a millisecond, or in `MAX_CARRIED` steps if those are longer.
    ///
    /// # Errors
    /// [`TrackingError`] for poses beyond the range of positions.
    pub fn carried(&self, carrier: &Self) -> Result<Self, TrackingError> {
        let carried_key = |time_s: f64, pose: &Pose| {
            let matrix = carrier.at(time_s).probe_to_world() * pose.probe_to_world();
            Ok((time_s, Pose::from_matrix(&matrix)?))
        };
        if carrier.keys.len() == 1 {
            let keys: Result<Vec<_>, TrackingError> =
                self.keys.iter().map(|key| carried_key(key.time_s, &key.pose)).collect();
            return Self::from_keys(keys?, self.interpolation);
        }
        let (start, end) = (self.start_s().min(carrier.start_s()), self.end_s().max(carrier.end_s()));
        let steps = ((end - start) / CARRIED_S).ceil().clamp(1.0, MAX_CARRIED) as usize;
        let mut times: Vec<f64> = (0..=steps)
            .map(|step| start + (end - start) * step as f64 / steps as f64)
            .collect();
        times.extend(self.keys.iter().map(|key| key.time_s));
        times.sort_by(f64::total_cmp);
        times.dedup_by(|later, earlier| *later - *earlier < 1e-9);
        let keys: Result<Vec<_>, TrackingError> = times
            .into_iter()
            .map(|time| carried_key(time, &self.at(time)))
            .collect();
        Self::from_keys(keys?, Interpolation::Linear)
    }

    /// Skipped frames of a tracked sequence, with the reason for each.
    pub fn skipped(&self) -> &[Skipped] {
        &self.skipped
    }

    /// Number of frames of a tracked sequence whose pose equals the previous one bit for bit: a tool at rest, or a
    /// stalled tracker.
    pub fn repeated(&self) -> usize {
        self.repeated
    }
}

fn check_time(index: usize, time_s: f64, previous: Option<f64>) -> Result<(), TrackingError> {
    let wrong = |expected| {
        let text = format!("`time_s` is {time_s}; expected {expected}");
        Err(TrackingError::at("time_s", text).of_keyframe(index))
    };
    if !(-LATEST_S..=LATEST_S).contains(&time_s) {
        return wrong("a finite number of at most 1e9".to_owned());
    }
    match previous {
        Some(previous) if time_s <= previous => wrong(format!("more than {previous}, the time before it")),
        _ => Ok(()),
    }
}

fn empty() -> TrackingError {
    TrackingError::new("a trajectory without poses; expected at least one")
}

pose_table! {
    /// A timed pose as written in a file.
    pub struct KeyframeSpec {
        /// Time, s; later than that of the previous keyframe.
        time_s: f64;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    use super::*;

    fn at(position: [f64; 3], angle: f64) -> Pose {
        let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        Pose::from_rotation(position.into(), &rotation).expect("pose")
    }

    fn bent(interpolation: Interpolation) -> Trajectory {
        let keys = [
            (0.0, at([0.0, 0.0, 0.0], 0.0)),
            (1.0, at([10.0, 0.0, 0.0], 1.0)),
            (3.0, at([10.0, 20.0, 0.0], -1.0)),
            (3.5, at([0.0, 20.0, 5.0], 3.0)),
        ];
        Trajectory::from_keys(keys, interpolation).expect("trajectory")
    }

    #[test]
    fn keys_are_met_and_ends_are_held() {
        for interpolation in [Interpolation::Linear, Interpolation::CatmullRom] {
            let path = bent(interpolation);
            for key in path.keys() {
                let pose = path.at(key.time_s);
                assert!((pose.probe_to_world() - key.pose.probe_to_world()).amax() < 1e-12);
                let just_before = path.at(key.time_s - 1e-9);
                assert!((just_before.probe_to_world() - key.pose.probe_to_world()).amax() < 1e-6);
            }
            assert_eq!(path.at(-5.0), path.keys()[0].pose);
            assert_eq!(path.at(99.0), path.keys()[3].pose);
            assert_eq!(path.at(f64::NAN), path.keys()[0].pose);
        }
    }

    #[test]
    fn rotations_turn_at_constant_speed() {
        let path = bent(Interpolation::Linear);
        let turned = path.at(0.25).rotation().angle();
        assert!((turned - 0.25).abs() < 1e-12, "{turned}");
    }

    #[test]
    fn the_spline_has_no_corner_and_reproduces_uniform_motion() {
        let path = bent(Interpolation::CatmullRom);
        let velocity = |t: f64, h: f64| (path.at(t + h).position_mm() - path.at(t).position_mm()) / h;
        let jump = (velocity(1.0, 1e-6) - velocity(1.0, -1e-6)).norm();
        assert!(jump < 1e-3, "{jump}");
        let straight = [0.0, 0.3, 2.0, 2.1].map(|t| (t, at([5.0 * t, -t, 2.0], 0.0)));
        let straight = Trajectory::from_keys(straight, Interpolation::CatmullRom).expect("trajectory");
        for step in 0..=21 {
            let t = f64::from(step) / 10.0;
            let expected = Point3::new(5.0 * t, -t, 2.0);
            assert!((straight.at(t).position_mm() - expected).norm() < 1e-12);
        }
    }

    #[test]
    fn half_a_turn_between_keys_stays_finite() {
        let keys = [(0.0, at([0.0; 3], 0.0)), (1.0, at([0.0; 3], std::f64::consts::PI))];
        let path = Trajectory::from_keys(keys, Interpolation::Linear).expect("trajectory");
        assert!((path.at(0.5).rotation().angle() - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn times_must_increase_and_be_numbers() {
        let make = |times: &[f64]| {
            let keys: Vec<_> = times.iter().map(|&t| (t, Pose::identity())).collect();
            Trajectory::from_keys(keys, Interpolation::Linear)
        };
        assert!(matches!(make(&[]), Err(TrackingError::Value { .. })));
        assert!(matches!(
            make(&[0.0, f64::NAN]),
            Err(TrackingError::Keyframe {
                index: 1,
                key: Some("time_s"),
                ..
            })
        ));
        assert!(matches!(
            make(&[0.0, 1.0, 1.0]),
            Err(TrackingError::Keyframe {
                index: 2,
                key: Some("time_s"),
                ..
            })
        ));
        assert!(matches!(make(&[1e10]), Err(TrackingError::Keyframe { index: 0, .. })));
    }

    #[test]
    fn a_carried_trajectory_goes_with_its_carrier() {
        let path = bent(Interpolation::Linear);
        let still = Trajectory::fixed(at([3.0, -2.0, 7.0], 0.4));
        let moving = Trajectory::from_keys(
            [(0.5, at([0.0; 3], 0.0)), (2.5, at([0.0, 0.0, 30.0], 1.2))],
            Interpolation::Linear,
        );
        for (carrier, bound) in [(still, 1e-9), (moving.expect("trajectory"), 1e-5)] {
            let carried = path.carried(&carrier).expect("trajectory");
            for time in [0.0, 0.5, 0.77123, 1.0, 2.2, 3.5] {
                let product = carrier.at(time).probe_to_world() * path.at(time).probe_to_world();
                let off = (carried.at(time).probe_to_world() - product).amax();
                assert!(off < bound, "{time}: {off}");
            }
        }
    }

    #[test]
    fn keyframes_without_lateral_carry_the_marked_side_on() {
        #[derive(Deserialize)]
        struct Path {
            keyframes: Vec<KeyframeSpec>,
        }
        let text = "keyframes = [
            { time_s = 0, position_mm = [0, 0, 0], direction = [0, 1, 0], lateral = [0, 0, 1] },
            { time_s = 1, position_mm = [5, 0, 0], direction = [1, 1, 0] },
        ]";
        let path: Path = toml::from_str(text).expect("toml");
        let path = Trajectory::from_keyframes(&path.keyframes, World::Lps, Interpolation::Linear).expect("trajectory");
        assert!((path.at(1.0).lateral().into_inner() - Vector3::z()).norm() < 1e-12);
        let broken: Path = toml::from_str("keyframes = [{ time_s = 0, direction = [0, 1, 0] }]").expect("toml");
        let error =
            Trajectory::from_keyframes(&broken.keyframes, World::Lps, Interpolation::Linear).expect_err("incomplete");
        assert!(matches!(error, TrackingError::Keyframe { index: 0, .. }), "{error}");
    }

    proptest! {
        #[test]
        fn every_pose_on_the_way_is_rigid(t in -1.0..5.0f64, spline in any::<bool>()) {
            let path = bent(if spline { Interpolation::CatmullRom } else { Interpolation::Linear });
            let pose = path.at(t);
            let axes = pose.probe_to_world().fixed_view::<3, 3>(0, 0).into_owned();
            prop_assert!((axes.transpose() * axes - nalgebra::Matrix3::identity()).amax() < 1e-12);
        }
    }
}
