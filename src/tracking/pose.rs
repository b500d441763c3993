//! Probe pose: a rigid transform from the probe frame to the world (LPS, mm).

use nalgebra::{Matrix3, Matrix4, Point3, Rotation3, Unit, UnitQuaternion, Vector3};

use super::error::TrackingError;
use super::world::World;
use insonify_base::matrix::{self, Rows};

/// Smallest sine of the angle between the axial direction and a lateral hint: below it (a twentieth of a degree) the
/// hint is ambiguous.
const PARALLEL_SINE: f64 = 1e-3;

/// Position and orientation of a probe: its frame (x lateral towards the marked side, y axial into the body, z = x
/// cross y) in the world. Always finite and a proper rotation.
///
/// ```
/// use insonify_tracking::pose::Pose;
/// use nalgebra::{Point3, Vector3};
///
/// let pose = Pose::from_direction(Point3::new(0.0, -120.0, 40.0), Vector3::y(), Some(Vector3::x()))?;
/// let ten_deep = pose.probe_to_world().transform_point(&Point3::new(0.0, 10.0, 0.0));
/// assert!((ten_deep - Point3::new(0.0, -110.0, 40.0)).norm() < 1e-12);
/// # Ok::<(), insonify_tracking::TrackingError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    probe_to_world: Matrix4<f64>,
}

impl Pose {
    /// The identity pose: the probe frame is the world frame.
    pub fn identity() -> Self {
        Self {
            probe_to_world: Matrix4::identity(),
        }
    }

    /// Creates a pose from a probe-to-world matrix on column vectors, mm. Rotations with errors of up to 5e-3 per
    /// entry, as trackers send them, are orthonormalised.
    pub fn from_matrix(probe_to_world: &Matrix4<f64>) -> Result<Self, TrackingError> {
        Self::of_matrix(probe_to_world).map_err(|text| TrackingError::at("matrix", format!("pose matrix: {text}")))
    }

    /// Creates a pose as [`Pose::from_matrix`] does; the error says what is wrong with the matrix.
    pub(super) fn of_matrix(probe_to_world: &Matrix4<f64>) -> Result<Self, String> {
        let probe_to_world = matrix::rigid(probe_to_world)?;
        Ok(Self { probe_to_world })
    }

    /// Creates a pose from the centre of the array (mm), the axial direction and a lateral hint, which is
    /// orthogonalised to the axial direction. The lengths of the vectors are arbitrary. Without a hint the marked side
    /// points to the patient's left (+x), or to the feet (-z) if the axial direction is within 45 degrees of x.
    pub fn from_direction(
        position_mm: Point3<f64>,
        direction: Vector3<f64>,
        lateral: Option<Vector3<f64>>,
    ) -> Result<Self, TrackingError> {
        let axial = unit("pose", "direction", direction)?;
        let hint = match lateral {
            Some(lateral) => unit("pose", "lateral", lateral)?.into_inner(),
            None if axial.x.abs() <= std::f64::consts::FRAC_1_SQRT_2 => Vector3::x(),
            None => -Vector3::z(),
        };
        let across = hint - axial.scale(hint.dot(&axial));
        if across.norm() < PARALLEL_SINE {
            let [lateral, direction] = [lateral.unwrap_or(hint), direction].map(<[f64; 3]>::from);
            let expected = format!("parallel to `direction` {direction:?}; expected a vector across it");
            return Err(TrackingError::at(
                "lateral",
                format!("pose key `lateral` is {lateral:?}, {expected}"),
            ));
        }
        let x = across.normalize();
        let axes = Matrix3::from_columns(&[x, axial.into_inner(), x.cross(&axial)]);
        Self::from_axes(position_mm, &axes)
    }

    /// Creates a pose from the centre of the array (mm) and a rotation from the probe frame to the world.
    pub fn from_rotation(position_mm: Point3<f64>, rotation: &UnitQuaternion<f64>) -> Result<Self, TrackingError> {
        Self::from_axes(position_mm, rotation.to_rotation_matrix().matrix())
    }

