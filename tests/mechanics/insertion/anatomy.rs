//! What the needle meets is the anatomy, whatever mesh carries it.

use std::sync::Arc;

use insonify_base::bending::BendingConstraint;
use insonify_mechanics::insertion::finite::Finite;
use insonify_mechanics::insertion::{Anatomy, Bone, EventKind, Interaction, Outcome, Peak};
use insonify_mechanics::needle::{Bevel, Constrained, Flexible, Shaft, Stiffness};
use insonify_mechanics::tissue::material::Material;
use nalgebra::Point3;

use super::support::{LENGTH, block, build, events, go, on_table, resistance, travel};

/// Layers of regions 0, 1, ... along z: where each begins (mm), and what it does to the needle.
#[derive(Clone, Debug)]
struct Layers(Vec<(f64, Interaction)>);

impl Anatomy for Layers {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        let above = self.0.iter().take_while(|(from, _)| *from <= at_rest_mm.z).count();
        above.checked_sub(1).map(|at| at as i32)
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.0[region as usize].1
    }
}

const FAT: Interaction = Interaction {
    friction_n_per_mm: 0.005,
    static_ratio: 1.0,
    cutting_n: 0.1,
    puncture_n: 0.0,
    peak: None,
    bone: None,
    critical: false,
};

/// Interaction with fat behind a surface that breaks at so many newtons.
fn behind(puncture_n: f64) -> Interaction {
    Interaction { puncture_n, ..FAT }
}

/// A block of 60 x 60 x 80 mm of some stiffness in cells of a size, with layers that its elements know nothing of.
fn carried(layers: &Layers, cell: f64, young_kpa: f64) -> Finite {
    let mut setup = on_table(block([60.0, 60.0, 80.0], cell), Interaction::default());
    setup
        .materials
        .fill(Material::new(young_kpa, 0.45).expect("a material"));
    setup.anatomy = Some(Arc::new(layers.clone()));
    build(setup)
}

fn surfaces(steps: &[Outcome]) -> Vec<(EventKind, Option<i32>)> {
    let kinds = [
        EventKind::Skin,
        EventKind::Region,
        EventKind::Puncture,
        EventKind::Critical,
    ];
    let found = events(steps).into_iter().filter(|event| kinds.contains(&event.kind));
    found.map(|event| (event.kind, event.region)).collect()
}

/// A skin of 2 mm, a tenth of the largest element: it is touched and breaks where it lies, at the force that it has,
/// and so does all behind it, in the same order whatever the mesh.
#[test]
fn layers_break_where_they_lie_at_any_mesh() {
    use EventKind::{Critical, Puncture, Region, Skin};
    let vessel = Interaction {
        critical: true,
        ..behind(0.8)
    };
    let layers = Layers(vec![
        (0.0, behind(2.0)),
        (2.0, FAT),
        (17.3, behind(1.2)),
        (31.0, vessel),
    ]);
    for cell in [8.0, 12.0, 20.0] {
        let mut finite = carried(&layers, cell, 20.0);
        let steps = travel(&mut finite, -1.0, 60.0, 0.05);
        let expected = [
            (Skin, Some(0)),
            (Puncture, Some(0)),
            (Region, Some(1)),
            (Region, Some(2)),
            (Puncture, Some(2)),
            (Region, Some(3)),
            (Critical, Some(3)),
            (Puncture, Some(3)),
        ];
        assert_eq!(surfaces(&steps), expected, "cells of {cell} mm");
        let mut broken = steps
            .windows(2)
            .filter(|pair| pair[1].events.iter().any(|event| event.kind == Puncture));
        for (place, force) in [(0.0, 2.0), (17.3, 1.2), (31.0, 0.8)] {
            let [before, after] = broken.next().expect("a puncture") else {
                unreachable!("pairs")
            };
            let at_rest = before.tip_at_rest_mm.expect("a tip in tissue").z;
            assert!(
                (at_rest - place).abs() < 0.1,
                "{at_rest} at {place}, cells of {cell} mm"
            );
            // The friction of the shaft behind the tip comes on top.
            let shaft = 0.005 * before.inserted_mm;
            let felt = resistance(before).max(resistance(after));
            assert!(
                (force - shaft..force + shaft + 0.01).contains(&felt),
                "{felt} N of {force}, cells of {cell} mm"
            );
        }
    }
}

