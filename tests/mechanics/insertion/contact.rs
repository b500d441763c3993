//! Friction, cutting and what they leave behind.

use insonify_mechanics::insertion::{EventKind, Interaction, Model, Peak, Snapshot, StepError, Tissue};
use insonify_mechanics::needle::{Rigid, Shaft};
use insonify_mechanics::tissue::material::Material;
use serde_json::json;

use super::support::{
    LENGTH, USUAL, block, build, events, kinds, on_path, on_table, resistance, setup, tip_at, travel,
};

/// Once everything slips, the hand feels the friction of the embedded length and the force of cutting; on the way out
/// only the friction, the other way (Goksel et al. 2011, figures 4 and 13b).
#[test]
fn the_hand_feels_friction_and_cutting() {
    let mut finite = build(setup(USUAL));
    let inward = travel(&mut finite, -2.0, 50.0, 0.1);
    assert!(inward.iter().all(|outcome| outcome.converged));
    let last = inward.last().expect("steps");
    assert_eq!(last.stuck, 0);
    let expected = 0.02 * last.inserted_mm + 0.5;
    // While a new node takes the force of cutting over, the hand feels less: by no more than that force.
    assert!(
        resistance(last) <= expected + 1e-6 && resistance(last) > expected - 0.5,
        "{last:?}"
    );
    let full = inward
        .iter()
        .filter(|it| (resistance(it) - 0.02 * it.inserted_mm - 0.5).abs() < 1e-4)
        .count();
    assert!(
        full > inward.len() / 4,
        "{full} of {} steps slip all over",
        inward.len()
    );

    let outward = travel(&mut finite, 50.0, 20.0, 0.1);
    let last = outward.last().expect("steps");
    assert_eq!(last.stuck, 0);
    assert!((resistance(last) + 0.02 * last.inserted_mm).abs() < 1e-4, "{last:?}");
    // The sign has changed, and nothing is cut on the way out.
    assert!(outward.iter().all(|it| resistance(it) > -0.02 * it.inserted_mm - 1e-4));
}

/// The skin holds until the puncture force is reached; the tissue is dented meanwhile.
#[test]
fn skin_is_pushed_in_before_it_breaks() {
    let mut finite = build(setup(USUAL));
    let steps = travel(&mut finite, -1.0, 40.0, 0.1);
    let found = kinds(&steps);
    assert_eq!(found[..2], [EventKind::Skin, EventKind::Puncture]);
    let broken = steps
        .iter()
        .position(|it| it.events.iter().any(|event| event.kind == EventKind::Puncture));
    let before = &steps[broken.expect("a puncture") - 1];
    // The last step before: nearly the whole of it, one step's rise short.
    assert!(resistance(before) <= 1.0 && resistance(before) > 0.98, "{before:?}");
    assert!(before.inserted_mm < 0.2, "{before:?}");
    let skin = events(&steps)[0].at_mm;
    assert!((skin - on_path(0.0)).norm() < 1e-9, "{skin:?}");
    // Without a puncture force there is nothing to break.
    let mut soft = build(setup(Interaction {
        puncture_n: 0.0,
        ..USUAL
    }));
    assert!(!kinds(&travel(&mut soft, -1.0, 20.0, 0.2)).contains(&EventKind::Puncture));
}

/// The three-parameter density (Dehghan et al. 2008): near the advancing tip another force for each length.
#[test]
fn a_peak_replaces_the_friction_near_the_tip() {
    let peak = Peak {
        density_n_per_mm: 0.05,
        width_mm: 12.0,
    };
    let with = Interaction {
        peak: Some(peak),
        cutting_n: 0.0,
        puncture_n: 0.0,
        ..USUAL
    };
    let mut finite = build(setup(with));
    let last = travel(&mut finite, -1.0, 50.0, 0.1).pop().expect("steps");
    assert_eq!(last.stuck, 0);
    assert!(
        (resistance(&last) - 0.02 * (last.inserted_mm - 12.0) - 0.05 * 12.0).abs() < 1e-4,
        "{last:?}"
    );
}

