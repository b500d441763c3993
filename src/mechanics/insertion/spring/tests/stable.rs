//! Stability in extreme cases.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::super::testing::*;
use super::super::*;
use crate::insertion::Interaction;

/// Asserts that everything is finite, and nothing has moved farther than the needle could push it.
fn sane(springs: &MassSpring, farthest: f64) {
    let displaced = springs
        .network
        .displacement
        .iter()
        .map(|displacement| displacement.norm())
        .fold(0.0, f64::max);
    assert!(displaced <= farthest, "{displaced}");
    let numbers = springs.network.velocity.iter().chain(&springs.network.reference);
    assert!(numbers.flatten().all(|number| number.is_finite()));
    assert!(
        springs
            .outcome
            .on_hand
            .force_n
            .iter()
            .chain(&springs.outcome.on_hand.torque_nmm)
            .all(|number| number.is_finite())
    );
}

/// A needle that is torn out faster than tissue follows leaves it hooked to the shaft: it springs back by itself, and
/// everything is as before.
#[test]
fn torn_out_in_one_step() {
    let sticky = Interaction {
        friction_n_per_mm: 0.5,
        ..soft()
    };
    let mut springs = model(coarse(), Layers::one(sticky));
    drive(&mut springs, [-2.0, 40.0], 40.0, 1e-3, |_| {});
    assert!(springs.contacts.stack.len() > 4);
    let out = tip_at(0.3, 0.2, -4.0);
    let forces: Vec<f64> = (0..400)
        .map(|_| springs.step(&out, 1e-3).unwrap().on_hand.force_n.z)
        .collect();
    assert_eq!(
        (springs.contacts.stack.len(), springs.outcome.on_hand),
        (0, Wrench::default())
    );
    // No more than the friction of 44 mm, with nothing cut.
    assert!(forces.iter().all(|force| *force <= 0.5 * 44.0 + 1e-9));
    (0..20).for_each(|_| assert!(springs.step(&out, 0.1).is_ok()));
    assert_eq!(
        (
            springs.energy_nmm(),
            springs.network.reference == springs.network.original
        ),
        (0.0, true)
    );
}

/// From a saved state, through text, the same steps give the same bits.
#[test]
fn replay_is_exact() {
    let mut springs = model(coarse(), Layers::one(soft()));
    drive(&mut springs, [-2.0, 33.3], 200.0, 1e-3, |_| {});
    let saved = springs.save();
    let text = serde_json::to_string(&saved).unwrap();
    let follow_tip = |springs: &mut MassSpring| {
        let mut trace = Vec::new();
        drive(springs, [33.3, 50.0], 200.0, 1e-3, |outcome| {
            trace.push(outcome.clone())
        });
        drive(springs, [50.0, -1.0], 200.0, 1e-3, |outcome| {
            trace.push(outcome.clone())
        });
        let mut snapshot = Snapshot::default();
        springs.snapshot(&mut snapshot);
        (trace, snapshot)
    };
    let first_trace = follow_tip(&mut springs);
    let mut restored = model(coarse(), Layers::one(soft()));
    let read: Saved = serde_json::from_str(&text).unwrap();
    for springs in [&mut springs, &mut restored] {
        springs.restore(&read).unwrap();
        assert_eq!(format!("{:?}", springs.save()), format!("{saved:?}"));
        assert_eq!(follow_tip(springs), first_trace);
    }
    // A state of another model, or a truncated one, changes nothing.
    let before = springs.save();
    let mut foreign = model(MassSpringParameters::default(), Layers::one(soft()));
    assert!(matches!(springs.restore(&foreign.save()), Err(StepError::Foreign(_))));
    let mut short = before.clone();
    short.0.as_object_mut().unwrap().remove("velocity");
    assert!(matches!(springs.restore(&short), Err(StepError::Foreign(_))));
    assert_eq!(springs.save(), before);
}

