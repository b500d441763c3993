//! Needle motion over time.

use nalgebra::{Matrix4, Point3, Rotation3, Unit, Vector3};

use insonify_base::bending::BendingConstraint;

use super::NeedlePose;
use crate::TrackingError;
use crate::error::in_ranges;
use crate::pose::{Pose, unit};
use crate::trajectory::{Interpolation, TrackedFrame, Trajectory};

/// A moving needle: the path of its tip, whose frame has the y axis along the needle, and its constant properties.
///
/// CSV paths and keyframes are those of [`Trajectory`] with the tip in place of the array's centre and the needle's
/// direction in place of the axial one.
#[derive(Clone, Debug, PartialEq)]
pub struct NeedlePath {
    tip: Trajectory,
    length_mm: f64,
    diameter_mm: f64,
    entry: Option<Entry>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Entry {
    constraint: BendingConstraint,
    point: Point3<f64>,
    direction: Unit<Vector3<f64>>,
}

impl NeedlePath {
    /// Creates a straight needle of a length and diameter (mm) whose tip follows a trajectory.
    pub fn new(tip: Trajectory, length_mm: f64, diameter_mm: f64) -> Result<Self, TrackingError> {
        NeedlePose::straight(Point3::origin(), Vector3::y(), length_mm, diameter_mm)?;
        Ok(Self {
            tip,
            length_mm,
            diameter_mm,
            entry: None,
        })
    }

    /// Constrains the bending of the part beyond an entry point (mm), given the direction at entry (any length).
    pub fn constrained(
        mut self,
        constraint: BendingConstraint,
        entry_mm: Point3<f64>,
        entry_direction: Vector3<f64>,
    ) -> Result<Self, TrackingError> {
        in_ranges("needle", &constraint)?;
        self.entry = Some(Entry {
            constraint,
            point: super::point("entry_mm", entry_mm.into())?,
            direction: unit("needle", "entry_direction", entry_direction)?,
        });
        Ok(self)
    }

    /// Path of the tip through timed positions (mm) and directions, with the smallest rotation between them.
    pub fn tip_trajectory(
        keys: &[(f64, Point3<f64>, Vector3<f64>)],
        interpolation: Interpolation,
    ) -> Result<Trajectory, TrackingError> {
        let mut poses: Vec<(f64, Pose)> = Vec::with_capacity(keys.len());
        for (index, &(time_s, tip, direction)) in keys.iter().enumerate() {
            let pose: Result<Pose, TrackingError> = match poses.last() {
                Some((_, previous)) => previous.turned_to(tip, direction),
                None => Pose::from_direction(tip, direction, None),
            };
            poses.push((time_s, pose.map_err(|error| error.of_keyframe(index))?));
        }
        Trajectory::from_keys(poses, interpolation)
    }

    /// Path of the tip from recorded frames of a tracked needle. `tip_to_tool` is the transform from the tip's frame to
    /// that of the marker on the needle, and `shaft_axis` the direction of the needle in the tip's frame, from hub to
    /// tip: PLUS models its needles along the tip frame's -z behind the tip, so +z.
    pub fn tip_from_tracked(
        frames: &[TrackedFrame],
        tip_to_tool: &Matrix4<f64>,
        shaft_axis: Vector3<f64>,
        tracker_to_world: &Matrix4<f64>,
        interpolation: Interpolation,
    ) -> Result<Trajectory, TrackingError> {
        let axis = Unit::try_new(shaft_axis, 1e-9).ok_or_else(|| {
            let axis = <[f64; 3]>::from(shaft_axis);
            let expected = "expected finite numbers that are not all zero";
            TrackingError::at("shaft_axis", format!("pose key `shaft_axis` is {axis:?}; {expected}")).of_keyframe(0)
        })?;
        let turn = Rotation3::rotation_between(&Vector3::y(), &axis)
            .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        Trajectory::from_tracked(
            frames,
            &(tip_to_tool * turn.to_homogeneous()),
            tracker_to_world,
            interpolation,
        )
    }

    /// The needle on another path of its tip.
    pub fn with_tip(&self, tip: Trajectory) -> Self {
        Self { tip, ..self.clone() }
    }

    /// Path of the tip.
    pub fn tip(&self) -> &Trajectory {
        &self.tip
    }

