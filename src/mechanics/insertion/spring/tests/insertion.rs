//! Insertion and withdrawal.

use super::super::testing::*;
use super::super::*;

/// 75 mm in and out: the stack grows and empties, the force is friction and cutting, and tissue comes back to rest.
#[test]
fn in_and_out() {
    let mut springs = model(coarse(), Layers::one(soft()));
    let mut events = Vec::new();
    let mut max_contacts = 0;
    drive(&mut springs, [-5.0, 75.0], 40.0, 1e-3, |outcome| {
        events.extend(outcome.events.iter().map(|event| event.kind));
        assert!(outcome.contacts >= max_contacts && outcome.converged);
        max_contacts = outcome.contacts;
    });
    assert_eq!(events, [EventKind::Skin, EventKind::Puncture]);
    // Layers are 6.67 mm apart: the tip has met eleven or twelve of them beside the skin.
    assert!((12..=13).contains(&max_contacts), "{max_contacts}");
    let force = springs.outcome.on_hand.force_n.z;
    let inserted = springs.outcome.inserted_mm;
    assert!((70.0..75.0).contains(&inserted));
    assert!(force < 0.0 && -force <= 0.01 * inserted + 0.5 + 1e-9, "{force}");
    drive(&mut springs, [75.0, 74.0], 40.0, 1e-3, |_| {});
    let mut before = springs.outcome.inserted_mm;
    drive(&mut springs, [74.0, 20.0], 40.0, 1e-3, |outcome| {
        // On withdrawal the entire shaft slides, and nothing is cut: friction along the inserted length before the
        // step.
        let bound = 0.01 * before;
        before = outcome.inserted_mm;
        assert!(outcome.on_hand.force_n.z <= bound + 1e-9);
        assert!(outcome.events.is_empty());
    });
    assert!(springs.outcome.on_hand.force_n.z > 0.19);
    drive(&mut springs, [20.0, -5.0], 40.0, 1e-3, |outcome| {
        events.extend(outcome.events.iter().map(|event| event.kind));
    });
    assert_eq!(events.last(), Some(&EventKind::Out));
    assert_eq!(
        (springs.outcome.contacts, springs.outcome.on_hand),
        (0, Wrench::default())
    );
    assert_eq!(springs.network.reference, springs.network.original);
    // Relaxing at no less than half the rate of damping, 1e-9 is reached in 0.3 s.
    (0..10).for_each(|_| assert!(springs.step(&tip_at(0.3, 0.2, -5.0), 0.1).is_ok()));
    assert!(!springs.is_active());
    assert_eq!(springs.energy_nmm(), 0.0);
}

/// At a steady pace the forces along the needle are those of the last substep, whose mean is the force on the hand.
#[test]
fn forces_along_the_needle_add_up() {
    let mut springs = model(coarse(), Layers::one(soft()));
    drive(&mut springs, [-5.0, 40.0], 40.0, 1e-3, |_| {});
    let mut loads = Vec::new();
    springs.shaft_loads(&mut loads);
    let sum: Vector3<f64> = loads.iter().map(|load| load.force_n).sum();
    let hand = springs.outcome.on_hand.force_n;
    assert!((sum - hand).norm() < 1e-6 * hand.norm(), "{sum} for {hand}");
    assert!(
        loads.len() > 3 && loads.iter().all(|load| load.from_mm <= load.to_mm),
        "{loads:?}"
    );
}