/// Nodes on the needle lie on it, the tissue between follows, and nothing is left when it is out.
#[test]
fn the_image_gets_tissue_that_lies_on_the_needle_and_comes_back() {
    let mut finite = build(setup(USUAL));
    let rest = finite.mesh().nodes().to_vec();
    let mut imager = finite.imager();
    let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
    travel(&mut finite, -1.0, 50.0, 0.25);
    finite.snapshot(&mut snapshot);
    imager.tissue(&snapshot, &mut tissue);
    let contacts: Vec<_> = finite.contact_forces().collect();
    assert!(contacts.len() >= 4);
    for (node, arc, _) in &contacts {
        let place = tissue.current[*node as usize];
        let shaft = snapshot.line.point_at_arc(*arc);
        let beside = nalgebra::Point3::from(place) - shaft.point_mm;
        let along_mm = beside.dot(&shaft.tangent);
        // After changes of the mesh nodes approach the shaft. Near the tip they go with the dent that the mesh lacks.
        assert!(
            (beside - shaft.tangent.into_inner() * along_mm).norm() < 0.1 && (-0.1..1.0).contains(&along_mm),
            "node {node}: {place:?} {shaft:?}"
        );
        assert_ne!(tissue.reference[*node as usize], rest[*node as usize]);
    }
    assert_eq!(tissue.inverted, 0);
    // The tissue is carried along with the needle, more near it than far from it.
    let drag = |at: [f64; 3]| {
        let nearest = |a: &usize, b: &usize| {
            let distance = |n: usize| (0..3).map(|k| (rest[n][k] - at[k]).powi(2)).sum::<f64>();
            distance(*a).total_cmp(&distance(*b))
        };
        let node = (0..rest.len()).min_by(nearest).expect("nodes");
        tissue.current[node][2] - tissue.reference[node][2]
    };
    assert!(drag([30.0, 30.0, 40.0]) > 2.0 * drag([0.0, 0.0, 40.0]) && drag([30.0, 30.0, 40.0]) > 0.5);

    let out = travel(&mut finite, 50.0, -3.0, 0.25);
    assert_eq!(kinds(&out).last(), Some(&EventKind::Out));
    finite.snapshot(&mut snapshot);
    imager.tissue(&snapshot, &mut tissue);
    assert_eq!((&tissue.reference, &tissue.current), (&rest, &rest));
    assert_eq!(finite.support_size(), 0);
}

/// dt is of no matter to tissue without inertia or memory.
#[test]
fn the_length_of_a_step_in_time_does_not_matter() {
    let run = |dt: f64| {
        let mut finite = build(setup(USUAL));
        let mut forces = Vec::new();
        for step in 0..60 {
            let instruments = super::support::tip_at([31.3, 28.9, 0.4 * step as f64 - 1.0]);
            forces.push(finite.step(&instruments, dt).expect("a step").on_hand);
        }
        forces
    };
    let expected = run(1e-3);
    assert_eq!(run(1e-5), expected);
    assert_eq!(run(0.1), expected);
}

/// A state that was saved goes on as if nothing had happened, also in another model, also through text.
#[test]
fn saved_states_go_on_bit_for_bit() {
    let mut finite = build(setup(Interaction {
        static_ratio: 1.3,
        ..USUAL
    }));
    travel(&mut finite, -1.0, 30.0, 0.25);
    let saved = finite.save();
    let onward = |finite: &mut _| {
        let mut outcomes = travel(finite, 30.0, 42.0, 0.25);
        outcomes.extend(travel(finite, 42.0, 20.0, 0.25));
        outcomes
    };
    let expected = onward(&mut finite);
    finite.restore(&saved).expect("its own state");
    assert_eq!(onward(&mut finite), expected);

    let text = serde_json::to_string(&saved).expect("text");
    let mut other = build(setup(Interaction {
        static_ratio: 1.3,
        ..USUAL
    }));
    other
        .restore(&serde_json::from_str(&text).expect("a state"))
        .expect("a state of such a model");
    // Its columns were solved in another order, which may change their last bits.
    for (a, b) in onward(&mut other).iter().zip(&expected) {
        assert!((a.on_hand.force_n - b.on_hand.force_n).norm() < 1e-7, "{a:?} {b:?}");
    }
    let mesh = super::support::block([20.0, 20.0, 20.0], 10.0);
    let mut small = build(super::support::on_table(mesh, USUAL));
    let before = small.save();
    assert!(small.restore(&saved).is_err());
    assert_eq!(small.save(), before);
}