/// Where the surface of the mesh lies beside that of the body, the skin is that of the body.
#[test]
fn skin_beside_the_surface_of_the_mesh_is_felt_where_it_lies() {
    for z in [-1.5, 1.5] {
        let layers = Layers(vec![(z, behind(1.0))]);
        let mut finite = carried(&layers, 10.0, 20.0);
        let steps = travel(&mut finite, -4.0, 20.0, 0.05);
        let skin = events(&steps)[0];
        assert!(
            skin.kind == EventKind::Skin && (skin.at_mm.z - z).abs() < 1e-6,
            "{skin:?}"
        );
        let most = steps.iter().map(resistance).fold(0.0, f64::max);
        assert!((0.95..1.05).contains(&most), "{most} N at {z} mm");
    }
}

/// Dehghan et al. 2008, Fig. 12, in tissue a thousand times stiffer than soft tissue: four regions of constant slope,
/// with breaks at the widths of the peaks and at the boundary.
#[test]
fn the_three_parameter_force_has_the_four_slopes_of_its_layers() {
    let of = |friction_n_per_mm, density_n_per_mm, width_mm| Interaction {
        friction_n_per_mm,
        cutting_n: 0.0,
        peak: Some(Peak {
            density_n_per_mm,
            width_mm,
        }),
        ..FAT
    };
    let layers = Layers(vec![(0.0, of(0.02, 0.12, 8.0)), (25.0, of(0.05, 0.20, 12.0))]);
    let mut finite = carried(&layers, 10.0, 2e4);
    let steps = travel(&mut finite, -1.0, 60.0, 0.05);
    let slope = |from: f64, to: f64| {
        let at = |z: f64| steps.iter().find(|it| it.tip_mm.z >= z).expect("a step");
        let [a, b] = [at(from), at(to)];
        (resistance(b) - resistance(a)) / (b.tip_mm.z - a.tip_mm.z)
    };
    for (from, to, expected) in [
        (1.0, 7.8, 0.12),
        (8.2, 24.8, 0.02),
        (25.2, 32.8, 0.20 - 0.12 + 0.02),
        (33.2, 36.8, 0.20),
        (37.2, 59.0, 0.05),
    ] {
        let found = slope(from, to);
        assert!(
            (found - expected).abs() < 0.01 * expected + 2e-4,
            "{found} N/mm from {from} to {to} mm, {expected} expected"
        );
    }
}

/// Along a path that is cut a needle meets friction alone, up to its end; beside it everything (Dehghan et al. 2008,
/// Fig. 9).
#[test]
fn a_path_that_is_cut_takes_less_force() {
    let layers = Layers(vec![(0.0, behind(1.0)), (20.0, behind(1.0))]);
    let mut finite = carried(&layers, 10.0, 20.0);
    let first = travel(&mut finite, -1.0, 40.0, 0.1);
    travel(&mut finite, 40.0, -2.0, 0.1);
    let again = travel(&mut finite, -2.0, 55.0, 0.1);
    assert_eq!(
        events(&first)
            .iter()
            .filter(|event| event.kind == EventKind::Puncture)
            .count(),
        2
    );
    assert!(!events(&again).iter().any(|event| event.kind == EventKind::Puncture));
    for it in again.iter().filter(|it| it.tip_mm.z < 39.0) {
        assert!(resistance(it) < 0.005 * it.inserted_mm + 1e-3, "{it:?}");
    }
    let last = again.last().expect("steps");
    assert!(
        (resistance(last) - 0.005 * last.inserted_mm - 0.1).abs() < 0.03,
        "beyond it cuts again: {last:?}"
    );
}

