//! Stability in extreme cases.

use nalgebra::{Isometry3, Translation3, Vector3};

use super::super::testing::*;
use super::super::*;
use crate::insertion::Interaction;

/// Asserts that everything is finite, and nothing has moved farther than the needle could push it.
fn sane(it: &MassSpring, farthest: f64) {
    let displaced = it.network.displacement.iter().map(|by| by.norm()).fold(0.0, f64::max);
    assert!(displaced <= farthest, "{displaced}");
    let numbers = it.network.velocity.iter().chain(&it.network.reference);
    assert!(numbers.flatten().all(|number| number.is_finite()));
    assert!(
        it.outcome
            .on_hand
            .force_n
            .iter()
            .chain(&it.outcome.on_hand.torque_nmm)
            .all(|it| it.is_finite())
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
    let mut it = model(coarse(), Layers::one(sticky));
    drive(&mut it, [-2.0, 40.0], 40.0, 1e-3, |_| {});
    assert!(it.contacts.stack.len() > 4);
    let out = tip_at(0.3, 0.2, -4.0);
    let forces: Vec<f64> = (0..400)
        .map(|_| it.step(&out, 1e-3).unwrap().on_hand.force_n.z)
        .collect();
    assert_eq!((it.contacts.stack.len(), it.outcome.on_hand), (0, Wrench::default()));
    // No more than the friction of 44 mm, with nothing cut.
    assert!(forces.iter().all(|force| *force <= 0.5 * 44.0 + 1e-9));
    (0..20).for_each(|_| assert!(it.step(&out, 0.1).is_ok()));
    assert_eq!(
        (it.energy_nmm(), it.network.reference == it.network.original),
        (0.0, true)
    );
}

/// From a saved state, through text, the same steps give the same bits.
#[test]
fn replay_is_exact() {
    let mut it = model(coarse(), Layers::one(soft()));
    drive(&mut it, [-2.0, 33.3], 200.0, 1e-3, |_| {});
    let saved = it.save();
    let text = serde_json::to_string(&saved).unwrap();
    let follow_tip = |it: &mut MassSpring| {
        let mut trace = Vec::new();
        drive(it, [33.3, 50.0], 200.0, 1e-3, |outcome| trace.push(outcome.clone()));
        drive(it, [50.0, -1.0], 200.0, 1e-3, |outcome| trace.push(outcome.clone()));
        let mut snapshot = Snapshot::default();
        it.snapshot(&mut snapshot);
        (trace, snapshot)
    };
    let first = follow_tip(&mut it);
    let mut other = model(coarse(), Layers::one(soft()));
    let read: Saved = serde_json::from_str(&text).unwrap();
    for it in [&mut it, &mut other] {
        it.restore(&read).unwrap();
        assert_eq!(format!("{:?}", it.save()), format!("{saved:?}"));
        assert_eq!(follow_tip(it), first);
    }
    // A state of another model, or a truncated one, changes nothing.
    let before = it.save();
    let mut foreign = model(Parameters::default(), Layers::one(soft()));
    assert!(matches!(it.restore(&foreign.save()), Err(StepError::Foreign(_))));
    let mut short = before.clone();
    short.0.as_object_mut().unwrap().remove("velocity");
    assert!(matches!(it.restore(&short), Err(StepError::Foreign(_))));
    assert_eq!(it.save(), before);
}

/// 10 mm and 50 mm a step: cut into substeps, and every layer of nodes is met.
#[test]
fn no_element_is_passed_unseen() {
    for steps in [1, 2, 8] {
        let mut it = model(coarse(), Layers::one(soft()));
        let (mut events, mut remeshes) = (Vec::new(), 0);
        it.step(&tip_at(0.3, 0.2, -5.0), 1e-3).unwrap();
        for step in 1..=steps {
            let outcome = it
                .step(&tip_at(0.3, 0.2, -5.0 + 80.0 * step as f64 / steps as f64), 0.1)
                .unwrap();
            assert!(outcome.converged);
            remeshes += outcome.remeshes;
            events.extend(outcome.events.iter().map(|event| event.kind));
        }
        // Layers lie 6.67 mm apart: eleven of them between the skin and 75 mm.
        assert!((10..=12).contains(&remeshes), "{steps}: {remeshes}");
        assert_eq!(it.outcome.contacts, remeshes + 1);
        assert_eq!(events, [EventKind::Skin, EventKind::Puncture]);
    }
}

/// The needle is turned about the skin and moved sideways in the tissue: shaft nodes are on it, and it feels a lateral
/// force.
#[test]
fn another_direction() {
    let mut it = model(coarse(), Layers::one(soft()));
    drive(&mut it, [-2.0, 40.0], 100.0, 1e-3, |_| {});
    let skin = Vector3::new(0.3, 0.2, 0.0);
    for step in 1..=100 {
        let turn = Isometry3::rotation(Vector3::x() * (0.2 * step as f64 / 100.0));
        let about = Translation3::from(skin) * turn * Translation3::from(-skin);
        let mut instruments = tip_at(0.3, 0.2, 40.0);
        instruments.base = about * instruments.base;
        it.step(&instruments, 1e-2).unwrap();
        for contact in &it.contacts.stack {
            let place = it.network.now(contact.node);
            let on_shaft = it.body.line.at(contact.arc).point_mm.coords;
            assert!((on_shaft - place).norm() < 1e-9);
        }
    }
    // The shaft presses tissue towards -y: tissue and hand are pushed towards +y.
    assert!(it.outcome.on_hand.force_n.y > 0.05, "{:?}", it.outcome.on_hand);
    sane(&it, 12.0);
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
        it.step(&instruments, 1e-3).unwrap();
    }
    assert!(
        it.outcome.contacts >= 7 && it.outcome.events.is_empty(),
        "{:?}",
        it.outcome
    );
    sane(&it, 15.0);
}

/// At rest with the needle in it, the force of the tissue on the needle equals that on its fixed surface.
#[test]
fn what_the_hand_feels_is_what_holds_the_tissue() {
    let mut it = model(coarse(), Layers::one(soft()));
    drive(&mut it, [-2.0, 40.0], 100.0, 1e-3, |_| {});
    let mut instruments = tip_at(1.3, 0.2, 40.0);
    (0..40).for_each(|_| assert!(it.step(&instruments, 0.1).is_ok()));
    instruments.deposit = true;
    let outcome = it.step(&instruments, 0.1).unwrap().clone();
    it.network.find_forces();
    let held = (0..it.network.mass.len()).filter(|&node| it.network.fixed[node]);
    let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
    let base = instruments.base.translation.vector;
    for node in held {
        force += it.network.force[node];
        torque += (it.network.reference[node] - base).cross(&it.network.force[node]);
    }
    assert!(outcome.on_hand.force_n.norm() > 0.1);
    assert!(
        (outcome.on_hand.force_n + force).norm() < 1e-6,
        "{:?} {force:?}",
        outcome.on_hand
    );
    assert_eq!(outcome.events.len(), 1);
    assert_eq!(it.body.seeds.len(), 1);
}