/// States that cannot be one of this model are refused, and it goes on as if nobody had asked.
#[test]
fn foreign_states_are_refused_and_nothing_has_changed() {
    let mut finite = build(setup(USUAL));
    travel(&mut finite, -1.0, 30.0, 0.25);
    let good = finite.save();
    let held = finite
        .mesh()
        .nodes()
        .iter()
        .position(|node| node[2] == 80.0)
        .expect("a node");
    travel(&mut finite, 30.0, 12.0, 0.25);
    let before = finite.save();
    let expected = travel(&mut finite, 12.0, 15.0, 0.25);
    for (place, value) in [
        ("/contacts/0/node", json!(100_000)),
        ("/contacts/0/node", json!(held)),
        ("/contacts/1/node", good.0["contacts"][0]["node"].clone()),
        ("/tip/corners", json!([100_000])),
        ("/tip/element", json!(100_000)),
        ("/forces", json!([])),
        ("/moved/0/0", json!(100_000)),
        ("/moved/0/1", json!([1e3, 1e3, 1e3])),
        ("/entry", json!(null)),
        ("/entry/1", json!([0.0, 0.0, 2.0])),
        ("/line/nodes", json!([])),
        ("/probe", json!([null, [true]])),
    ] {
        finite.restore(&before).expect("its own state");
        let mut spoilt = good.clone();
        *spoilt.0.pointer_mut(place).expect(place) = value;
        let refused = finite.restore(&spoilt);
        assert!(matches!(refused, Err(StepError::Foreign(_))), "{place}: {refused:?}");
        assert_eq!(finite.save(), before, "{place}");
        assert_eq!(travel(&mut finite, 12.0, 15.0, 0.25), expected, "{place}");
    }

    // States of the same mesh with another needle or other moduli.
    let thick = Shaft {
        radius_mm: 0.9,
        length_mm: LENGTH,
    };
    let mut other_needle = setup(USUAL);
    other_needle.needle = Box::new(Rigid::new(thick, None).expect("a needle"));
    let mut other_moduli = setup(USUAL);
    other_moduli
        .materials
        .fill(Material::new(12.0, 0.45).expect("a material"));
    let mut other_friction = setup(USUAL);
    other_friction.interactions[0].1.friction_n_per_mm *= 2.0;
    for (other, named) in [
        (other_needle, "its needle"),
        (other_moduli, "its tissue"),
        (other_friction, "its tissue"),
    ] {
        let refused = build(other).restore(&good);
        assert!(
            matches!(&refused, Err(StepError::Foreign(reason)) if reason.starts_with(named)),
            "{refused:?}"
        );
    }

    // Moves that only the compliance refuses are taken back.
    let mut picky = setup(USUAL);
    picky.options.remesh.reciprocal_limit = 0.9;
    let mut picky = build(picky);
    let before = picky.save();
    assert!(picky.restore(&good).is_err());
    assert_eq!(picky.save(), before);
}

/// A stiff skin is pushed in far and springs back when it breaks, and lets go of nodes near the tip. Each node is made
/// once on the way in, and comes off once on the way out.
#[test]
fn nodes_are_made_once_and_come_off_once() {
    let mut finite = build(on_table(block([60.0, 60.0, 80.0], 5.0), USUAL));
    let (mut most, mut remeshes, mut step) = (0, 0, 0.0f64);
    while step < 2.0 * 42.0 {
        step += 0.05;
        let z = -2.0 + step.min(84.0 - step);
        let outcome = finite.step(&tip_at([31.3, 20.9, z]), 1e-3).expect("a step");
        most = most.max(outcome.contacts);
        remeshes += outcome.remeshes;
    }
    assert_eq!(finite.outcome().contacts, 0);
    assert!(most >= 5, "{most} nodes");
    // The skin may let the first one go.
    assert!(remeshes <= 2 * (most + 1), "{remeshes} remeshes for {most} nodes");
}
