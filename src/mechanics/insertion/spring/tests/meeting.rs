//! Skin, layers and bone.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::super::testing::*;
use super::super::*;
use crate::insertion::{Bone, Interaction, Tissue};

fn events(springs: &mut MassSpring, way: [f64; 2], speed: f64) -> Vec<(EventKind, f64, Option<i32>)> {
    let mut events = Vec::new();
    drive(springs, way, speed, 1e-3, |outcome| {
        events.extend(
            outcome
                .events
                .iter()
                .map(|event| (event.kind, event.at_mm.z, event.region)),
        );
    });
    events
}

/// The skin is pushed in until its puncture force is reached; then less is enough.
#[test]
fn the_skin_breaks_at_its_force() {
    let skin = Interaction {
        puncture_n: 0.2,
        cutting_n: 0.1,
        ..Interaction::default()
    };
    let mut springs = model(MassSpringParameters::default(), Layers::one(skin));
    let mut largest_n = 0.0f64;
    let mut broken = None;
    drive(&mut springs, [-1.0, 8.0], 10.0, 1e-3, |outcome| {
        let force = -outcome.on_hand.force_n.z;
        if outcome.events.iter().any(|event| event.kind == EventKind::Puncture) {
            broken = Some((outcome.inserted_mm, force, outcome.tip_mm.z));
        }
        assert!(force <= if broken.is_none() { 0.2 } else { 0.2 + 1e-12 });
        largest_n = largest_n.max(force);
    });
    let (inserted, force, depth) = broken.unwrap();
    assert!(
        inserted < 0.5 && force >= 0.1 && depth > 1.0 && largest_n > 0.195,
        "{broken:?} {largest_n}"
    );
    assert!(-springs.outcome.on_hand.force_n.z <= 0.1 + 1e-12);
}

/// Two layers: the boundary is met where it is in the reference state, and the friction of each acts where its nodes
/// lie.
#[test]
fn layers_have_their_friction() {
    let sliding = |friction_n_per_mm| Interaction {
        friction_n_per_mm,
        ..Interaction::default()
    };
    let layers = Layers {
        starts_mm: vec![0.0, 25.0],
        interactions: vec![sliding(0.002), sliding(0.02)],
    };
    let mut springs = model(MassSpringParameters::default(), layers);
    let seen = events(&mut springs, [-1.0, 60.0], 20.0);
    let kinds: Vec<_> = seen.iter().map(|event| (event.0, event.2)).collect();
    assert_eq!(
        kinds,
        [
            (EventKind::Skin, Some(0)),
            (EventKind::Puncture, Some(0)),
            (EventKind::Region, Some(1)),
        ]
    );
    assert!(seen[2].1 >= 25.0 && seen[2].1 < 27.5, "{seen:?}");
    // Each length of the shaft has the friction of its own layer.
    let stack = springs.contacts.stack.iter();
    let places = stack.map(|contact| (contact.arc, springs.network.reference[contact.node as usize].z));
    let places: Vec<_> = places.chain([(150.0, 60.0)]).collect();
    let friction = |pair: &[(f64, f64)]| {
        let [(start_mm, above), (end_mm, below)] = [pair[0], pair[1]];
        let shallow = ((25.0 - above) / (below - above)).clamp(0.0, 1.0);
        (end_mm - start_mm) * (0.002 * shallow + 0.02 * (1.0 - shallow))
    };
    let whole: f64 = places.windows(2).map(friction).sum();
    let force = -springs.outcome.on_hand.force_n.z;
    assert!(
        force <= whole + 1e-3 && force > 0.9 * whole && whole > 0.5,
        "{force} {whole}"
    );
    // On withdrawal the sign changes.
    drive(&mut springs, [60.0, 50.0], 20.0, 1e-3, |_| {});
    assert!(springs.outcome.on_hand.force_n.z > 0.4);
}

