//! Haptic devices against closed forms.

use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::simulator::{
    Damper, Haptic, HoldOptions, LateralHold, SimulatorError, SimulatorOptions, TemplateGuided, TwoPoints,
};
use insonify_mechanics::insertion::{Outcome, Wrench};
use insonify_tracking::template::Template;

use super::{Fake, instruments, patient};

const DT_S: f64 = 1e-3;

fn poses() -> impl Iterator<Item = Isometry3<f64>> {
    (0..20).map(|index| {
        let index = f64::from(index);
        Isometry3::from_parts(
            Translation3::new(30.0 * index.sin(), -7.0 * index, 100.0 + index),
            UnitQuaternion::from_euler_angles(0.3 * index, (1.1 * index).cos(), -0.17 * index),
        )
    })
}

/// The roll included, if it is that of the previous pose: a pose reproduces itself.
#[test]
fn the_pose_of_a_probe_comes_back_from_its_points() {
    for at_mm in [[30.0, 90.0], [90.0, 30.0], [-10.0, 45.0]] {
        let points = TwoPoints::new(at_mm).expect("points");
        for pose in poses() {
            let measured = at_mm.map(|at| pose * Point3::new(0.0, 0.0, -at));
            let measured_pose = points.pose(&measured, &pose).expect("a pose");
            assert!(measured_pose.stretch_mm.abs() < 1e-10);
            assert!((measured_pose.pose.translation.vector - pose.translation.vector).norm() < 1e-10);
            assert!(measured_pose.pose.rotation.angle_to(&pose.rotation) < 1e-7);
            // From a neighbouring pose: rotated without roll.
            let before = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.2) * pose;
            let after = points.pose(&measured, &before).expect("a pose").pose;
            let turn = after.rotation * before.rotation.inverse();
            let [old, new] = [before, after].map(|pose| pose.rotation * Vector3::z());
            assert!((new - pose.rotation * Vector3::z()).norm() < 1e-10);
            assert!((turn.angle() - old.angle(&new)).abs() < 1e-6);
        }
    }
}

#[test]
fn points_too_far_apart_are_told_and_shared_by_both() {
    let points = TwoPoints::new([20.0, 80.0]).expect("points");
    let measured = [Point3::new(1.0, 2.0, 2.0), Point3::new(1.0, 2.0, -62.0)];
    let measured_pose = points.pose(&measured, &Isometry3::identity()).expect("a pose");
    assert!((measured_pose.stretch_mm - 4.0).abs() < 1e-12);
    // The first point would be at 0, the second at -60 in the middle of both.
    assert!((measured_pose.pose.translation.vector - Vector3::new(1.0, 2.0, 20.0)).norm() < 1e-12);
    let near = [measured[0], measured[0] + Vector3::x() * 29.0];
    let error = points.pose(&near, &Isometry3::identity()).expect_err("too near");
    assert!(error.to_string().contains("about 60 mm apart"), "{error}");
    assert!(TwoPoints::new([3.0, 3.5]).is_err() && TwoPoints::new([f64::NAN, 3.0]).is_err());
}

#[test]
fn forces_on_the_points_are_those_on_the_probe() {
    let at_mm = [40.0, 110.0];
    let points = TwoPoints::new(at_mm).expect("points");
    for (pose, step) in poses().zip(1..) {
        let axis = pose.rotation * Vector3::z();
        let turned = pose.rotation * Vector3::new(3.0, -2.0, 0.0);
        let wrench = Wrench {
            force_n: Vector3::new(0.4, -1.0, 2.0),
            torque_nmm: turned,
        };
        let forces = points.split(&wrench, &pose);
        assert!((forces[0] + forces[1] - wrench.force_n).norm() < 1e-12);
        let torque = axis.cross(&forces[0]) * -at_mm[0] + axis.cross(&forces[1]) * -at_mm[1];
        assert!((torque - wrench.torque_nmm).norm() < 1e-10, "{torque}");
        // A step returns the same.
        let options = SimulatorOptions {
            probe_points: Some(points),
            ..patient()
        };
        let mut haptic = Haptic::new(Box::new(Fake::default()), options);
        let mut inputs = instruments(step);
        let forces = haptic.step(&inputs, DT_S).expect("a step");
        let expected = forces.probe_world.zip(inputs.probe);
        assert_eq!(
            forces.probe_points,
            expected.map(|(wrench, pose)| points.split(&wrench, &pose))
        );
        assert_eq!(forces.axial_n(), forces.hand_base.force_n.z);
        inputs.probe = None;
        assert_eq!(haptic.step(&inputs, DT_S).expect("a step").probe_points, None);
    }
}

