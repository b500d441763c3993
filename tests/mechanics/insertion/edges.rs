//! Hard cases: places, step lengths, materials, bone.

use std::sync::Arc;

use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::insertion::spring::{MassSpring, MassSpringParameters};
use insonify_mechanics::insertion::{
    EventKind, Instruments, Interaction, InvalidSetup, MeshRegions, Model, Outcome, StepError,
};
use insonify_mechanics::needle::{CentreLine, Entry, Load, Needle};
use insonify_mesh::TetMesh;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::support::{LENGTH, USUAL, assert_finite, block, build, events, on_table, resistance, setup, tip_at, travel};

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
        let mean = |of: &dyn Fn(&insonify_mechanics::insertion::Outcome) -> f64| {
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
    // A rotation of which a host has kept the scale, and a place beyond a kilometre.
    let (mut scaled, mut distant) = (good, good);
    let quaternion = good.base.rotation.into_inner() * 1.01;
    scaled.base.rotation = UnitQuaternion::new_unchecked(quaternion);
    distant.base.translation.vector.x = 1.1e6;
    let probe = Instruments {
        probe: Some(scaled.base),
        ..good
    };
    for (instruments, reason) in [
        (
            scaled,
            "the pose of the needle's base: the axes are off a rotation by 2.01e-2",
        ),
        (distant, "farther than 1e6 mm"),
        (probe, "the pose of the probe: the axes are off"),
    ] {
        let refused = finite.step(&instruments, 1e-3).map(drop).expect_err(reason);
        assert!(matches!(refused, StepError::Pose { .. }), "{refused}");
        assert!(refused.to_string().contains(reason), "{refused}");
    }
    assert_eq!(finite.save(), before);
}

/// A matrix of a host is checked as one of a file is.
#[test]
fn needles_by_matrix_are_checked() {
    let base = tip_at([31.3, 28.9, 21.0]).base * Isometry3::rotation(Vector3::new(0.1, -0.4, 1.0));
    let good = base.to_homogeneous();
    let taken = Instruments::from_matrix(&good).expect("rigid");
    assert!((taken.base.to_homogeneous() - good).amax() < 1e-12 && taken.probe.is_none());
    let mut noisy = good;
    noisy[(0, 1)] += 3e-3;
    assert!(Instruments::from_matrix(&noisy).is_ok());
    noisy[(0, 1)] += 9e-3;
    let mirror = nalgebra::Matrix4::new_nonuniform_scaling(&Vector3::new(-1.0, 1.0, 1.0));
    let scale = nalgebra::Matrix4::new_scaling(0.1);
    for (matrix, reason) in [
        (noisy, "off a rotation"),
        (mirror * good, "left-handed"),
        (scale * good, "a scale"),
        (good.transpose(), "row-major?"),
    ] {
        let refused = Instruments::from_matrix(&matrix).expect_err(reason).to_string();
        assert!(
            refused.contains("the needle's base: ") && refused.contains(reason),
            "{refused}"
        );
    }
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
    assert!((last.inserted_mm - 30.0).abs() < 1.0 && last.contacts >= 2, "{last:?}");
    let out_of = |steps: &[Outcome]| {
        events(steps)
            .iter()
            .filter(|event| event.kind == EventKind::Out)
            .count()
    };
    assert_eq!(out_of(&inward), 1, "told where it comes out");
    // Only the shaft within the 30 mm of tissue, which it drags along a little, rubs.
    let [near, far] = [inward.len() - 60, inward.len() - 1].map(|at| resistance(&inward[at]));
    assert!(
        (far - near).abs() < 0.02 * far && (far / 0.6 - 1.0).abs() < 0.15,
        "{near} {far}"
    );
    let out = travel(&mut finite, 60.0, -20.0, 0.25);
    out.iter().for_each(assert_finite);
    assert_eq!((finite.support_size(), out_of(&out)), (0, 1));
    assert_eq!(out.last().map(|it| it.on_hand.force_n.norm()), Some(0.0));
}

/// A needle whose centre line does not end at its length.
#[derive(Debug)]
struct Short;

impl Needle for Short {
    fn length_mm(&self) -> f64 {
        LENGTH
    }
    fn radius_mm(&self) -> f64 {
        0.6
    }
    fn place(&mut self, base: &Isometry3<f64>, _: Option<&Entry>, _: &[Load], _: &[Load], line: &mut CentreLine) {
        line.set([0.0, LENGTH / 2.0].map(|arc_mm| (arc_mm, base * Point3::new(0.0, 0.0, arc_mm))));
    }
}

/// What cannot be meant is refused before anything is computed.
#[test]
fn setups_that_cannot_be_meant_are_refused() {
    type Spoil = fn(&mut Setup);
    let spoils: [(&str, Spoil); 5] = [
        ("region 0 has more than one interaction", |setup| {
            setup.interactions.push((0, USUAL));
        }),
        ("listed are [7], the mesh has [0]", |setup| setup.interactions[0].0 = 7),
        ("the mesh is 0.08 mm long at most", |setup| {
            let nodes = setup.mesh.nodes().iter().map(|node| node.map(|length| length / 1000.0));
            let in_metres = TetMesh::new(
                nodes.collect(),
                setup.mesh.elements().to_vec(),
                setup.mesh.regions().to_vec(),
            );
            setup.mesh = in_metres.expect("a mesh");
        }),
        (
            "`last arc of the needle's centre line` is 75; expected its length, 150 mm",
            |setup| {
                setup.needle = Box::new(Short);
            },
        ),
        ("friction_n_per_mm", |setup| {
            setup.interactions[0].1.friction_n_per_mm = -1.0
        }),
    ];
    for (reason, spoil) in spoils {
        let mut setup = setup(USUAL);
        spoil(&mut setup);
        let error = Finite::new(setup, |_, _| {}).err().expect(reason).to_string();
        assert!(error.contains(reason), "{error}");
    }
    let parameters = MassSpringParameters::default();
    let mesh = Arc::new(block([60.0, 60.0, 80.0], 10.0));
    let regions = MeshRegions::new(&mesh, &[(0, USUAL)]).expect("regions");
    let refused = MassSpring::new(parameters, Box::new(regions), Box::new(Short));
    assert!(matches!(refused, Err(InvalidSetup::Number(_))), "{refused:?}");
    let twice = MeshRegions::new(&mesh, &[(0, USUAL), (0, USUAL)]);
    assert!(matches!(twice, Err(InvalidSetup::Twice { region: 0 })), "{twice:?}");
}
