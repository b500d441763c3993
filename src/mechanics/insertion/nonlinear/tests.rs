//! A needle enters a block with a soft layer, rests, and is withdrawn.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::*;
use crate::insertion::{Bone, Interaction, InvalidSetup, MeshRegions, Tissue};
use crate::tissue::material::Material;
use crate::tissue::nonlinear::creep::Memory;
use crate::tissue::nonlinear::{NonlinearError, Solid, Stiffening};

const EDGE_MM: [f64; 3] = [30.0, 30.0, 24.0];

/// Regions 1, 2 and 1 again along z, with their interactions.
fn setup(viscosity: Option<Viscosity>) -> NonlinearSetup {
    let mesh = TetMesh::over_box([0.0; 3], EDGE_MM, 500).unwrap();
    let elements = mesh.elements().to_vec();
    let middle = |corners: &[u32; 4]| corners.map(|node| mesh.nodes()[node as usize][2]).iter().sum::<f64>() / 4.0;
    let soft = |corners: &[u32; 4]| (10.0..16.0).contains(&middle(corners));
    let regions: Vec<i32> = elements
        .iter()
        .map(|corners| if soft(corners) { 2 } else { 1 })
        .collect();
    let law = |region: &i32| {
        let material = Material::new(if *region == 1 { 3.0 } else { 0.5 }, 0.4).unwrap();
        Stiffening::new(material, 0.3, 10.0).unwrap()
    };
    let fixed = (0u32..)
        .zip(mesh.nodes())
        .filter(|(_, position)| position[2] == EDGE_MM[2])
        .flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis)))
        .collect();
    let laws = regions.iter().map(law).map(Into::into).collect();
    let mesh = TetMesh::new(mesh.nodes().to_vec(), elements, regions).unwrap();
    let one = Interaction {
        friction_n_per_mm: 0.002,
        cutting_n: 0.01,
        puncture_n: 0.05,
        ..Interaction::default()
    };
    let two = Interaction {
        puncture_n: 0.04,
        ..Interaction::default()
    };
    NonlinearSetup {
        mesh: Arc::new(mesh),
        laws,
        fixed,
        interactions: vec![(2, two), (1, one)],
        anatomy: None,
        shaft: Shaft {
            length_mm: 60.0,
            radius_mm: 0.5,
        },
        patch_mm: 0.0,
        viscosity,
        stress: false,
        options: NonlinearOptions::default(),
    }
}

fn creeping() -> Option<Viscosity> {
    Some(Viscosity {
        order: 0.2,
        memory: Memory::LoadIntegral,
    })
}

fn at(x: f64, depth: f64) -> Instruments {
    Instruments {
        base: Isometry3::from_parts(Translation3::new(x, 14.3, depth - 60.0), UnitQuaternion::identity()),
        probe: None,
        guide: None,
        deposit: false,
    }
}

const X: f64 = 15.7;

/// Depths of the tip, step by step.
fn in_and_out() -> Vec<f64> {
    let step = 0.4;
    let inward = (0..50).map(|index| -2.0 + step * f64::from(index));
    let still = std::iter::repeat_n(-2.0 + step * 49.0, 5);
    let outward = (0..80).map(|index| -2.0 + step * (49.0 - f64::from(index)));
    inward.chain(still).chain(outward).collect()
}

struct Seen {
    force: Vec<f64>,
    events: Vec<(EventKind, Option<i32>)>,
    outcomes: Vec<Outcome>,
}

/// Returns the events except those of crushed elements.
fn told(seen: &Seen) -> Vec<(EventKind, Option<i32>)> {
    let told = seen.events.iter().filter(|(kind, _)| *kind != EventKind::Crushed);
    told.copied().collect()
}

fn run(model: &mut Nonlinear, depths: &[f64]) -> Seen {
    let mut seen = Seen {
        force: Vec::new(),
        events: Vec::new(),
        outcomes: Vec::new(),
    };
    for depth in depths {
        let outcome = model.step(&at(X, *depth), 0.05).unwrap();
        assert!(outcome.converged, "{depth}: {outcome:?}");
        seen.force.push(-outcome.on_hand.force_n.z);
        seen.events
            .extend(outcome.events.iter().map(|event| (event.kind, event.region)));
        seen.outcomes.push(outcome.clone());
    }
    seen
}

