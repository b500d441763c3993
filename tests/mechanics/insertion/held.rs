//! Bone and held tissue: what the needle meets where no node of the mesh can be moved to it.

use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::insertion::{Bone, EventKind, Interaction, Model};
use insonify_mesh::TetMesh;

use super::support::{USUAL, assert_finite, block, build, go, kinds, on_table, resistance, setup, travel};

const BONE: Bone = Bone {
    stiffness_n_per_mm: 40.0,
    penetration_mm: 0.5,
};

/// A block of 60 x 60 x 80 mm whose elements within a range of depths are region 1, with its nodes held.
fn layered([from, to]: [f64; 2], of: Interaction) -> Setup {
    let plain = block([60.0, 60.0, 80.0], 10.0);
    let (nodes, elements) = (plain.nodes().to_vec(), plain.elements().to_vec());
    let within = |z: f64| (from..=to).contains(&z);
    let regions = elements
        .iter()
        .map(|corners| i32::from(corners.iter().all(|node| within(nodes[*node as usize][2]))))
        .collect();
    let held = (0..).zip(&nodes).filter(|(_, p)| within(p[2]) || p[2] == 80.0);
    let fixed = held.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect();
    let mesh = TetMesh::new(nodes.clone(), elements, regions).expect("a mesh");
    let mut setup = on_table(mesh, USUAL);
    setup.fixed = fixed;
    setup.interactions.push((1, of));
    setup
}

fn bony(range: [f64; 2]) -> Finite {
    build(layered(
        range,
        Interaction {
            bone: Some(BONE),
            ..Interaction::default()
        },
    ))
}

/// Bone that is the first thing the needle meets stops it at its surface, with the force of its limit, until it is
/// drawn back.
#[test]
fn bone_at_the_surface_stops_the_needle() {
    for step in [0.2, 1.0, 10.0] {
        let mut finite = bony([0.0, 20.0]);
        for _ in 0..2 {
            let inward = travel(&mut finite, -1.0, 25.0, step);
            inward.iter().for_each(assert_finite);
            assert_eq!(kinds(&inward), [EventKind::Skin, EventKind::Bone], "{step}");
            for outcome in &inward {
                let hand = outcome.tip_mm.z.max(0.0);
                assert!(hand <= BONE.penetration_mm + 1e-9, "{step}: {outcome:?}");
            }
            let last = inward.last().expect("steps");
            let limit = BONE.stiffness_n_per_mm * BONE.penetration_mm;
            assert!((resistance(last) - limit).abs() < 1e-9, "{last:?}");
            assert!((last.inserted_mm - 0.5).abs() < 1e-9 && last.contacts == 0, "{last:?}");
            assert!(last.tip_deflection_mm < 1e-9, "{last:?}");
            // Saved there, it goes on as it is.
            let saved = finite.save();
            let deeper = go(&mut finite, 26.0);
            finite.restore(&saved).expect("its own state");
            assert_eq!(go(&mut finite, 26.0), deeper);
            let outward = travel(&mut finite, 26.0, -1.0, step);
            assert_eq!(kinds(&outward), [EventKind::Out], "{step}");
            let last = outward.last().expect("steps");
            assert_eq!((last.on_hand.force_n.norm(), last.inserted_mm), (0.0, 0.0));
        }
    }
}

/// Bone within is met at its surface, however long the steps are, and the tip is at once where it holds it.
#[test]
fn bone_within_is_met_at_its_surface() {
    for step in [0.3, 1.0, 10.0] {
        let mut finite = bony([50.0, 70.0]);
        let inward = travel(&mut finite, -1.0, 59.0, step);
        let met: Vec<f64> = inward
            .iter()
            .flat_map(|outcome| &outcome.events)
            .filter(|event| event.kind == EventKind::Bone)
            .map(|event| event.at_mm.z)
            .collect();
        assert!(met.len() == 1 && (met[0] - 50.0).abs() < 1e-9, "{step}: {met:?}");
        let deepest = inward.iter().map(|outcome| outcome.tip_mm.z).fold(0.0, f64::max);
        assert!(deepest <= 50.5 + 1e-9, "{step}: {deepest}");
        let last = inward.last().expect("steps");
        let friction = USUAL.friction_n_per_mm * last.inserted_mm + USUAL.cutting_n;
        assert!((resistance(last) - 20.0).abs() < friction, "{step}: {last:?}");
    }
}

/// Held tissue that is no bone lets the needle through: it is in tissue, and that no node can be made is told once.
#[test]
fn held_tissue_is_told_once() {
    let mut finite = build(layered([0.0, 80.0], USUAL));
    let inward = travel(&mut finite, -1.0, 25.0, 0.2);
    let kinds_met = [EventKind::Skin, EventKind::NotRemeshed, EventKind::Puncture];
    assert_eq!(kinds(&inward), kinds_met);
    let mut is_in = false;
    for outcome in &inward {
        assert_finite(outcome);
        is_in |= outcome.events.iter().any(|event| event.kind == EventKind::Puncture);
        let depth = if is_in { outcome.tip_mm.z } else { 0.0 };
        assert!((outcome.inserted_mm - depth).abs() < 1e-9, "{outcome:?}");
    }
    let outward = travel(&mut finite, 25.0, -1.0, 0.2);
    assert_eq!(kinds(&outward), [EventKind::Out]);
}

/// Behind held tissue a node is made as soon as one can be, bone behind it is met, and the way out is the way in.
#[test]
fn held_tissue_before_soft_tissue() {
    let mut finite = build(layered([0.0, 20.0], Interaction::default()));
    let inward = travel(&mut finite, -1.0, 60.0, 0.5);
    let found = kinds(&inward);
    assert_eq!(
        found[..3],
        [EventKind::Skin, EventKind::NotRemeshed, EventKind::Region],
        "{found:?}"
    );
    let last = inward.last().expect("steps");
    assert!(last.contacts > 1 && (last.inserted_mm - 60.0).abs() < 1e-9, "{last:?}");
    let outward = travel(&mut finite, 60.0, -1.0, 0.5);
    outward.iter().for_each(assert_finite);
    assert_eq!(kinds(&outward).last(), Some(&EventKind::Out));
    let last = outward.last().expect("steps");
    assert_eq!(
        (last.on_hand.force_n.norm(), last.inserted_mm, finite.support_size()),
        (0.0, 0.0, 0)
    );
}

/// A needle that begins before the tissue and is behind it after its first step has gone through it.
#[test]
fn the_first_step_is_travelled() {
    let through = |started: bool| {
        let mut finite = build(setup(USUAL));
        if started {
            finite.start(&super::support::tip_at([31.3, 28.9, -20.0]));
        } else {
            go(&mut finite, -20.0);
        }
        go(&mut finite, 90.0)
    };
    let found = through(true);
    assert!(found.contacts > 3 && found.inserted_mm > 75.0, "{found:?}");
    let other = through(false);
    assert_eq!((found.on_hand, found.remeshes), (other.on_hand, other.remeshes));
    // One that begins in the tissue has been pushed in before.
    let begin = |started: bool| {
        let mut finite = build(setup(USUAL));
        if started {
            finite.start(&super::support::tip_at([31.3, 28.9, 19.0]));
        }
        go(&mut finite, 20.0)
    };
    assert_eq!(begin(true), begin(false));
}