/// Bone at 1 and at 10 mm a step: it is met where it lies in the body at rest, however the springs are pushed; the
/// depth of the tip is limited, the force is that of this depth, and everything is as before when the needle has been
/// withdrawn.
#[test]
fn bone_stops_the_tip() {
    let bone = Interaction {
        bone: Some(Bone {
            stiffness_n_per_mm: 4.0,
            penetration_mm: 0.5,
        }),
        ..Interaction::default()
    };
    for speed in [20.0, 1e3, 1e4] {
        let layers = Layers {
            starts_mm: vec![0.0, 30.0],
            interactions: vec![Interaction::default(), bone],
        };
        let mut springs = model(coarse(), layers);
        let seen = events(&mut springs, [-10.0, 50.0], speed);
        let (kind, depth, region) = *seen.last().unwrap();
        assert_eq!((kind, region), (EventKind::Bone, Some(1)));
        assert!((depth - 30.0).abs() < 1e-9, "{depth}");
        let tip = springs.outcome.tip_mm.z;
        assert!(
            tip <= depth + 0.5 + 1e-9 && springs.outcome.tip_deflection_mm < 1e-9,
            "{tip} {depth}"
        );
        (0..30).for_each(|_| assert!(springs.step(&tip_at(0.3, 0.2, 50.0), 0.1).is_ok()));
        // The hand is 20 mm too far: 4 N/mm times the largest depth of the tip.
        let force = springs.outcome.on_hand.force_n.z;
        assert!((force + 2.0).abs() < 1e-9, "{force}");
        let seen = events(&mut springs, [50.0, 20.0], speed);
        assert!(seen.iter().all(|event| event.0 == EventKind::Region), "{seen:?}");
        assert!((springs.outcome.tip_mm.z - 20.0).abs() < 1e-9);
    }
}

/// A first pose in the body counts as pushed in along the needle.
#[test]
fn a_needle_may_begin_in_the_body() {
    let mut springs = model(coarse(), Layers::one(soft()));
    let outcome = springs.step(&tip_at(0.3, 0.2, 40.0), 0.1).unwrap();
    assert!(outcome.contacts > 4 && outcome.inserted_mm > 35.0);
    assert_eq!(outcome.events[0].kind, EventKind::Skin);
    assert!(outcome.events[0].at_mm.z.abs() < 1e-9);
}

/// Beyond the cylinder no node can be moved to the tip: reported once, and the needle continues.
#[test]
fn out_of_the_far_end() {
    let mut springs = model(coarse(), Layers::one(soft()));
    let seen = events(&mut springs, [-1.0, 140.0], 100.0);
    let last = seen.last().unwrap();
    assert_eq!(last.0, EventKind::NotRemeshed);
    assert!(last.1 > 93.0 && seen.len() == 3, "{seen:?}");
    assert!(springs.outcome.inserted_mm > 130.0);
    let seen = events(&mut springs, [140.0, -1.0], 100.0);
    assert_eq!(seen.iter().map(|event| event.0).collect::<Vec<_>>(), [EventKind::Out]);
}

/// Seeds keep their positions in the reference state, and move with the tissue.
#[test]
fn seeds_go_with_the_tissue() {
    let mut springs = model(coarse(), Layers::one(soft()));
    drive(&mut springs, [-1.0, 40.0], 50.0, 1e-3, |_| {});
    let mut instruments = tip_at(0.3, 0.2, 40.0);
    instruments.deposit = true;
    let outcome = springs.step(&instruments, 1e-3).unwrap();
    assert_eq!(outcome.events.last().map(|event| event.kind), Some(EventKind::Seed));
    let mut snapshot = Snapshot::default();
    springs.snapshot(&mut snapshot);
    let seed = snapshot.seeds[0];
    // The tip had pushed tissue before it: at rest the seed lies less deep.
    assert!(seed.z < 39.9 && seed.z > 34.0, "{seed}");
    drive(&mut springs, [40.0, -1.0], 50.0, 1e-3, |_| {});
    springs.snapshot(&mut snapshot);
    assert_eq!(snapshot.seeds, [seed]);
}

