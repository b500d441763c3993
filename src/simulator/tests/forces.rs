//! Forces on the hand, and their timing.

use std::time::Duration;

use nalgebra::{Isometry3, Vector3};

use super::{Fake, instruments, patient};
use crate::simulator::forces::{Easing, Wrenches};
use crate::simulator::{Haptic, Policy, SimulatorOptions};
use insonify_mechanics::insertion::{Instruments, Outcome, Wrench};

#[test]
fn forces_are_on_the_hand_in_both_frames() {
    let mut haptic = Haptic::new(Box::new(Fake::default()), patient());
    // The base's z axis is the world's y axis.
    let base = Isometry3::rotation(Vector3::x() * -std::f64::consts::FRAC_PI_2);
    let inputs = Instruments {
        base,
        probe: Some(Isometry3::identity()),
        guide: None,
        deposit: false,
    };
    let forces = haptic.step(&inputs, 1e-3).expect("step");
    let on_hand = haptic.outcome().on_hand;
    assert_eq!((forces.hand_world, forces.probe_world), (on_hand, Some(on_hand)));
    let axes = |world: Vector3<f64>| Vector3::new(world.x, -world.z, world.y);
    assert!((forces.hand_base.force_n - axes(on_hand.force_n)).norm() < 1e-12);
    assert!((forces.hand_base.torque_nmm - axes(on_hand.torque_nmm)).norm() < 1e-12);
    assert_eq!(forces.overrun, None);
    // Rejected input changes nothing.
    assert!(haptic.step(&inputs, 0.0).is_err());
    assert_eq!((haptic.time_s(), haptic.outcome().contacts), (1e-3, 1));
}

#[test]
fn a_late_step_says_so_and_eases() {
    let slow = Duration::from_millis(4);
    let late = |policy| {
        let options = SimulatorOptions {
            budget: Duration::from_millis(1),
            policy,
            ..SimulatorOptions::default()
        };
        let model = Fake {
            slow,
            ..Fake::default()
        };
        let mut haptic = Haptic::new(Box::new(model), options);
        let forces = haptic.step(&instruments(1), 1e-3).expect("step");
        assert!(forces.took >= slow);
        assert_eq!(forces.overrun, Some(forces.took - Duration::from_millis(1)));
        // The step is made all the same.
        assert_eq!(haptic.outcome().contacts, 1);
        (forces.hand_world.force_n, haptic.outcome().on_hand.force_n)
    };
    let (shown, computed) = late(Policy::Finish);
    assert_eq!(shown, computed);
    let over = Duration::from_millis(4);
    let (shown, computed) = late(Policy::Ease { over });
    assert!((shown - computed * 0.25).norm() < 1e-15);
}

#[test]
fn forces_ease_linearly_and_never_freeze() {
    let shown = |force: f64| {
        let wrench = Wrench {
            force_n: Vector3::new(force, 0.0, 0.0),
            torque_nmm: Vector3::new(0.0, force, 0.0),
        };
        Wrenches::of(&Outcome {
            on_hand: wrench,
            on_probe: Some(wrench),
            ..Outcome::default()
        })
    };
    let policy = Policy::Ease {
        over: Duration::from_millis(4),
    };
    let mut easing = Easing::default();
    let mut next = |force, late| {
        let forces = easing
            .next(shown(force), 1e-3, late, policy)
            .forces(&instruments(0), None, Duration::ZERO, None);
        assert_eq!(forces.probe_world, Some(forces.hand_world));
        assert_eq!(forces.hand_world.torque_nmm.y, forces.hand_world.force_n.x);
        forces.hand_world.force_n.x
    };
    assert_eq!(next(1.0, false), 1.0);
    for (late, expected) in [(true, 2.0), (false, 3.0), (false, 4.0), (false, 5.0), (false, 5.0)] {
        assert!((next(5.0, late) - expected).abs() < 1e-12);
    }
    // Late every time: a low-pass filter, with 3/4 of the difference left after each step.
    for step in 1..60 {
        let expected = 9.0 - 4.0 * 0.75f64.powi(step);
        assert!((next(9.0, true) - expected).abs() < 1e-12);
    }
}