/// The force of bone has a limit, and a needle that nothing bends is not deflected by it.
#[test]
fn bone_stops_a_needle_at_a_limit() {
    let bone = Interaction {
        bone: Some(Bone {
            stiffness_n_per_mm: 40.0,
            penetration_mm: 0.5,
        }),
        friction_n_per_mm: 1.0,
        ..FAT
    };
    let layers = Layers(vec![(0.0, FAT), (30.0, bone)]);
    let mut finite = carried(&layers, 10.0, 20.0);
    let steps = travel(&mut finite, -1.0, 70.0, 0.1);
    let met: Vec<_> = events(&steps)
        .into_iter()
        .filter(|event| event.kind == EventKind::Bone)
        .collect();
    assert_eq!(met.len(), 1);
    let last = steps.last().expect("steps");
    assert!(
        (resistance(last) - 20.0 - 0.005 * last.inserted_mm).abs() < 0.05,
        "{last:?}"
    );
    assert!(
        last.tip_mm.z < met[0].at_mm.z + 0.5 + 1e-6 && last.tip_deflection_mm < 1e-9,
        "{last:?}"
    );
    // On the way out it rubs on what it has come through, not on bone.
    let back = travel(&mut finite, 70.0, -3.0, 0.1);
    let pulled = back.iter().map(|step| -resistance(step)).fold(0.0, f64::max);
    assert!(pulled < 0.005 * 31.0, "{pulled} N");
}

/// A flexible needle does not pass bone either: it bows between hand and bone. The hand then feels the load at which a
/// column of its free length buckles: clamped at the hand and pinned at the tip at the least, held along the shaft in
/// tissue at the most (Euler).
#[test]
fn a_flexible_needle_bows_at_bone() {
    let bone = Interaction {
        bone: Some(Bone {
            stiffness_n_per_mm: 40.0,
            penetration_mm: 0.5,
        }),
        ..FAT
    };
    let shaft = Shaft {
        length_mm: LENGTH,
        radius_mm: 0.2,
    };
    let stiffness = Stiffness::BendingNmm2(3000.0);
    let bevel = Bevel {
        r_mm: 0.2,
        length_mm: 10.0,
    };
    let mut setup = on_table(block([60.0, 60.0, 80.0], 10.0), Interaction::default());
    setup.anatomy = Some(Arc::new(Layers(vec![(0.0, FAT), (30.0, bone)])));
    setup.needle = Box::new(Flexible::springs(shaft, stiffness, 10.0, Some(bevel)).expect("a needle"));
    let mut finite = build(setup);
    let steps = travel(&mut finite, -1.0, 45.0, 0.1);
    let met: Vec<_> = events(&steps)
        .into_iter()
        .filter(|event| event.kind == EventKind::Bone)
        .collect();
    assert_eq!(met.len(), 1);
    let euler = |length: f64| stiffness.bending_nmm2() * (4.4934 / length).powi(2);
    let most = steps.iter().map(resistance).fold(0.0, f64::max);
    let last = steps.last().expect("steps");
    assert!(most > euler(LENGTH) && most < 2.2 * euler(LENGTH - 30.0), "{most} N");
    assert!((last.tip_mm - met[0].at_mm).norm() < 0.5, "{last:?}");
    assert!(last.tip_deflection_mm > 5.0, "{last:?}");
    let back = travel(&mut finite, 45.0, -3.0, 0.1);
    let last = back.last().expect("steps");
    assert!(last.contacts == 0 && resistance(last).abs() < 1e-9, "{last:?}");
}