    /// Creates a pose from the centre of the array (mm) and a quaternion w, x, y, z of norm 1 within a hundredth.
    pub fn from_quaternion(position_mm: Point3<f64>, wxyz: [f64; 4]) -> Result<Self, TrackingError> {
        let quaternion = nalgebra::Quaternion::new(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
        let length = quaternion.norm();
        if !(0.99..=1.01).contains(&length) {
            return Err(TrackingError::new(format!(
                "quaternion {wxyz:?} (w, x, y, z) has length {length}; expected 1"
            )));
        }
        Self::from_rotation(position_mm, &UnitQuaternion::from_quaternion(quaternion))
    }

    fn from_axes(position_mm: Point3<f64>, axes: &Matrix3<f64>) -> Result<Self, TrackingError> {
        if !(position_mm.coords.iter().all(|x| x.is_finite()) && position_mm.coords.amax() <= matrix::FARTHEST_MM) {
            return Err(too_large("position_mm", position_mm.coords.as_slice()));
        }
        let mut probe_to_world = axes.to_homogeneous();
        probe_to_world
            .fixed_view_mut::<3, 1>(0, 3)
            .copy_from(&position_mm.coords);
        Ok(Self { probe_to_world })
    }

    /// Returns the pose moved to `position_mm` and rotated by the smallest angle to the axial direction `direction`:
    /// this keeps the marked side steady along a path that states only directions.
    pub fn turned_to(&self, position_mm: Point3<f64>, direction: Vector3<f64>) -> Result<Self, TrackingError> {
        let axial = unit("pose", "direction", direction)?;
        let turn = Rotation3::rotation_between(&self.axial(), &axial)
            .unwrap_or_else(|| Rotation3::from_axis_angle(&self.lateral(), std::f64::consts::PI));
        Self::from_axes(position_mm, &(turn.matrix() * self.axes()))
    }

    /// Returns the pose rotated about its own axes, in this order: `rotate` about the axial one, `rock` in its plane
    /// (about z), `tilt` out of its plane (about x). Radians.
    pub fn turned(&self, rotate: f64, rock: f64, tilt: f64) -> Self {
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), rotate)
            * Rotation3::from_axis_angle(&Vector3::z_axis(), rock)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), tilt);
        Self {
            probe_to_world: self.probe_to_world * turn.to_homogeneous(),
        }
    }

    /// Converts this pose from the axes of `world` to LPS.
    pub fn in_lps(&self, world: World) -> Self {
        Self {
            probe_to_world: world.transform(self.probe_to_world),
        }
    }

    /// Transform from the probe frame to the world, mm.
    pub fn probe_to_world(&self) -> &Matrix4<f64> {
        &self.probe_to_world
    }

    /// Transform from the world to the probe frame, mm.
    pub fn world_to_probe(&self) -> Matrix4<f64> {
        matrix::inverse_rigid(&self.probe_to_world)
    }

    /// Centre of the array in the world, mm.
    pub fn position_mm(&self) -> Point3<f64> {
        Point3::from(self.column(3))
    }

    /// Direction towards the marked side.
    pub fn lateral(&self) -> Unit<Vector3<f64>> {
        Unit::new_unchecked(self.column(0))
    }

    /// Direction into the body.
    pub fn axial(&self) -> Unit<Vector3<f64>> {
        Unit::new_unchecked(self.column(1))
    }

    /// Direction out of the image plane.
    pub fn elevational(&self) -> Unit<Vector3<f64>> {
        Unit::new_unchecked(self.column(2))
    }

    /// Rotation from the probe frame to the world.
    pub fn rotation(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(self.axes()))
    }

    fn column(&self, column: usize) -> Vector3<f64> {
        self.probe_to_world.fixed_view::<3, 1>(0, column).into_owned()
    }

    fn axes(&self) -> Matrix3<f64> {
        self.probe_to_world.fixed_view::<3, 3>(0, 0).into_owned()
    }
}

/// Direction of a vector; `owner` is the table that has the key.
pub(super) fn unit(owner: &str, key: &'static str, vector: Vector3<f64>) -> Result<Unit<Vector3<f64>>, TrackingError> {
    let largest = vector.amax();
    let scaled = vector / largest;
    if scaled.iter().all(|x| x.is_finite()) {
        Ok(Unit::new_normalize(scaled))
    } else {
        let stated = <[f64; 3]>::from(vector);
        let expected = "expected finite numbers that are not all zero";
        Err(TrackingError::at(
            key,
            format!("{owner} key `{key}` is {stated:?}; {expected}"),
        ))
    }
}

fn too_large(key: &'static str, stated: &[f64]) -> TrackingError {
    TrackingError::at(
        key,
        format!("pose key `{key}` is {stated:?}; expected finite numbers of at most 1e6"),
    )
}

