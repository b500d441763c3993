//! Insertion and withdrawal.

use super::super::testing::*;
use super::super::*;

/// 75 mm in and out: the stack grows and empties, the force is friction and cutting, and tissue comes back to rest.
#[test]
fn in_and_out() {
    let mut it = model(coarse(), Layers::one(soft()));
    let mut events = Vec::new();
    let mut most = 0;
    drive(&mut it, [-5.0, 75.0], 40.0, 1e-3, |outcome| {
        events.extend(outcome.events.iter().map(|event| event.kind));
        assert!(outcome.contacts >= most && outcome.converged);
        most = outcome.contacts;
    });
    assert_eq!(events, [EventKind::Skin, EventKind::Puncture]);
    // Layers are 6.67 mm apart: the tip has met eleven or twelve of them beside the skin.
    assert!((12..=13).contains(&most), "{most}");
    let force = it.outcome.on_hand.force_n.z;
    let inserted = it.outcome.inserted_mm;
    assert!((70.0..75.0).contains(&inserted));
    assert!(force < 0.0 && -force <= 0.01 * inserted + 0.5 + 1e-9, "{force}");
    drive(&mut it, [75.0, 74.0], 40.0, 1e-3, |_| {});
    let mut before = it.outcome.inserted_mm;
    drive(&mut it, [74.0, 20.0], 40.0, 1e-3, |outcome| {
        // On withdrawal the entire shaft slides, and nothing is cut: friction along the inserted length before the step.
        let bound = 0.01 * before;
        before = outcome.inserted_mm;
        assert!(outcome.on_hand.force_n.z <= bound + 1e-9);
        assert!(outcome.events.is_empty());
    });
    assert!(it.outcome.on_hand.force_n.z > 0.19);
    drive(&mut it, [20.0, -5.0], 40.0, 1e-3, |outcome| {
        events.extend(outcome.events.iter().map(|event| event.kind));
    });
    assert_eq!(events.last(), Some(&EventKind::Out));
    assert_eq!((it.outcome.contacts, it.outcome.on_hand), (0, Wrench::default()));
    assert_eq!(it.network.reference, it.network.original);
    // Relaxing at no less than half the rate of damping, 1e-9 is reached in 0.3 s.
    (0..10).for_each(|_| assert!(it.step(&tip_at(0.3, 0.2, -5.0), 0.1).is_ok()));
    assert!(!it.is_active());
    assert_eq!(it.energy_nmm(), 0.0);
}

/// At a steady pace the forces along the needle are those of the last substep, whose mean is the force on the hand.
#[test]
fn forces_along_the_needle_add_up() {
    let mut it = model(coarse(), Layers::one(soft()));
    drive(&mut it, [-5.0, 40.0], 40.0, 1e-3, |_| {});
    let mut loads = Vec::new();
    it.shaft_loads(&mut loads);
    let sum: Vector3<f64> = loads.iter().map(|load| load.force_n).sum();
    let hand = it.outcome.on_hand.force_n;
    assert!((sum - hand).norm() < 1e-6 * hand.norm(), "{sum} for {hand}");
    assert!(
        loads.len() > 3 && loads.iter().all(|load| load.from_mm <= load.to_mm),
        "{loads:?}"
    );
}