/// A constrained needle is as far from the one that is measured as its law says (Zhu et al. 2007, section 2.3).
#[test]
fn a_constrained_needle_is_deflected_from_the_measured_one() {
    let layers = Layers(vec![(0.0, Interaction::default())]);
    let shaft = Shaft {
        length_mm: LENGTH,
        ..Shaft::default()
    };
    let mut setup = on_table(block([60.0, 60.0, 80.0], 10.0), Interaction::default());
    setup.anatomy = Some(Arc::new(layers));
    setup.needle = Box::new(Constrained::new(shaft, BendingConstraint::default()).expect("a needle"));
    let mut finite = build(setup);
    travel(&mut finite, -1.0, 40.0, 0.5);
    // The hand turns the needle about its base by 4 mm at the tip.
    use insonify_mechanics::insertion::{Instruments, Model};
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), 4.0 / LENGTH);
    let base = nalgebra::Isometry3::from_parts(nalgebra::Translation3::new(31.3, 28.9, 40.0 - LENGTH), turn);
    let outcome = finite
        .step(
            &Instruments {
                base,
                probe: None,
                guide: None,
                deposit: false,
            },
            1e-3,
        )
        .expect("a step");
    let measured = base * Point3::new(0.0, 0.0, LENGTH);
    assert!((outcome.tip_deflection_mm - (outcome.tip_mm - measured).norm()).abs() < 1e-12);
    assert!(outcome.tip_deflection_mm > 0.01, "{outcome:?}");
}

/// A needle that stops keeps its force, also right after a change of the mesh at its tip.
#[test]
fn a_needle_that_stops_keeps_its_force() {
    let cut = Interaction { cutting_n: 0.5, ..FAT };
    let layers = Layers(vec![(0.0, cut)]);
    let mut stopped = 0;
    for cell in [6.0, 12.0] {
        let mut finite = carried(&layers, cell, 5.0);
        let mut depth = -1.0;
        while depth < 45.0 {
            let moving = go(&mut finite, depth + 0.05);
            depth += 0.05;
            if moving.remeshes > 0 && resistance(&moving) > 0.5 {
                let resting = go(&mut finite, depth);
                assert!(
                    (resistance(&resting) - resistance(&moving)).abs() < 0.02,
                    "{moving:?} {resting:?}"
                );
                stopped += 1;
            }
        }
    }
    assert!(stopped >= 6, "{stopped}");
}

/// A step that changes the mesh is as smooth as any other while the needle goes in.
#[test]
fn changes_of_the_mesh_are_not_felt() {
    let cut = Interaction { cutting_n: 0.5, ..FAT };
    for cell in [6.0, 12.0] {
        let mut finite = carried(&Layers(vec![(0.0, cut)]), cell, 5.0);
        let steps = travel(&mut finite, -1.0, 45.0, 0.05);
        let (mut changes, mut most) = (0, 0.0_f64);
        for pair in steps.windows(2).filter(|pair| pair[1].remeshes > 0) {
            changes += 1;
            most = most.max((resistance(&pair[1]) - resistance(&pair[0])).abs());
        }
        assert!(
            changes >= 4 && most < 0.02,
            "{changes} changes, {most} N, cells of {cell} mm"
        );
    }
}

/// Softer tissue behind harder, in one mesh and another, thin or thick: its entry is no puncture.
#[test]
fn softer_tissue_is_no_puncture() {
    let hard = Interaction { cutting_n: 2.0, ..FAT };
    let layers = Layers(vec![(0.0, FAT), (12.0, hard), (13.5, FAT), (20.0, hard), (30.0, FAT)]);
    for (cell, young_kpa) in [(6.0, 5.0), (12.0, 5.0), (8.0, 30.0)] {
        let mut finite = carried(&layers, cell, young_kpa);
        let steps = travel(&mut finite, -1.0, 65.0, 0.05);
        let entered = surfaces(&steps)
            .iter()
            .filter(|(kind, _)| *kind == EventKind::Region)
            .count();
        let changes = steps
            .windows(2)
            .map(|pair| (resistance(&pair[1]) - resistance(&pair[0])).abs());
        let most = changes.fold(0.0, f64::max);
        let largest = steps.iter().map(resistance).fold(0.0, f64::max);
        assert!(
            entered == 4 && most < 0.1 && largest > 2.0,
            "{cell} mm: {entered} regions, {most} of {largest} N"
        );
    }
}