/// Declares a table that ends with the keys of a pose, which convert to a [`PoseSpec`].
#[macro_export]
macro_rules! pose_table {
    ($(#[$meta:meta])* pub struct $name:ident { $($(#[$doc:meta])* $key:ident: $type:ty;)* }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($(#[$doc])* pub $key: $type,)*
            /// Centre of the array in the world (LPS), mm.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub position_mm: Option<[f64; 3]>,
            /// Axial direction of the probe in the world; any length.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub direction: Option<[f64; 3]>,
            /// Approximate direction of the marked side in the world; any length, orthogonalised to `direction`.
            /// Default: carried on from the previous keyframe by the smallest rotation; without one the patient's left,
            /// or the feet if the probe points along the left-right axis.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub lateral: Option<[f64; 3]>,
            /// Rotation about the axial direction, degrees. Default 0.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub rotate_deg: Option<f64>,
            /// Rotation within the image plane, towards the marked side when negative, degrees. Default 0.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub rock_deg: Option<f64>,
            /// Rotation out of the image plane, degrees. Default 0.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub tilt_deg: Option<f64>,
            /// Probe-to-world transform, mm: rigid.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub matrix: Option<insonify_base::matrix::Rows>,
        }

        impl From<&$name> for $crate::pose::PoseSpec {
            fn from(table: &$name) -> Self {
                Self {
                    position_mm: table.position_mm,
                    direction: table.direction,
                    lateral: table.lateral,
                    rotate_deg: table.rotate_deg,
                    rock_deg: table.rock_deg,
                    tilt_deg: table.tilt_deg,
                    matrix: table.matrix,
                }
            }
        }
    };
}
pub use pose_table;

pose_table! {
    /// Keys of a pose: either `matrix`, or `position_mm` and `direction` with optional keys.
    #[derive(Default)]
    pub struct PoseSpec {}
}

impl PoseSpec {
    /// Converts this pose from the axes of `world` to LPS.
    pub fn in_lps(self, world: World) -> Self {
        let vector = |stated: Option<[f64; 3]>| stated.map(|stated| world.vector(stated));
        Self {
            position_mm: vector(self.position_mm),
            direction: vector(self.direction),
            lateral: vector(self.lateral),
            matrix: self.matrix.map(|rows| Rows(world.transform(rows.0))),
            ..self
        }
    }