    /// Needle at a time, s; constant beyond the path's ends.
    pub fn at(&self, time_s: f64) -> NeedlePose {
        let pose = self.tip.at(time_s);
        let tip = pose.position_mm();
        let measured = NeedlePose {
            nodes: vec![tip - pose.axial().scale(self.length_mm), tip],
            diameter_mm: self.diameter_mm,
        };
        match &self.entry {
            Some(entry) => measured.constrained(&entry.constraint, entry.point, &entry.direction),
            None => measured,
        }
    }
}

impl NeedlePose {
    /// This straight measured pose, bent where it enters the body at `entry_mm`: from the hub to the entry point, then
    /// along the constrained direction for the remaining length. A needle too short to reach the entry point, or with
    /// its hub on it, is left as measured.
    pub fn constrained(
        &self,
        constraint: &BendingConstraint,
        entry_mm: Point3<f64>,
        entry_direction: &Unit<Vector3<f64>>,
    ) -> Self {
        let outside = (entry_mm - self.hub_mm()).norm();
        let inserted = self.length_mm() - outside;
        let direction = constraint.direction(entry_direction, &self.direction(), inserted);
        let nodes = vec![self.hub_mm(), entry_mm, entry_mm + direction.scale(inserted)];
        if inserted > 0.0 {
            Self::bent(nodes, self.diameter_mm()).unwrap_or_else(|_| self.clone())
        } else {
            self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::key;
    use insonify_base::range::Ranges;

    #[test]
    fn the_needle_turns_along_the_great_circle() {
        let keys = [
            (0.0, Point3::origin(), Vector3::y()),
            (1.0, Point3::new(0.0, 10.0, 0.0), Vector3::z()),
        ];
        let tip = NeedlePath::tip_trajectory(&keys, Interpolation::Linear).expect("path");
        let path = NeedlePath::new(tip, 100.0, 1.0).expect("needle");
        let needle = path.at(0.5);
        assert!((needle.tip_mm() - Point3::new(0.0, 5.0, 0.0)).norm() < 1e-12);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!((needle.direction().into_inner() - Vector3::new(0.0, half, half)).norm() < 1e-12);
        assert!((needle.length_mm() - 100.0).abs() < 1e-9);
    }

    #[test]
    fn a_tracked_needle_points_along_its_shaft_axis() {
        let shift = Matrix4::new_translation(&Vector3::new(5.0, 0.0, 0.0));
        let frames = [TrackedFrame {
            time_s: Some(0.0),
            tool_to_tracker: Some(shift),
        }];
        for axis in [Vector3::z(), -Vector3::y(), Vector3::new(1.0, 2.0, 3.0)] {
            let tip = NeedlePath::tip_from_tracked(&frames, &shift, axis, &shift, Interpolation::Linear).expect("path");
            let needle = NeedlePath::new(tip, 100.0, 1.0).expect("needle").at(0.0);
            assert!((needle.direction().into_inner() - axis.normalize()).norm() < 1e-9);
            assert!((needle.tip_mm() - Point3::new(15.0, 0.0, 0.0)).norm() < 1e-12);
        }
        let zero = NeedlePath::tip_from_tracked(&frames, &shift, Vector3::zeros(), &shift, Interpolation::Linear);
        assert!(matches!(
            zero,
            Err(TrackingError::Keyframe {
                index: 0,
                key: Some("shaft_axis"),
                ..
            })
        ));
    }

    #[test]
    fn a_constrained_path_bends_at_the_entry_point() {
        let keys = [(0.0, Point3::new(30.0, 100.0, 0.0), Vector3::new(0.3, 1.0, 0.0))];
        let tip = NeedlePath::tip_trajectory(&keys, Interpolation::Linear).expect("path");
        let path = NeedlePath::new(tip, 200.0, 1.0)
            .and_then(|path| path.constrained(BendingConstraint::default(), Point3::origin(), Vector3::y()))
            .expect("needle");
        assert_eq!(path.at(0.0).nodes_mm()[1], Point3::origin());
    }

    #[test]
    fn faults_are_typed() {
        let still = Trajectory::fixed(Pose::identity());
        assert_eq!(key(NeedlePath::new(still.clone(), f64::NAN, 1.0)), Some("length_mm"));
        let path = NeedlePath::new(still, 100.0, 1.0).expect("needle");
        let nowhere = path.constrained(
            BendingConstraint::default(),
            Point3::new(f64::NAN, 0.0, 0.0),
            Vector3::y(),
        );
        assert_eq!(key(nowhere), Some("entry_mm"));
        let nan = [(0.0, Point3::origin(), Vector3::new(f64::NAN, 0.0, 0.0))];
        assert!(NeedlePath::tip_trajectory(&nan, Interpolation::Linear).is_err());
    }

    #[test]
    fn the_constrained_shaft_passes_the_entry_point_and_keeps_its_length() {
        let constraint = BendingConstraint::default();
        let measured = NeedlePose::straight(Point3::new(40.0, 100.0, 0.0), Vector3::new(0.4, 1.0, 0.0), 200.0, 1.0);
        let measured = measured.expect("needle");
        let entry = Point3::new(0.0, 0.0, 0.0);
        let bent = measured.constrained(&constraint, entry, &Vector3::y_axis());
        assert_eq!(bent.nodes_mm().len(), 3);
        assert_eq!((bent.hub_mm(), bent.nodes_mm()[1]), (measured.hub_mm(), entry));
        assert!((bent.length_mm() - 200.0).abs() < 1e-9);
        let far = measured.constrained(&constraint, Point3::new(0.0, 500.0, 0.0), &Vector3::y_axis());
        assert_eq!(far, measured);
    }

    #[test]
    fn ranges_are_checked() {
        let read = |text: &str| toml::from_str::<BendingConstraint>(text).expect(text);
        assert_eq!(read(""), BendingConstraint::default());
        assert!(read("max_weight = 1.5").check_ranges().is_err());
        assert!(read("delta_mm = nan").check_ranges().is_err());
        assert!(toml::from_str::<BendingConstraint>("alpha = 60").is_err());
    }
}