/// A critical structure thinner than the distance between two crossings of a border is told, each time the needle
/// enters it.
#[test]
fn thin_critical_layers_are_told() {
    let wall = Interaction { critical: true, ..FAT };
    let layers = Layers(vec![(0.0, FAT), (20.0, FAT), (20.3, wall), (20.45, FAT)]);
    let mut finite = carried(&layers, 12.0, 20.0);
    let mut steps = travel(&mut finite, -1.0, 35.0, 0.05);
    let told = |steps: &[Outcome]| {
        let events = events(steps);
        events.iter().filter(|event| event.kind == EventKind::Critical).count()
    };
    assert_eq!(told(&steps), 1);
    steps = travel(&mut finite, 35.0, 5.0, 0.05);
    steps.extend(travel(&mut finite, 5.0, 35.0, 0.05));
    assert!(told(&steps) >= 1, "{:?}", surfaces(&steps));
}

/// Bone under half of a block.
#[derive(Clone, Debug)]
struct Ledge;

const ON_LEDGE: Interaction = Interaction {
    bone: Some(Bone {
        stiffness_n_per_mm: 40.0,
        penetration_mm: 0.5,
    }),
    ..FAT
};

impl Anatomy for Ledge {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        let is_bone = at_rest_mm.z > 30.0 && at_rest_mm.x > 30.0;
        (at_rest_mm.z > 0.0).then(|| i32::from(is_bone))
    }

    fn interaction(&self, region: i32) -> Interaction {
        [FAT, ON_LEDGE][region as usize]
    }
}

/// A needle that is moved off bone sideways is held no more, catches up with the hand, and goes on through tissue.
#[test]
fn a_needle_walks_off_bone() {
    let mut setup = on_table(block([60.0, 60.0, 80.0], 10.0), Interaction::default());
    setup.anatomy = Some(Arc::new(Ledge));
    let nodes = (0u32..).zip(setup.mesh.nodes());
    let rigid = nodes.filter(|(_, node)| node[0] >= 30.0 && node[2] >= 30.0 && node[2] < 80.0);
    setup
        .fixed
        .extend(rigid.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))));
    let mut finite = build(setup);
    let stopped = travel(&mut finite, -1.0, 35.0, 0.1);
    let stopped = stopped.last().expect("steps");
    assert!(stopped.tip_mm.z < 30.6 && resistance(stopped) > 19.0, "{stopped:?}");
    use insonify_mechanics::insertion::{Instruments, Model};
    let mut at = |x: f64, z: f64| {
        let base = nalgebra::Isometry3::translation(x, 28.9, z - LENGTH);
        let instruments = Instruments {
            base,
            probe: None,
            guide: None,
            deposit: false,
        };
        finite.step(&instruments, 1e-3).expect("a step").clone()
    };
    let steps: Vec<_> = (0..60).map(|n| at(31.3 - 0.05 * f64::from(n), 35.0)).collect();
    let mut last = steps[steps.len() - 1].clone();
    for _ in 0..20 {
        last = at(28.3, 35.0);
    }
    assert!(
        (last.tip_mm.z - 35.0).abs() < 1e-6 && resistance(&last) < 1.0,
        "{last:?}"
    );
    let on: Vec<_> = (0..20).map(|n| at(28.3, 35.0 + 0.25 * f64::from(n))).collect();
    assert!((on[19].tip_mm.z - 39.75).abs() < 1e-6 && resistance(&on[19]) < 1.0);
}