    /// Returns the pose. `previous` is the preceding pose of a path, if any: a direction without `lateral` is then
    /// reached by the smallest rotation from it.
    pub fn pose(&self, previous: Option<&Pose>) -> Result<Pose, TrackingError> {
        let base = match (&self.matrix, self.position_mm, self.direction) {
            (Some(rows), None, None) if self.lateral.is_none() => Pose::from_matrix(&rows.0)?,
            (None, Some(position), Some(direction)) => {
                let (position, direction) = (Point3::from(position), Vector3::from(direction));
                match (self.lateral, previous) {
                    (None, Some(previous)) => previous.turned_to(position, direction)?,
                    (lateral, _) => Pose::from_direction(position, direction, lateral.map(Vector3::from))?,
                }
            }
            (matrix, position, direction) => {
                let found = match (matrix, position, direction) {
                    (Some(_), ..) => "a pose with `matrix` and other keys for the same thing",
                    (None, None, None) => "a pose without `position_mm` and `direction`",
                    (None, None, _) => "a pose without `position_mm`",
                    (None, Some(_), _) => "a pose without `direction`",
                };
                return Err(TrackingError::new(format!(
                    "{found}; expected either `matrix` alone, or `position_mm` with `direction`"
                )));
            }
        };
        let turns = [
            ("rotate_deg", self.rotate_deg),
            ("rock_deg", self.rock_deg),
            ("tilt_deg", self.tilt_deg),
        ];
        let mut radians = [0.0; 3];
        for ((key, turn), radians) in turns.into_iter().zip(&mut radians) {
            let degrees = turn.unwrap_or(0.0);
            if !(-matrix::FARTHEST_MM..=matrix::FARTHEST_MM).contains(&degrees) {
                return Err(too_large(key, &[degrees]));
            }
            *radians = degrees.to_radians();
        }
        // A pose without turns stays as it is stated, free of the rounding of a product.
        if radians == [0.0; 3] {
            return Ok(base);
        }
        Ok(base.turned(radians[0], radians[1], radians[2]))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::error::key;

    #[test]
    fn axes_follow_direction_and_hint() {
        let pose = Pose::from_direction(
            Point3::new(1.0, 2.0, 3.0),
            Vector3::new(0.0, 4.0, 0.0),
            Some(Vector3::new(1.0, 7.0, 0.0)),
        )
        .expect("pose");
        assert!((pose.lateral().into_inner() - Vector3::x()).norm() < 1e-12);
        assert!((pose.axial().into_inner() - Vector3::y()).norm() < 1e-12);
        assert!((pose.elevational().into_inner() - Vector3::z()).norm() < 1e-12);
        assert_eq!(pose.position_mm(), Point3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn every_direction_has_a_default_marked_side() {
        for direction in [
            [1.0, 0.0, 0.0],
            [-1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 1.0, 1.0],
            [0.0, -1e-300, 0.0],
        ] {
            let pose = Pose::from_direction(Point3::origin(), Vector3::from(direction), None).expect("pose");
            Pose::from_matrix(pose.probe_to_world()).expect("rigid");
        }
    }

    #[test]
    fn vectors_without_a_direction_are_refused() {
        let make = |direction: [f64; 3], lateral: [f64; 3]| {
            Pose::from_direction(Point3::origin(), direction.into(), Some(lateral.into()))
        };
        assert_eq!(key(make([0.0; 3], [1.0, 0.0, 0.0])), Some("direction"));
        assert_eq!(key(make([f64::NAN, 1.0, 0.0], [1.0, 0.0, 0.0])), Some("direction"));
        assert_eq!(key(make([0.0, 1.0, 0.0], [0.0; 3])), Some("lateral"));
        assert_eq!(key(make([0.0, 1.0, 0.0], [1e-4, -2.0, 0.0])), Some("lateral"));
        let far = Pose::from_direction(Point3::new(f64::NAN, 0.0, 0.0), Vector3::y(), None);
        assert_eq!(key(far), Some("position_mm"));
    }

    #[test]
    fn turns_are_about_the_probes_own_axes() {
        let pose = Pose::from_direction(Point3::origin(), -Vector3::z(), Some(Vector3::x())).expect("pose");
        let quarter = std::f64::consts::FRAC_PI_2;
        let rotated = pose.turned(quarter, 0.0, 0.0);
        assert!((rotated.axial().into_inner() - pose.axial().into_inner()).norm() < 1e-12);
        let tilted = pose.turned(0.0, 0.0, quarter);
        assert!((tilted.axial().into_inner() - pose.elevational().into_inner()).norm() < 1e-12);
        let rocked = pose.turned(0.0, -quarter, 0.0);
        assert!((rocked.axial().into_inner() - pose.lateral().into_inner()).norm() < 1e-12);
    }

    #[test]
    fn tables_say_what_they_lack() {
        let parse = |text: &str| toml::from_str::<PoseSpec>(text).expect("table").pose(None);
        assert!(parse("position_mm = [0, 0, 0]\ndirection = [0, 1, 0]\ntilt_deg = 10").is_ok());
        assert_eq!(key(parse("")), None);
        assert_eq!(key(parse("position_mm = [0, 0, 0]")), None);
        let both = "direction = [0, 1, 0]\nmatrix = '1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1'";
        assert_eq!(key(parse(both)), None);
        let nan = "matrix = '1 0 0 nan 0 1 0 0 0 0 1 0 0 0 0 1'";
        assert_eq!(key(parse(nan)), Some("matrix"));
        let angle = "position_mm = [0, 0, 0]\ndirection = [0, 1, 0]\ntilt_deg = nan";
        assert_eq!(key(parse(angle)), Some("tilt_deg"));
    }

    #[test]
    fn quaternions_that_are_no_rotations_are_refused() {
        assert!(Pose::from_quaternion(Point3::origin(), [1.001, 0.0, 0.0, 0.0]).is_ok());
        for bad in [[0.0; 4], [f64::NAN, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0]] {
            assert_eq!(key(Pose::from_quaternion(Point3::origin(), bad)), None);
        }
    }

    proptest! {
        #[test]
        fn world_and_probe_round_trip(
            direction in prop::array::uniform3(-1.0..1.0f64),
            position in prop::array::uniform3(-300.0..300.0f64),
            point in prop::array::uniform3(-200.0..200.0f64),
        ) {
            prop_assume!(Vector3::from(direction).norm() > 1e-3);
            let pose = Pose::from_direction(position.into(), direction.into(), None).expect("pose");
            let point = Point3::from(point);
            let back = pose.world_to_probe().transform_point(&pose.probe_to_world().transform_point(&point));
            prop_assert!((back - point).norm() < 1e-9);
            let again = Pose::from_rotation(pose.position_mm(), &pose.rotation()).expect("pose");
            prop_assert!((again.probe_to_world() - pose.probe_to_world()).amax() < 1e-9);
        }

        #[test]
        fn the_shortest_turn_reaches_any_direction(
            from in prop::array::uniform3(-1.0..1.0f64),
            to in prop::array::uniform3(-1.0..1.0f64),
            opposite in any::<bool>(),
        ) {
            let from = Vector3::from(from);
            let to = if opposite { -from } else { Vector3::from(to) };
            prop_assume!(from.norm() > 1e-3 && to.norm() > 1e-3);
            let pose = Pose::from_direction(Point3::origin(), from, None).expect("pose");
            let turned = pose.turned_to(Point3::origin(), to).expect("pose");
            prop_assert!((turned.axial().into_inner() - to.normalize()).norm() < 1e-6);
            Pose::from_matrix(turned.probe_to_world()).expect("rigid");
        }
    }
}
