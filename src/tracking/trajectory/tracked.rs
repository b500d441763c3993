//! Trajectories from recorded tracker poses, frame by frame.

use std::fmt;

use nalgebra::Matrix4;

use super::{Interpolation, Key, Trajectory, check_time};
use crate::TrackingError;
use crate::pose::Pose;
use insonify_base::matrix;

/// Interval assumed between frames without time stamps, s: ten frames per second, a common rate of optical
/// trackers.
const UNTIMED_FRAME_S: f64 = 0.1;

/// Recorded tracker data of one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TrackedFrame {
    /// Time stamp, s, if recorded.
    pub time_s: Option<f64>,
    /// Transform from the tool's frame to the tracker's, mm; `None` if the tracker marked it invalid or recorded
    /// nothing.
    pub tool_to_tracker: Option<Matrix4<f64>>,
}

/// A skipped frame of a tracked sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Skipped {
    /// Frame number, from 0.
    pub frame: usize,
    /// Reason for skipping it.
    pub reason: SkipReason,
}

/// Reason for skipping a frame of a tracked sequence.
#[derive(Clone, Debug, PartialEq)]
pub enum SkipReason {
    /// The tracker marked the transform invalid, or recorded none.
    Invalid,
    /// The transform is not rigid, or has a NaN entry.
    NotRigid(String),
    /// The time stamp is missing where others have one, not finite, or not after that of the previous frame (a
    /// stale frame).
    Time(Option<f64>),
}

impl fmt::Display for SkipReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Invalid => f.write_str("the tracker marked its transform invalid or recorded none"),
            Self::NotRigid(reason) => write!(f, "its transform is not rigid: {reason}"),
            Self::Time(Some(time)) => write!(f, "its time stamp {time} s is not after the one before it"),
            Self::Time(None) => f.write_str("it has no time stamp where others have one"),
        }
    }
}

impl Trajectory {
    /// Path of a transducer from recorded frames: probe to world = `tracker_to_world` x tool to tracker x
    /// `transducer_to_tool`, each on column vectors in mm and rigid (see
    /// [`Calibration`](crate::calibration::Calibration) for the last). Frames without a valid pose are skipped
    /// and counted; a sequence without any valid pose is an error. If no frame has a time stamp, frames are a tenth of
    /// a second apart.
    pub fn from_tracked(
        frames: &[TrackedFrame],
        transducer_to_tool: &Matrix4<f64>,
        tracker_to_world: &Matrix4<f64>,
        interpolation: Interpolation,
    ) -> Result<Self, TrackingError> {
        let placing =
            |which, transform| matrix::rigid(transform).map_err(|text| TrackingError::Transform { which, text });
        let after = placing("transducer-to-tool", transducer_to_tool)?;
        let before = placing("tracker-to-world", tracker_to_world)?;
        let timed = frames.iter().any(|frame| frame.time_s.is_some());
        let mut keys: Vec<Key> = Vec::with_capacity(frames.len());
        let mut skipped = Vec::new();
        let mut repeated = 0;
        let mut last_recorded = None;
        for (source, frame) in frames.iter().enumerate() {
            // Numbered over all frames, so that a skipped one leaves a gap and the others keep their times.
            let untimed = (!timed).then_some(source as f64 * UNTIMED_FRAME_S);
            let key = locate(frame, frame.time_s.or(untimed), keys.last(), &before, &after);
            match key {
                Ok((time_s, pose)) => {
                    repeated += usize::from(last_recorded == frame.tool_to_tracker);
                    last_recorded = frame.tool_to_tracker;
                    keys.push(Key { time_s, pose, source });
                }
                Err(reason) => skipped.push(Skipped { frame: source, reason }),
            }
        }
        match (keys.is_empty(), skipped.first()) {
            (false, _) => Ok(Self {
                keys,
                interpolation,
                skipped,
                repeated,
            }),
            (true, Some(first)) => Err(TrackingError::NoValidPose {
                frames: frames.len(),
                first: first.reason.clone(),
            }),
            (true, None) => Err(super::empty()),
        }
    }
}

