//! Hard cases: places, step lengths, materials, bone.

use insonify::mechanics::insertion::{Bone, EventKind, Instruments, Interaction, Model, StepError};
use insonify::mechanics::mesh::TetMesh;
use insonify::mechanics::tissue::material::Material;

use super::support::{
    USUAL, assert_finite, block, build, events, go, kinds, on_table, resistance, setup, tip_at, travel,
};

/// The tip runs through vertices, along edges and within faces of the lattice.
#[test]
fn paths_through_vertices_edges_and_faces() {
    for aside in [[30.0, 30.0], [30.0, 28.9], [31.3, 31.3], [35.0, 30.0], [30.0, 25.0]] {
        let mut finite = build(setup(USUAL));
        let mut most = 0;
        for step in 0..=110 {
            let instruments = tip_at([aside[0], aside[1], 0.5 * f64::from(step) - 2.0]);
            let outcome = finite.step(&instruments, 1e-3).expect("a step").clone();
            assert_finite(&outcome);
            assert!(outcome.converged, "{aside:?}: {outcome:?}");
            most = most.max(outcome.contacts);
        }
        let last = finite.outcome();
        assert!(most >= 4 && last.inserted_mm > 40.0, "{aside:?}: {last:?}");
        let again = {
            let mut finite = build(setup(USUAL));
            for step in 0..=110 {
                let instruments = tip_at([aside[0], aside[1], 0.5 * f64::from(step) - 2.0]);
                finite.step(&instruments, 1e-3).expect("a step");
            }
            finite.outcome().clone()
        };
        assert_eq!(&again, last, "the same every time");
    }
}

/// However far a step goes, it sees what lies in between: the base moved 45 mm at once ends as 450 small steps do.
#[test]
fn one_long_step_is_many_short_ones() {
    let mut long = build(setup(USUAL));
    go(&mut long, -2.0);
    let outcome = go(&mut long, 43.0);
    assert!(outcome.substeps >= 90);
    let found: Vec<_> = outcome.events.iter().map(|event| event.kind).collect();
    assert!(found.starts_with(&[EventKind::Skin, EventKind::Puncture]), "{found:?}");
    let mut short = build(setup(USUAL));
    let last = travel(&mut short, -2.0, 43.0, 0.1).pop().expect("steps");
    // Where nodes are made depends on where parts end: the forces agree to the share of a force that one takes over.
    assert!(
        (resistance(&outcome) - resistance(&last)).abs() < 0.25,
        "{outcome:?} {last:?}"
    );
    assert!((outcome.inserted_mm - last.inserted_mm).abs() < 2.0);
}

/// From 0.1 kPa to 1 MPa.
#[test]
fn soft_and_hard_tissue() {
    for young in [0.1, 10.0, 1000.0] {
        let mut setup = setup(USUAL);
        setup.materials.fill(Material::new(young, 0.45).expect("a material"));
        let mut finite = build(setup);
        let outcomes = travel(&mut finite, -1.0, 60.0, 0.5);
        outcomes.iter().for_each(assert_finite);
        let unsettled = outcomes.iter().filter(|it| !it.converged).count();
        let told = kinds(&outcomes)
            .iter()
            .filter(|kind| **kind == EventKind::NotConverged)
            .count();
        assert_eq!(unsettled, told);
        assert!(unsettled == 0 || young < 1.0, "{young} kPa: {unsettled}");
        // Very soft tissue is pushed ahead rather than pierced; hard tissue yields nothing.
        if young >= 10.0 {
            let last = outcomes.last().expect("steps");
            assert!(
                (resistance(last) - 0.02 * last.inserted_mm - 0.5).abs() < 0.5,
                "{last:?}"
            );
        }
    }
}

/// Two layers; the path runs along their border, or through it.
#[test]
fn regions_are_met_and_their_surfaces_hold() {
    let mesh = block([60.0, 60.0, 80.0], 10.0);
    let middle = |element: &[u32; 4]| element.iter().map(|node| mesh.nodes()[*node as usize][2]).sum::<f64>() / 4.0;
    let regions = mesh
        .elements()
        .iter()
        .map(|element| if middle(element) < 30.0 { 1 } else { 2 })
        .collect();
    let layered = TetMesh::new(mesh.nodes().to_vec(), mesh.elements().to_vec(), regions).expect("a mesh");
    let mut setup = on_table(layered, USUAL);
    let deep = Interaction {
        friction_n_per_mm: 0.05,
        cutting_n: 0.3,
        puncture_n: 1.2,
        ..USUAL
    };
    setup.interactions = vec![(1, USUAL), (2, deep)];
    let mut finite = build(setup);
    let outcomes = travel(&mut finite, -1.0, 70.0, 0.2);
    let found: Vec<_> = events(&outcomes)
        .iter()
        .map(|event| (event.kind, event.region))
        .collect();
    let expected = [
        (EventKind::Skin, Some(1)),
        (EventKind::Puncture, Some(1)),
        (EventKind::Region, Some(2)),
        (EventKind::Puncture, Some(2)),
    ];
    assert_eq!(found[..4], expected, "{found:?}");
    // Different slopes in the two layers.
    let slope = |from: f64, to: f64| {
        let sliding: Vec<_> = outcomes
            .iter()
            .filter(|it| it.stuck == 0 && it.inserted_mm > from && it.inserted_mm < to)
            .collect();
        let mean = |of: &dyn Fn(&insonify::mechanics::insertion::Outcome) -> f64| {
            sliding.iter().map(|it| of(it)).sum::<f64>() / sliding.len() as f64
        };
        let (x, y) = (mean(&|it| it.inserted_mm), mean(&resistance));
        let both: f64 = sliding
            .iter()
            .map(|it| (it.inserted_mm - x) * (resistance(it) - y))
            .sum();
        both / sliding.iter().map(|it| (it.inserted_mm - x).powi(2)).sum::<f64>()
    };
    let deep = slope(40.0, 65.0);
    assert!((deep - 0.05).abs() < 0.02, "{deep} N/mm");
}