/// The image gets all nodes; before the needle is in, they show the undeformed tissue.
#[test]
fn the_image_gets_nodes() {
    let mut springs = model(coarse(), Layers::one(soft()));
    let mut imager = springs.imager();
    let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
    springs.step(&tip_at(0.3, 0.2, -5.0), 1e-3).unwrap();
    springs.snapshot(&mut snapshot);
    imager.tissue(&snapshot, &mut tissue);
    assert_eq!(tissue.reference, tissue.current);
    // Along the needle, from its tip.
    assert!((Vector3::from(tissue.reference[0]) - Vector3::new(0.3, 0.2, -5.0)).norm() < 1e-9);
    drive(&mut springs, [-5.0, 40.0], 50.0, 1e-3, |_| {});
    springs.snapshot(&mut snapshot);
    imager.tissue(&snapshot, &mut tissue);
    let count = imager
        .elements()
        .iter()
        .flatten()
        .max()
        .map(|&highest| highest as usize + 1);
    assert_eq!(Some(tissue.current.len()), count);
    for (node, current) in tissue.current.iter().enumerate().take(springs.network.reference.len()) {
        assert_eq!(Vector3::from(*current), springs.network.now(node as u32));
        assert_eq!(Vector3::from(tissue.reference[node]), springs.network.reference[node]);
    }
    // Skin at z = 0.
    assert!((tissue.reference[1][2]).abs() < 1e-9);
    assert_eq!((snapshot.step, snapshot.line.tip()), (901, springs.outcome.tip_mm));
}

/// Shares of a point in an element; `None` outside.
fn shares(corners: &[u32; 4], nodes: &[[f64; 3]], point: &Vector3<f64>) -> Option<[f64; 4]> {
    let [a, b, c, d] = corners.map(|corner| Vector3::from(nodes[corner as usize]));
    let [u, v, w]: [f64; 3] = (Matrix3::from_columns(&[b - a, c - a, d - a]).try_inverse()? * (point - a)).into();
    let shares = [1.0 - u - v - w, u, v, w];
    shares.iter().all(|share| *share > -1e-9).then_some(shares)
}

/// Displacement in the image of a point at rest; `None` where no element is.
fn imaged(elements: &[[u32; 4]], tissue: &Tissue, point: &Vector3<f64>) -> Option<Vector3<f64>> {
    elements.iter().find_map(|corners| {
        let shares = shares(corners, &tissue.reference, point)?;
        let moved = |(corner, share): (&u32, f64)| {
            let [now, at_rest] =
                [&tissue.current, &tissue.reference].map(|nodes| Vector3::from(nodes[*corner as usize]));
            (now - at_rest) * share
        };
        Some(corners.iter().zip(shares).map(moved).sum())
    })
}

/// At an oblique entry all tissue beside the needle lies in an element, and its displacement has no step at the disc.
#[test]
fn an_oblique_entry_does_not_tear_the_image() {
    let parameters = coarse();
    let mut springs = model(
        parameters,
        Layers::one(Interaction {
            cutting_n: 5.0,
            ..soft()
        }),
    );
    let direction = Vector3::new(1.0, 0.0, 1.0).normalize();
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &direction).unwrap();
    for step in 0..600 {
        let tip = direction * (0.05 * f64::from(step) - 5.0);
        let base = Isometry3::from_parts((tip - direction * 150.0).into(), turn);
        let instruments = Instruments {
            base,
            ..tip_at(0.0, 0.0, 0.0)
        };
        springs.step(&instruments, 1e-3).unwrap();
    }
    let mut imager = springs.imager();
    let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
    springs.snapshot(&mut snapshot);
    imager.tissue(&snapshot, &mut tissue);
    let elements = imager.elements();
    let aside = Vector3::new(-1.0, 0.0, 1.0).normalize();
    let mut largest: f64 = 0.0;
    for step in 1..18 {
        // On the side on which the skin rises before the disc.
        let on_disc = aside * f64::from(step);
        let displacement_at = |before: f64| imaged(elements, &tissue, &(on_disc - direction * before));
        for before in [0.1, 0.5 * f64::from(step), 0.98 * f64::from(step)] {
            assert!(
                displacement_at(before).is_some(),
                "no tissue {before} mm before the disc, {step} mm aside"
            );
        }
        let [before, after] = [1e-3, -1e-3].map(|before| displacement_at(before).unwrap());
        assert!((before - after).norm() < 1e-3, "{before} {after}");
        largest = largest.max(after.norm());
    }
    assert!(largest > 0.2, "the tissue did not move: {largest}");
}