fn locate(
    frame: &TrackedFrame,
    time_s: Option<f64>,
    previous: Option<&Key>,
    before: &Matrix4<f64>,
    after: &Matrix4<f64>,
) -> Result<(f64, Pose), SkipReason> {
    let recorded = frame.tool_to_tracker.as_ref().ok_or(SkipReason::Invalid)?;
    let recorded = matrix::rigid(recorded).map_err(SkipReason::NotRigid)?;
    let time = time_s.ok_or(SkipReason::Time(None))?;
    check_time(0, time, previous.map(|key| key.time_s)).map_err(|_| SkipReason::Time(Some(time)))?;
    let pose = Pose::of_matrix(&(before * recorded * after)).map_err(SkipReason::NotRigid)?;
    Ok((time, pose))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};

    use super::*;

    fn frame(time_s: Option<f64>, x: f64) -> TrackedFrame {
        let mut matrix = Rotation3::from_euler_angles(0.1, 0.2, 0.3).to_homogeneous();
        matrix[(0, 3)] = x;
        TrackedFrame {
            time_s,
            tool_to_tracker: Some(matrix),
        }
    }

    fn track(frames: &[TrackedFrame]) -> Result<Trajectory, TrackingError> {
        Trajectory::from_tracked(
            frames,
            &Matrix4::identity(),
            &Matrix4::identity(),
            Interpolation::Linear,
        )
    }

    #[test]
    fn invalid_frames_are_counted_with_their_reasons() {
        let mut nan = frame(Some(3.0), 3.0);
        if let Some(matrix) = &mut nan.tool_to_tracker {
            matrix[(2, 1)] = f64::NAN;
        }
        let mut scaled = frame(Some(4.0), 3.0);
        scaled.tool_to_tracker = scaled.tool_to_tracker.map(|m| m * Matrix4::new_scaling(0.5));
        let frames = [
            frame(Some(0.0), 0.0),
            frame(Some(1.0), 1.0),
            TrackedFrame {
                time_s: Some(2.0),
                tool_to_tracker: None,
            },
            nan,
            scaled,
            frame(Some(1.0), 5.0),
            frame(None, 6.0),
            frame(Some(7.0), 1.0),
        ];
        let path = track(&frames).expect("trajectory");
        assert_eq!(path.keys().iter().map(|key| key.source).collect::<Vec<_>>(), [0, 1, 7]);
        assert_eq!(path.repeated(), 1);
        let skipped: Vec<_> = path
            .skipped()
            .iter()
            .map(|skipped| (skipped.frame, skipped.reason.clone()))
            .collect();
        assert!(matches!(
            skipped[..],
            [
                (2, SkipReason::Invalid),
                (3, SkipReason::NotRigid(_)),
                (4, SkipReason::NotRigid(_)),
                (5, SkipReason::Time(Some(_))),
                (6, SkipReason::Time(None)),
            ]
        ));
    }

    #[test]
    fn a_sequence_without_a_valid_pose_is_an_error() {
        let error = track(&[TrackedFrame::default(); 4]).expect_err("no pose");
        assert!(matches!(error, TrackingError::NoValidPose { frames: 4, .. }), "{error}");
        assert!(matches!(track(&[]), Err(TrackingError::Value { .. })));
    }

    #[test]
    fn transforms_are_chained_in_order() {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 1.0).to_homogeneous();
        let shift = Matrix4::new_translation(&Vector3::new(0.0, 20.0, 0.0));
        let frames = [frame(Some(1.0), 7.0)];
        let path = Trajectory::from_tracked(&frames, &shift, &turn, Interpolation::Linear).expect("trajectory");
        let expected = turn * frames[0].tool_to_tracker.expect("matrix") * shift;
        assert!((path.keys()[0].pose.probe_to_world() - expected).amax() < 1e-12);
        let mirror = Matrix4::new_nonuniform_scaling(&Vector3::new(-1.0, 1.0, 1.0));
        let error = Trajectory::from_tracked(&frames, &shift, &mirror, Interpolation::Linear).expect_err("mirror");
        assert!(error.to_string().starts_with("tracker-to-world"), "{error}");
    }

    #[test]
    fn frames_without_time_stamps_are_evenly_spaced() {
        let path = track(&[frame(None, 0.0), TrackedFrame::default(), frame(None, 2.0)]).expect("trajectory");
        assert_eq!(path.keys().iter().map(|key| key.time_s).collect::<Vec<_>>(), [0.0, 0.2]);
    }
}