/// A mass (kg) whose force (N) is held for a step.
struct Mass {
    kg: f64,
    at_mm: Point3<f64>,
    velocity_mm_s: Vector3<f64>,
}

impl Mass {
    fn step(&mut self, force_n: Vector3<f64>) {
        let acceleration = force_n * (1e3 / self.kg);
        self.at_mm += self.velocity_mm_s * DT_S + acceleration * (0.5 * DT_S * DT_S);
        self.velocity_mm_s += acceleration * DT_S;
    }
}

/// The damper absorbs its momentum: m v = c s, for any step. Above 2 m/dt it becomes unstable.
#[test]
fn a_damper_stops_a_mass_where_its_momentum_is_spent() {
    let largest = Damper::most_ns_per_mm(0.3, DT_S);
    assert!((largest - 0.6).abs() < 1e-12);
    let run = |c: f64| {
        let mut damper = Damper::new(c).expect("a damper");
        let mut mass = Mass {
            kg: 0.3,
            at_mm: Point3::new(5.0, 0.0, -2.0),
            velocity_mm_s: Vector3::new(0.0, 100.0, 50.0),
        };
        for _ in 0..5000 {
            let force = damper.force(&mass.at_mm, DT_S);
            mass.step(force);
        }
        mass
    };
    for c in [0.003, 0.1, 0.95 * largest] {
        let mass = run(c);
        let way = Vector3::new(0.0, 100.0, 50.0) * (0.3e-3 / c);
        assert!(mass.velocity_mm_s.norm() < 1e-9, "{c}: {}", mass.velocity_mm_s);
        assert!(
            (mass.at_mm.coords - Vector3::new(5.0, 0.0, -2.0) - way).norm() < 1e-9,
            "{c}"
        );
    }
    assert!(run(1.05 * largest).velocity_mm_s.norm() > 1e6);
    for c in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(Damper::new(c).is_err(), "{c}");
    }
    let mut damper = Damper::new(1.0).expect("a damper");
    for (x_mm, dt_s) in [(0.0, 1.0), (1.0, 0.0), (f64::NAN, 1.0), (2.0, 1.0), (2.0, f64::NAN)] {
        assert_eq!(damper.force(&Point3::new(x_mm, 0.0, 0.0), dt_s), Vector3::zeros());
    }
}

const HOLD: HoldOptions = HoldOptions {
    kp_n_per_mm: 1.0,
    ki_n_per_mm_s: 10.0,
    kd_ns_per_mm: 0.028,
    most_n: 5.0,
};

/// A side load lets a mass sag by load over stiffness; the integral compensates it.
#[test]
fn a_hold_takes_up_a_side_load_and_leaves_the_axis_free() {
    let axis = Unit::new_normalize(Vector3::new(0.3, -0.2, 1.0));
    let load = Vector3::new(1.5, 0.0, 0.0);
    let across = load - axis.into_inner() * axis.dot(&load);
    let hole = Point3::new(4.0, 5.0, 6.0);
    let run = |ki_n_per_mm_s: f64| {
        let mut hold = LateralHold::new(HoldOptions { ki_n_per_mm_s, ..HOLD }).expect("a hold");
        let mut mass = Mass {
            kg: 0.2,
            at_mm: hole + axis.into_inner() * 30.0,
            velocity_mm_s: Vector3::zeros(),
        };
        let mut force = Vector3::zeros();
        for _ in 0..5000 {
            force = hold.force(&mass.at_mm, &hole, &axis, DT_S);
            assert!(force.dot(&axis).abs() < 1e-12);
            mass.step(force + across);
        }
        let aside = mass.at_mm - hole;
        assert!((aside.dot(&axis) - 30.0).abs() < 1e-6);
        (aside - axis.into_inner() * axis.dot(&aside), force)
    };
    let (aside, force) = run(0.0);
    assert!((aside - across / HOLD.kp_n_per_mm).norm() < 1e-6, "{aside}");
    assert!((force + across).norm() < 1e-6);
    let (aside, force) = run(HOLD.ki_n_per_mm_s);
    assert!(aside.norm() < 0.01, "{aside}");
    assert!((force + across).norm() < 0.01);
}