/// A step that does not converge in the iterations allowed is made in halves, to the same force.
#[test]
fn steps_that_do_not_converge_are_halved() {
    let steps = |iterations: Option<usize>| {
        let mut setup = setup(None);
        setup.interactions[1].1.puncture_n = 50.0;
        setup.options.part_mm = 20.0;
        if let Some(iterations) = iterations {
            setup.options.solving.iterations = iterations;
        }
        let mut model = Nonlinear::new(setup).unwrap();
        model.step(&at(X, -0.1), 0.05).unwrap();
        model.step(&at(X, 6.0), 0.05).unwrap().clone()
    };
    let whole = steps(None);
    assert!(whole.converged && whole.iterations > 4, "{whole:?}");
    let halved = steps(Some(whole.iterations - 1));
    assert!(halved.converged && halved.iterations > whole.iterations, "{halved:?}");
    let [a, b] = [&whole, &halved].map(|outcome| outcome.on_hand.force_n.norm());
    assert!((a - b).abs() < 1e-4 * a && a > 0.0, "{a} {b}");
}

#[test]
fn it_pushes_punctures_stops_and_comes_out() {
    for viscosity in [None, creeping()] {
        let mut model = Nonlinear::new(setup(viscosity)).unwrap();
        let depths = in_and_out();
        let seen = run(&mut model, &depths);
        use EventKind::{Out, Puncture, Region, Skin};
        let expected = [
            (Skin, Some(1)),
            (Puncture, Some(1)),
            (Puncture, Some(2)),
            (Region, Some(2)),
            (Puncture, Some(1)),
            (Region, Some(1)),
            (Region, Some(2)),
            (Region, Some(1)),
            (Out, None),
        ];
        assert_eq!(told(&seen), expected, "{viscosity:?}");
        // Pushing, the force rises; after a puncture it falls.
        let first_puncture = seen
            .outcomes
            .iter()
            .position(|outcome| outcome.events.iter().any(|event| event.kind == Puncture));
        let first_puncture = first_puncture.unwrap();
        let touch = seen.force.iter().position(|force| *force > 0.0).unwrap();
        assert!(
            first_puncture > touch + 3
                && seen.force[touch..=first_puncture]
                    .windows(2)
                    .all(|pair| pair[1] > pair[0])
        );
        assert!(
            seen.force[first_puncture] > 0.05 && seen.force[first_puncture + 1] < 0.02,
            "{:?}",
            seen.force
        );
        // At rest the needle is held, and a viscous body relaxes.
        let stop = &seen.force[50..55];
        assert!(seen.outcomes[52].stuck > 0 && seen.outcomes[45].stuck == 0);
        match viscosity {
            None => assert!((stop[4] / stop[0] - 1.0).abs() < 1e-5, "{stop:?}"),
            // At first, tissue that the tip has passed still springs back against it.
            Some(_) => assert!(
                stop[1..].windows(2).all(|pair| pair[1] < pair[0]) && stop[4] > 0.0,
                "{stop:?}"
            ),
        }
        // On withdrawal it is pulled back, at most by friction along the inserted length, within the change in one
        // step.
        let friction_n = |outcome: &Outcome| 0.002 * outcome.inserted_mm;
        let outward = &seen.outcomes[60..];
        let pulled = outward
            .iter()
            .map(|outcome| outcome.on_hand.force_n.z - friction_n(outcome));
        assert!(pulled.fold(f64::NEG_INFINITY, f64::max) < 0.003);
        assert!(outward.iter().any(|outcome| outcome.on_hand.force_n.z > 0.01));
        assert!(
            outward
                .windows(2)
                .all(|pair| pair[1].inserted_mm <= pair[0].inserted_mm)
        );
        let end = &seen.outcomes[depths.len() - 1];
        assert_eq!(
            (end.inserted_mm, end.contacts, end.on_hand.force_n.norm()),
            (0.0, 0, 0.0)
        );
        // Elastic tissue is at rest again; viscous tissue approaches it.
        let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
        model.snapshot(&mut snapshot);
        model.imager().tissue(&snapshot, &mut tissue);
        let moved = tissue.reference.iter().zip(&tissue.current);
        let farthest = moved
            .map(|(a, b)| (Vector3::from(*a) - Vector3::from(*b)).norm())
            .fold(0.0, f64::max);
        let left = if viscosity.is_none() { 1e-5 } else { 1.0 };
        assert!(farthest < left, "{farthest}");
        assert_eq!(tissue.inverted, 0);
    }
}