/// A pose whose quaternion has length 2.
fn doubled(pose: &Isometry3<f64>) -> Isometry3<f64> {
    let quaternion = pose.rotation.into_inner() * 2.0;
    Isometry3::from_parts(pose.translation, UnitQuaternion::new_unchecked(quaternion))
}

#[test]
fn steps_that_cannot_be_made_are_refused() {
    let mut springs = model(coarse(), Layers::one(soft()));
    for dt_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            springs.step(&tip_at(0.0, 0.0, 0.0), dt_s),
            Err(StepError::Input { .. })
        ));
    }
    let nowhere = tip_at(f64::NAN, 0.0, 0.0);
    assert!(matches!(springs.step(&nowhere, 1e-3), Err(StepError::Input { .. })));
    let turn = Isometry3::rotation(Vector3::x() * 0.3);
    let scaled = Instruments::new(tip_at(0.0, 0.0, -5.0).base * doubled(&turn));
    assert!(matches!(springs.step(&scaled, 1e-3), Err(StepError::Pose { .. })));
    // Farther than can be resolved: reported, not hidden.
    springs.step(&tip_at(0.0, 0.0, -9e5), 1e-3).unwrap();
    let outcome = springs.step(&tip_at(0.0, 0.0, -5.0), 1e-3).unwrap();
    assert!(!outcome.converged && outcome.substeps == MAX_PARTS);
    assert_eq!(
        outcome.events.last().map(|event| event.kind),
        Some(EventKind::NotConverged)
    );
}

/// A tip that wanders along a boundary crosses it once, and its surface resists once.
#[test]
fn a_border_is_crossed_once() {
    let breaking = |puncture_n| Interaction {
        puncture_n,
        ..Interaction::default()
    };
    let layers = Layers {
        starts_mm: vec![0.0, 25.0],
        interactions: vec![breaking(0.0), breaking(0.1)],
    };
    let mut springs = model(MassSpringParameters::default(), layers);
    let mut seen = events(&mut springs, [-1.0, 25.2], 20.0);
    for _ in 0..4 {
        seen.extend(events(&mut springs, [25.2, 24.9], 20.0));
        seen.extend(events(&mut springs, [24.9, 25.2], 20.0));
    }
    let crossings = seen.iter().filter(|event| event.0 == EventKind::Region).count();
    assert_eq!(crossings, 1, "{seen:?}");
}

#[test]
fn a_thin_critical_layer_is_told() {
    let critical_layer = |critical| Interaction {
        critical,
        ..Interaction::default()
    };
    let layers = Layers {
        starts_mm: vec![0.0, 20.0, 20.3, 20.45],
        interactions: [false, false, true, false].map(critical_layer).to_vec(),
    };
    let seen = events(&mut model(MassSpringParameters::default(), layers), [-1.0, 25.0], 20.0);
    let told = seen.iter().filter(|event| event.0 == EventKind::Critical).count();
    assert_eq!(told, 1, "{seen:?}");
}

/// Five layers of 1 to 10 mm are met in order on the way in, the surface by the rule of the elements alone, although the
/// tip jumps by millimetres at each node.
#[test]
fn layers_are_met_one_by_one_from_the_surface_on() {
    let tough = |critical| Interaction {
        cutting_n: 1000.0,
        critical,
        ..Interaction::default()
    };
    let layers = Layers {
        starts_mm: vec![0.0, 2.0, 12.0, 13.0, 23.0],
        interactions: [false, false, true, false, false].map(tough).to_vec(),
    };
    let mut model = model(MassSpringParameters::default(), layers);
    let mut seen = Vec::new();
    let mut depth_mm = 0.0;
    drive(&mut model, [-1.0, 45.0], 20.0, 1e-3, |outcome| {
        for event in &outcome.events {
            seen.push((event.kind, event.region));
            if event.kind == EventKind::Puncture {
                depth_mm = outcome.tip_mm.z;
            }
        }
    });
    assert!(0.0 < depth_mm && depth_mm < 15.0, "broken at {depth_mm} mm");
    let entered = |kind| seen.iter().filter(move |event| event.0 == kind).map(|event| event.1);
    assert_eq!(entered(EventKind::Region).collect::<Vec<_>>(), [1, 2, 3, 4].map(Some));
    assert_eq!(entered(EventKind::Critical).collect::<Vec<_>>(), [Some(2)]);
}