/// After a long lateral offset the force stays within its limit, and vanishes at once on return: the integral has not
/// wound up.
#[test]
fn a_hold_pulls_no_harder_than_it_may() {
    let mut hold = LateralHold::new(HOLD).expect("a hold");
    let (hole, axis) = (Point3::origin(), Vector3::z_axis());
    let mut pull = |x: f64| hold.force(&Point3::new(x, 0.0, 0.0), &hole, &axis, DT_S);
    for _ in 0..10_000 {
        assert!(pull(40.0).norm() <= HOLD.most_n * (1.0 + 1e-12));
    }
    assert!((pull(40.0) + Vector3::x() * HOLD.most_n).norm() < 1e-12);
    // On the other side the spring and the integral oppose each other: 5 N at most from before, less 10 N of the
    // spring.
    pull(-10.0);
    let force = pull(-10.0);
    assert!(force.x >= HOLD.most_n - 0.2, "{force}");
    assert_eq!(pull(f64::NAN), Vector3::zeros());
    assert!(pull(0.0).norm() <= HOLD.most_n * (1.0 + 1e-12));
    type Spoil = fn(&mut HoldOptions);
    let spoils: [(&str, Spoil); 4] = [
        ("kp_n_per_mm", |options| options.kp_n_per_mm = 0.0),
        ("ki_n_per_mm_s", |options| options.ki_n_per_mm_s = -1.0),
        ("kd_ns_per_mm", |options| options.kd_ns_per_mm = f64::NAN),
        ("most_n", |options| options.most_n = f64::INFINITY),
    ];
    for (key, spoil) in spoils {
        let mut options = HOLD;
        spoil(&mut options);
        let error = LateralHold::new(options).expect_err(key);
        assert!(
            matches!(error, SimulatorError::Value { key: found, .. } if found == key),
            "{error}"
        );
    }
}

#[test]
fn a_hole_is_chosen_outside_alone() {
    let names = |names: [&str; 3]| names.map(str::to_owned).to_vec();
    let template = Template {
        origin_mm: Point3::new(10.0, 20.0, -50.0),
        steps_mm: [Vector3::x() * 5.0, Vector3::y() * 5.0],
        direction: Vector3::z_axis(),
        columns: names(["A", "B", "C"]),
        rows: names(["1", "2", "3"]),
    };
    let device_mm = Point3::new(100.0, 100.0, 100.0);
    let mut guided = TemplateGuided::new(template, "A1", device_mm).expect("a hole");
    // Rolled by 0.5 about the axis, 3 mm aside, 150 mm before its guide.
    let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.5);
    let device = Isometry3::from_parts(Translation3::new(103.0, 100.0, -50.0), roll);
    let mut outcome = Outcome {
        inserted_mm: 12.5,
        ..Outcome::default()
    };
    assert_eq!(
        guided.choose("C2", &outcome),
        Err(SimulatorError::Inserted { inserted_mm: 12.5 })
    );
    assert_eq!(guided.hole_mm(), Point3::new(10.0, 20.0, -50.0));
    outcome.inserted_mm = 0.0;
    let unknown = guided.choose("C4", &outcome).expect_err("no hole").to_string();
    assert!(unknown.contains("A1 to C3"), "{unknown}");
    guided.choose("C2", &outcome).expect("a hole");
    let hole = Point3::new(20.0, 25.0, -50.0);
    let instruments = guided.instruments(&device);
    assert_eq!((guided.hole_mm(), instruments.guide), (hole, Some(hole)));
    assert!((instruments.base.translation.vector - Vector3::new(20.0, 25.0, -200.0)).norm() < 1e-12);
    assert!(instruments.base.rotation.angle_to(&roll) < 1e-12);
}