/// Whatever the needle does, the tissue said to be at its tip is there as the mesh deforms, also while the needle is
/// held and drawn back.
#[test]
fn the_tip_is_where_the_deformed_tissue_has_it() {
    for viscosity in [None, creeping()] {
        let mut model = Nonlinear::new(setup(viscosity)).unwrap();
        let (mut held, mut largest_mm) = (0, 0.0_f64);
        let depths = in_and_out();
        for (step, depth) in depths.iter().enumerate() {
            let outcome = model.step(&at(X, *depth), 0.05).unwrap();
            let at_rest = outcome.tip_at_rest_mm;
            let Some(at_rest) = at_rest.filter(|_| step >= 50 && model.needle.phase() == Phase::Held) else {
                continue;
            };
            let error_mm = at_rest.z + model.needle.along(at_rest.z) - depth;
            // The entry lies a rounding outside.
            assert!(error_mm.abs() < 1e-6, "{depth}: {at_rest} is {error_mm} mm off");
            held += 1;
            largest_mm = largest_mm.max((model.needle.depth_mm() - at_rest.z).abs());
        }
        // The tissue at the tip does not stay there.
        assert!(held > 5 && largest_mm > 0.05, "{held} {largest_mm}");
    }
}

/// Fixed at its sides, with the far face free: the tip comes out there, and only friction along the inserted length
/// remains.
#[test]
fn it_goes_through_and_back() {
    for viscosity in [None, creeping()] {
        let mut setup = setup(viscosity);
        setup.interactions[0].1.friction_n_per_mm = 0.002;
        let nodes = setup.mesh.nodes().iter().enumerate();
        setup.fixed = nodes
            .filter(|(_, position)| (0..2).any(|axis| position[axis] == 0.0 || position[axis] == EDGE_MM[axis]))
            .flat_map(|(node, _)| [0, 1, 2].map(|axis| (node as u32, axis)))
            .collect();
        let mut model = Nonlinear::new(setup).unwrap();
        let (step, in_steps) = (0.4, 85);
        let inward = (0..in_steps).map(|index| -2.0 + step * f64::from(index));
        let outward = (0..in_steps).map(|index| -2.0 + step * f64::from(in_steps - 2 - index));
        let depths: Vec<f64> = inward.chain(outward).collect();
        let seen = run(&mut model, &depths);
        use EventKind::{Out, Puncture, Region, Skin};
        let expected = [
            (Skin, Some(1)),
            (Puncture, Some(1)),
            (Puncture, Some(2)),
            (Region, Some(2)),
            (Puncture, Some(1)),
            (Region, Some(1)),
            (Out, None),
            (Region, Some(2)),
            (Region, Some(1)),
            (Out, None),
        ];
        assert_eq!(told(&seen), expected, "{viscosity:?}");
        // Tissue is dragged along with the needle: the inserted length at the end is the thickness of the block.
        let end = &seen.outcomes[in_steps as usize - 1];
        assert!((end.inserted_mm - EDGE_MM[2]).abs() < 1e-9, "{}", end.inserted_mm);
        // It slides: friction of 0.002 N/mm, and nothing at the tip. A creeping body lags behind the pull.
        let friction = 0.002 * EDGE_MM[2];
        let slack = if viscosity.is_none() { 1e-3 } else { 0.05 };
        assert!(
            (-end.on_hand.force_n.z / friction - 1.0).abs() < slack,
            "{:?}",
            end.on_hand.force_n
        );
        assert_eq!(end.stuck, 0);
        let last = &seen.outcomes[depths.len() - 1];
        assert_eq!((last.inserted_mm, last.on_hand.force_n.norm()), (0.0, 0.0));
    }
}