/// A needle that begins in the body has been pushed in along itself: it tells what it has passed and is held along all
/// of its way.
#[test]
fn a_needle_that_begins_inside_has_come_through_all_before() {
    let wall = Interaction {
        critical: true,
        ..behind(0.8)
    };
    let layers = Layers(vec![(0.0, behind(1.0)), (10.0, wall), (12.0, FAT)]);
    let mut finite = carried(&layers, 10.0, 20.0);
    let step = go(&mut finite, 30.0);
    let told = surfaces(std::slice::from_ref(&step));
    for expected in [
        (EventKind::Skin, Some(0)),
        (EventKind::Puncture, Some(0)),
        (EventKind::Critical, Some(1)),
    ] {
        assert!(told.contains(&expected), "{told:?}");
    }
    assert!(
        resistance(&step) > 0.1 && (step.inserted_mm - 30.0).abs() < 1.5,
        "{step:?}"
    );
}

/// Drawn back right after a change of the mesh, a needle unloads as tissue does: not at once.
#[test]
fn turning_back_after_a_change_of_the_mesh_is_smooth() {
    let cut = Interaction { cutting_n: 0.5, ..FAT };
    let layers = Layers(vec![(0.0, cut)]);
    let mut turned = 0;
    for stop in 0..5 {
        let mut finite = carried(&layers, 6.0, 5.0);
        let depth = 25.0 + 0.5 * f64::from(stop);
        let steps = travel(&mut finite, -1.0, depth, 0.05);
        let mut before = resistance(steps.last().expect("steps"));
        for step in 1..=700 {
            let back = go(&mut finite, depth - 0.02 * f64::from(step));
            let after = resistance(&back);
            assert!((after - before).abs() < 0.05, "{before} {after} N at {depth} mm");
            turned += usize::from(back.remeshes > 0);
            before = after;
        }
    }
    assert!(turned >= 1, "a node comes off at some of these depths");
}

/// Soft tissue is dented until elements fold before its skin breaks: the needle goes on through it all the same.
#[test]
fn a_needle_goes_on_after_a_deep_dent() {
    let layers = Layers(vec![(0.0, behind(2.0)), (3.0, FAT), (25.0, behind(0.5))]);
    for young_kpa in [5.0, 10.0] {
        let mut finite = carried(&layers, 8.0, young_kpa);
        let steps = travel(&mut finite, -1.0, 60.0, 0.1);
        let last = steps.last().expect("steps");
        assert!(
            last.contacts >= 4 && resistance(last) < 1.0,
            "{young_kpa} kPa: {last:?}"
        );
        assert!(
            surfaces(&steps).contains(&(EventKind::Puncture, Some(2))),
            "{young_kpa} kPa"
        );
    }
}

/// A surface that is held has no node to move to the needle: it breaks at its own force all the same, and what is
/// behind it is cut.
#[test]
fn a_held_surface_is_felt() {
    let mesh = block([60.0, 60.0, 80.0], 10.0);
    let held = (0..mesh.nodes().len() as u32).filter(|node| mesh.nodes()[*node as usize][2] == 0.0);
    let mut setup = on_table(mesh.clone(), Interaction::default());
    setup
        .fixed
        .extend(held.flat_map(|node| [0, 1, 2].map(|axis| (node, axis))));
    setup.anatomy = Some(Arc::new(Layers(vec![(0.0, behind(2.0)), (2.0, FAT)])));
    let mut finite = build(setup);
    let steps = travel(&mut finite, -1.0, 20.0, 0.05);
    let broken = steps
        .iter()
        .position(|step| step.events.iter().any(|event| event.kind == EventKind::Puncture));
    let broken = broken.expect("a puncture");
    let at = &steps[broken];
    assert!((resistance(at) - 2.0).abs() < 0.01, "{at:?}");
    assert_eq!(steps[broken - 1].inserted_mm, 0.0);
    // The tip cuts, and the shaft rubs once a node lies on it.
    assert!(steps[broken + 2..].iter().all(|step| resistance(step) > 0.09));
    let last = resistance(steps.last().expect("steps"));
    assert!((last - (0.1 + 0.005 * 20.0)).abs() < 0.05, "{last}");
}