/// 10 mm and 50 mm a step: cut into substeps, and every layer of nodes is met.
#[test]
fn no_element_is_passed_unseen() {
    for steps in [1, 2, 8] {
        let mut springs = model(coarse(), Layers::one(soft()));
        let (mut events, mut remeshes) = (Vec::new(), 0);
        springs.step(&tip_at(0.3, 0.2, -5.0), 1e-3).unwrap();
        for step in 1..=steps {
            let outcome = springs
                .step(&tip_at(0.3, 0.2, -5.0 + 80.0 * step as f64 / steps as f64), 0.1)
                .unwrap();
            assert!(outcome.converged);
            remeshes += outcome.remeshes;
            events.extend(outcome.events.iter().map(|event| event.kind));
        }
        // Layers lie 6.67 mm apart: eleven of them between the skin and 75 mm.
        assert!((10..=12).contains(&remeshes), "{steps}: {remeshes}");
        assert_eq!(springs.outcome.contacts, remeshes + 1);
        assert_eq!(events, [EventKind::Skin, EventKind::Puncture]);
    }
}

/// The needle is turned about the skin and moved sideways in the tissue: shaft nodes are on it, and it feels a lateral
/// force.
#[test]
fn another_direction() {
    let mut springs = model(coarse(), Layers::one(soft()));
    drive(&mut springs, [-2.0, 40.0], 100.0, 1e-3, |_| {});
    let skin = Vector3::new(0.3, 0.2, 0.0);
    for step in 1..=100 {
        let turn = Isometry3::rotation(Vector3::x() * (0.2 * step as f64 / 100.0));
        let about = Translation3::from(skin) * turn * Translation3::from(-skin);
        let mut instruments = tip_at(0.3, 0.2, 40.0);
        instruments.base = about * instruments.base;
        springs.step(&instruments, 1e-2).unwrap();
        for contact in &springs.contacts.stack {
            let position = springs.network.now(contact.node);
            let on_shaft = springs.body.line.point_at_arc(contact.arc).point_mm.coords;
            assert!((on_shaft - position).norm() < 1e-9);
        }
    }
    // The shaft presses tissue towards -y: tissue and hand are pushed towards +y.
    assert!(
        springs.outcome.on_hand.force_n.y > 0.05,
        "{:?}",
        springs.outcome.on_hand
    );
    sane(&springs, 12.0);
    // Advancing in the new direction takes nodes off the old axis.
    let mut base = Translation3::from(skin) * Isometry3::rotation(Vector3::x() * 0.2) * Translation3::from(-skin);
    base *= tip_at(0.3, 0.2, 40.0).base;
    for step in 1..=200 {
        let instruments = Instruments {
            base: base * Translation3::new(0.0, 0.0, 0.1 * step as f64),
            probe: None,
            guide: None,
            deposit: false,
        };
        springs.step(&instruments, 1e-3).unwrap();
    }
    assert!(
        springs.outcome.contacts >= 7 && springs.outcome.events.is_empty(),
        "{:?}",
        springs.outcome
    );
    sane(&springs, 15.0);
}

/// At rest with the needle in it, the force of the tissue on the needle equals that on its fixed surface.
#[test]
fn what_the_hand_feels_is_what_holds_the_tissue() {
    let mut springs = model(coarse(), Layers::one(soft()));
    drive(&mut springs, [-2.0, 40.0], 100.0, 1e-3, |_| {});
    let mut instruments = tip_at(1.3, 0.2, 40.0);
    (0..40).for_each(|_| assert!(springs.step(&instruments, 0.1).is_ok()));
    instruments.deposit = true;
    let outcome = springs.step(&instruments, 0.1).unwrap().clone();
    springs.network.find_forces();
    let fixed_nodes = (0..springs.network.mass.len()).filter(|&node| springs.network.fixed[node]);
    let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
    let base = instruments.base.translation.vector;
    for node in fixed_nodes {
        force += springs.network.force[node];
        torque += (springs.network.reference[node] - base).cross(&springs.network.force[node]);
    }
    assert!(outcome.on_hand.force_n.norm() > 0.1);
    assert!(
        (outcome.on_hand.force_n + force).norm() < 1e-6,
        "{:?} {force:?}",
        outcome.on_hand
    );
    assert_eq!(outcome.events.len(), 1);
    assert_eq!(springs.body.seeds.len(), 1);
}