#[test]
fn a_saved_state_goes_on_with_the_same_bits() {
    for viscosity in [None, creeping()] {
        let depths = in_and_out();
        for stop in [3, 12, 30, 52, 70] {
            let mut model = Nonlinear::new(setup(viscosity)).unwrap();
            run(&mut model, &depths[..stop]);
            let saved = model.save();
            let text = serde_json::to_string(&saved).unwrap();
            let expected = run(&mut model, &depths[stop..stop + 6]);
            let mut restored = Nonlinear::new(setup(viscosity)).unwrap();
            run(&mut restored, &depths[..5]);
            restored.restore(&serde_json::from_str(&text).unwrap()).unwrap();
            let continued = run(&mut restored, &depths[stop..stop + 6]);
            assert_eq!(continued.outcomes, expected.outcomes, "{stop}");
            let (mut a, mut b) = (Snapshot::default(), Snapshot::default());
            model.snapshot(&mut a);
            restored.snapshot(&mut b);
            assert_eq!(a, b);
        }
    }
    let mut model = Nonlinear::new(setup(None)).unwrap();
    let saved = Nonlinear::new(setup(creeping())).unwrap().save();
    assert!(matches!(model.restore(&saved), Err(StepError::Foreign(_))));
}

#[test]
fn sideways_moves_are_refused_in_tissue_and_taken_outside() {
    let mut model = Nonlinear::new(setup(None)).unwrap();
    run(&mut model, &in_and_out()[..20]);
    let before = model.outcome().clone();
    let refused = model.step(&at(X + 1.0, 5.6), 0.05).unwrap_err();
    let StepError::Input { found, .. } = refused else {
        panic!("{refused}")
    };
    assert!((found - 1.0).abs() < 1e-9);
    assert_eq!(model.outcome(), &before);
    assert!(model.step(&at(X, f64::NAN), 0.05).is_err());
    let mut scaled = at(X, 5.6);
    let quaternion = scaled.base.rotation.into_inner() * 1.1;
    scaled.base.rotation = nalgebra::UnitQuaternion::new_unchecked(quaternion);
    assert!(matches!(model.step(&scaled, 0.05), Err(StepError::Pose { .. })));
    model.step(&at(X, -3.0), 0.05).unwrap();
    assert_eq!(model.outcome().inserted_mm, 0.0);
    // Along another line the tissue is intact.
    let outcome = model.step(&at(8.2, 1.0), 0.05).unwrap();
    assert!(outcome.on_hand.force_n.z < 0.0 && outcome.inserted_mm == 0.0);
    // A line beside the body meets nothing.
    model.step(&at(8.2, -1.0), 0.05).unwrap();
    let outcome = model.step(&at(50.0, 12.0), 0.05).unwrap();
    assert_eq!((outcome.on_hand.force_n.norm(), outcome.contacts), (0.0, 0));
}

/// Invalid inputs are named.
#[test]
fn setups_are_checked() {
    let refused = |spoil: fn(&mut NonlinearSetup)| {
        let mut setup = setup(creeping());
        spoil(&mut setup);
        Nonlinear::new(setup).map(drop).unwrap_err()
    };
    let spoilt = refused(|setup| setup.interactions[0].1.cutting_n = -1.0);
    assert!(matches!(spoilt, InvalidSetup::Interaction { region: 2, .. }));
    let spoilt = refused(|setup| setup.options.part_mm = 0.0);
    assert!(matches!(spoilt, InvalidSetup::Number(error) if error.key == "part_mm"));
    let spoilt = refused(|setup| setup.fixed.push((1_000_000, 0)));
    assert!(matches!(spoilt, InvalidSetup::Fixed { node: 1_000_000, .. }));
    let spoilt = refused(|setup| setup.shaft.length_mm = -1.0);
    assert!(matches!(spoilt, InvalidSetup::Number(error) if error.key == "length_mm"));
    assert!(matches!(
        refused(|setup| setup.laws.truncate(1)),
        InvalidSetup::Solver(NonlinearError::Materials { .. })
    ));
    assert!(matches!(
        refused(|setup| setup.fixed.clear()),
        InvalidSetup::Solver(NonlinearError::Factor(_))
    ));
    let spoilt = refused(|setup| {
        setup.viscosity = Some(Viscosity {
            order: 1.5,
            memory: Memory::Rate,
        });
    });
    assert!(matches!(spoilt, InvalidSetup::Solver(NonlinearError::History(_))));
}