/// Bone, met at 1 mm and at 10 mm a step: a finite force that grows with depth, and no deeper than stated.
#[test]
fn bone_stops_the_tip() {
    for step in [1.0, 10.0] {
        let mesh = block([60.0, 60.0, 80.0], 10.0);
        let middle = |element: &[u32; 4]| element.iter().map(|node| mesh.nodes()[*node as usize][2]).sum::<f64>() / 4.0;
        let regions = mesh
            .elements()
            .iter()
            .map(|element| if middle(element) < 50.0 { 1 } else { 9 })
            .collect();
        let mesh = TetMesh::new(mesh.nodes().to_vec(), mesh.elements().to_vec(), regions).expect("a mesh");
        let rigid = (0..mesh.nodes().len() as u32).filter(|node| mesh.nodes()[*node as usize][2] >= 50.0);
        let mut setup = on_table(mesh.clone(), USUAL);
        setup.fixed = rigid.flat_map(|node| [0, 1, 2].map(|axis| (node, axis))).collect();
        let bone = Bone {
            stiffness_n_per_mm: 10.0,
            penetration_mm: 0.3,
        };
        setup.interactions = vec![
            (1, USUAL),
            (
                9,
                Interaction {
                    bone: Some(bone),
                    ..Interaction::default()
                },
            ),
        ];
        let mut finite = build(setup);
        let outcomes = travel(&mut finite, -1.0, 59.0, step);
        outcomes.iter().for_each(assert_finite);
        let hits: Vec<_> = events(&outcomes)
            .into_iter()
            .filter(|event| event.kind == EventKind::Bone)
            .collect();
        assert_eq!(hits.len(), 1);
        // Met within one part of a step of its surface.
        assert!((hits[0].at_mm.z - 50.0).abs() <= 0.5 + 1e-9, "{hits:?}");
        let deepest = outcomes.iter().map(|it| it.tip_mm.z).fold(0.0, f64::max);
        assert!(deepest <= hits[0].at_mm.z + 0.3 + 1e-9, "{deepest}");
        // The hand is 59 - 50 mm too far.
        let last = outcomes.last().expect("steps");
        let friction = 0.02 * last.inserted_mm + 0.5;
        let expected = 10.0 * (59.0 - hits[0].at_mm.z);
        assert!((resistance(last) - expected).abs() <= friction, "{last:?}");
        let out = travel(&mut finite, 59.0, -3.0, step);
        assert_eq!(kinds(&out).last(), Some(&EventKind::Out));
        assert_eq!(out.last().map(|it| it.on_hand.force_n.norm()), Some(0.0));
    }
}

/// Values that no step can take are refused, and nothing has changed.
#[test]
fn steps_with_numbers_that_are_none_are_refused() {
    let mut finite = build(setup(USUAL));
    travel(&mut finite, -1.0, 20.0, 0.5);
    let before = finite.save();
    let good = tip_at([31.3, 28.9, 21.0]);
    let mut lost = good;
    lost.base.translation.vector.x = f64::NAN;
    let mut far = good;
    far.guide = Some(nalgebra::Point3::new(0.0, f64::INFINITY, 0.0));
    let probe = Instruments {
        probe: Some(lost.base),
        ..good
    };
    for (instruments, dt) in [
        (lost, 1e-3),
        (far, 1e-3),
        (probe, 1e-3),
        (good, 0.0),
        (good, f64::NAN),
        (good, -1.0),
    ] {
        let refused = finite.step(&instruments, dt).map(drop);
        assert!(matches!(refused, Err(StepError::Input { .. })), "{refused:?}");
    }
    assert_eq!(finite.save(), before);
}

/// The needle leaves the block on its far side and comes back.
#[test]
fn through_and_through() {
    let mesh = block([60.0, 60.0, 30.0], 10.0);
    let mut setup = on_table(
        mesh.clone(),
        Interaction {
            puncture_n: 0.0,
            ..USUAL
        },
    );
    let side = (0..mesh.nodes().len() as u32).filter(|node| mesh.nodes()[*node as usize][0] == 0.0);
    setup.fixed = side.flat_map(|node| [0, 1, 2].map(|axis| (node, axis))).collect();
    let mut finite = build(setup);
    let inward = travel(&mut finite, -2.0, 60.0, 0.25);
    inward.iter().for_each(assert_finite);
    let last = inward.last().expect("steps");
    assert!(last.inserted_mm > 40.0 && last.contacts >= 2);
    let out = travel(&mut finite, 60.0, -20.0, 0.25);
    out.iter().for_each(assert_finite);
    assert_eq!(finite.held(), 0);
    assert_eq!(out.last().map(|it| it.on_hand.force_n.norm()), Some(0.0));
}