#[test]
fn bone_on_the_way_is_found() {
    let setup = setup(None);
    let bone = Interaction {
        bone: Some(Bone {
            stiffness_n_per_mm: 40.0,
            penetration_mm: 0.5,
        }),
        ..Interaction::default()
    };
    let anatomy = MeshRegions::new(&setup.mesh, &[(2, bone)]).unwrap();
    let (tip, direction) = (Point3::new(X, 14.3, -5.0), Vector3::z_axis());
    let distance_mm = obstacle(&anatomy, &tip, &direction, 40.0).unwrap();
    // The layer's elements are those with their centroids in it: they begin within one row of the mesh.
    assert!((12.0..17.0).contains(&distance_mm), "{distance_mm}");
    assert_eq!(obstacle(&anatomy, &tip, &direction, 5.0), None);
}

/// Regions by depth: 1.2 mm of skin (5) outside the mesh, then 1 and, from 12 mm, critical tissue (2).
#[derive(Debug)]
struct Beyond;

impl Anatomy for Beyond {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        match at_rest_mm.z {
            z if z < -1.2 => None,
            z if z < 0.0 => Some(5),
            z if z < 12.0 => Some(1),
            _ => Some(2),
        }
    }

    fn interaction(&self, region: i32) -> Interaction {
        Interaction {
            cutting_n: 0.01,
            puncture_n: if region == 5 { 0.05 } else { 0.0 },
            critical: region == 2,
            ..Interaction::default()
        }
    }
}

/// Skin that the mesh omits is met at the surface of the mesh, and critical tissue is reported.
#[test]
fn skin_outside_the_mesh_breaks_and_critical_tissue_is_told() {
    let mut setup = setup(None);
    setup.anatomy = Some(Arc::new(Beyond));
    let mut model = Nonlinear::new(setup).unwrap();
    let depths: Vec<f64> = (0..50).map(|index| -2.0 + 0.4 * f64::from(index)).collect();
    let expected = [
        (EventKind::Skin, Some(5)),
        (EventKind::Puncture, Some(5)),
        (EventKind::Region, Some(1)),
        (EventKind::Region, Some(2)),
        (EventKind::Critical, Some(2)),
    ];
    assert_eq!(told(&run(&mut model, &depths)), expected);
}

/// Forces along the shaft add up to that on the hand, with the friction of a shaft that slides in; the stress that is
/// followed is, without viscosity, that of the displacements.
#[test]
fn forces_along_the_needle_and_stress_are_known() {
    let viscosity = Some(Viscosity {
        order: 0.0,
        memory: Memory::LoadIntegral,
    });
    let followed = NonlinearSetup {
        stress: true,
        ..setup(viscosity)
    };
    let body = Solid::tetrahedra(&followed.mesh, &followed.laws).unwrap();
    let mut model = Nonlinear::new(followed).unwrap();
    let mut loads = Vec::new();
    let mut slid = 0;
    for depth in in_and_out() {
        let force = model.step(&at(X, depth), 0.05).unwrap().on_hand.force_n;
        model.shaft_loads(&mut loads);
        let sum: Vector3<f64> = loads.iter().map(|load| load.force_n).sum();
        assert!((sum - force).norm() < 1e-12, "{depth}: {sum} for {force}");
        let Some((tip, shaft)) = loads.split_last() else {
            continue;
        };
        let within = shaft
            .iter()
            .all(|load| load.from_mm <= load.to_mm && load.to_mm <= tip.to_mm);
        assert!(within, "{depth}: {loads:?}");
        slid += usize::from(shaft.first().is_some_and(|load| load.force_n.z < 0.0));
        let displacement = model.needle.structure().displacement();
        let expected = body.stresses_kpa(displacement, displacement);
        let stress_kpa = model.stress_kpa().expect("it is followed");
        let apart = stress_kpa
            .as_flattened()
            .as_flattened()
            .iter()
            .zip(expected.as_flattened().as_flattened());
        let largest_kpa = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(largest_kpa < 1e-9, "{depth}: {largest_kpa} kPa");
    }
    assert!(slid > 30, "{slid}");
    assert!(Nonlinear::new(setup(viscosity)).unwrap().stress_kpa().is_none());
    // A state has no history of the stress.
    let saved = model.save();
    model.restore(&saved).unwrap();
    assert!(model.stress_kpa().is_none());
}

/// Until it breaks, an even block of 10 kPa gives way to a needle in any mesh as far, a little less than a half-space does
/// to a rigid punch of the radius of the patch, F (1 - nu^2) / (2 a E), as its far sides are held; a point, without a
/// patch, gives way the farther the finer the mesh is.
#[test]
fn a_surface_gives_way_as_under_a_punch_in_any_mesh() {
    const BREAKS_N: f64 = 0.3;
    let (young_kpa, poisson, patch_mm) = (10.0, 0.3, 5.0);
    let dent_mm = |nodes: usize, patch_mm: f64| {
        let (low, high) = ([-40.0, -40.0, 0.0], [40.0, 40.0, 60.0]);
        let mesh = TetMesh::over_box(low, high, nodes).unwrap();
        let law = Stiffening::linear(Material::new(young_kpa, poisson).unwrap());
        let is_far = |node: &[f64; 3]| node[2] == high[2] || node[0].abs() == high[0] || node[1].abs() == high[1];
        let fixed = (0u32..).zip(mesh.nodes()).filter(|(_, node)| is_far(node));
        let tissue = Interaction {
            puncture_n: BREAKS_N,
            ..Interaction::default()
        };
        let mut model = Nonlinear::new(NonlinearSetup {
            laws: vec![law.into(); mesh.elements().len()],
            interactions: vec![(mesh.regions()[0], tissue)],
            fixed: fixed.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect(),
            mesh: Arc::new(mesh),
            patch_mm,
            ..setup(None)
        })
        .unwrap();
        let mut before = (0.0, 0.0);
        for step in 1..200 {
            let travel = 0.25 * f64::from(step);
            let base = Isometry3::translation(0.7, 0.3, travel - 60.0);
            let force = model
                .step(&Instruments { base, ..at(0.0, 0.0) }, 0.05)
                .unwrap()
                .on_hand
                .force_n
                .norm();
            if force >= BREAKS_N {
                return before.0 + (travel - before.0) * (BREAKS_N - before.1) / (force - before.1);
            }
            before = (travel, force);
        }
        f64::NAN
    };
    let punch_mm = 1e3 * BREAKS_N * (1.0 - poisson * poisson) / (2.0 * patch_mm * young_kpa);
    let dents = [4000, 8000, 16000].map(|nodes| [patch_mm, 0.0].map(|patch_mm| dent_mm(nodes, patch_mm)));
    println!("{dents:?} mm for {punch_mm} mm");
    let of_patch = dents.map(|[patch, _]| patch / punch_mm);
    assert!(of_patch.iter().all(|dent| (0.75..1.0).contains(dent)), "{of_patch:?}");
    let [least, most] = [f64::min, f64::max].map(|of| of_patch.into_iter().reduce(of).unwrap());
    assert!(most < 1.15 * least, "{of_patch:?}");
    assert!(dents[2][1] > 1.5 * dents[0][1], "{dents:?}");
}
