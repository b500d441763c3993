use std::f64::consts::PI;

use nalgebra::{DMatrix, Point3, Translation3, UnitQuaternion};

use super::super::*;

const LENGTH: f64 = 200.0;
const BEVEL: Bevel = Bevel {
    r_mm: 0.6,
    length_mm: 4.0,
};

fn needle(element_mm: f64, bevel: Option<Bevel>) -> Flexible {
    Flexible::beam(Shaft::default(), Stiffness::default(), element_mm, bevel).expect("needle")
}

fn load(arc_mm: f64, force: [f64; 3]) -> Load {
    Load {
        arc_mm,
        force_n: force.into(),
    }
}

/// Calls `place` until nothing moves.
fn settle(needle: &mut dyn Needle, base: &Isometry3<f64>, loads: &[Load], line: &mut CentreLine) {
    for _ in 0..400 {
        let before = line.clone();
        needle.place(base, None, loads, loads, line);
        if line.distance(&before) < 1e-10 {
            return;
        }
    }
    panic!("does not settle");
}

fn slanted() -> Isometry3<f64> {
    let turn = UnitQuaternion::from_euler_angles(0.4, -1.1, 2.3);
    Isometry3::from_parts(Translation3::new(31.0, -70.0, 12.5), turn)
}

fn rows() -> Vec<Row> {
    let arcs = [200.0, 12.0, 150.0, 100.0, 103.0, 60.0, 195.5, 0.0];
    let directions = [[1.0, 0.0, 0.0], [0.0, 0.6, 0.8], [0.36, 0.48, -0.8]];
    let row = |arc_mm| {
        directions.map(|direction| Row {
            arc_mm,
            direction: direction.into(),
        })
    };
    arcs.into_iter().flat_map(row).collect()
}

/// Nodes lie on the closed form of the cantilever under forces at nodes, with elements of any length: Hermite cubics contain
/// it.
#[test]
fn a_cantilever_bends_as_the_closed_form() {
    let stiffness = Stiffness::default().bending_nmm2();
    // Small: finite angles add (deflection / length)^2 of the deflection, 1e-9.
    let force = 1e-5;
    for element in [50.0, 25.0, 5.0, 1.0] {
        for (at, seen) in [(200.0, 200.0), (100.0, 200.0), (200.0, 100.0), (100.0, 50.0)] {
            let (near, far) = (f64::min(at, seen), f64::max(at, seen));
            let beam = force * near * near * (3.0 * far - near) / (6.0 * stiffness);
            let (mut needle, mut line) = (needle(element, None), CentreLine::default());
            settle(
                &mut needle,
                &Isometry3::identity(),
                &[load(at, [0.0, force, 0.0])],
                &mut line,
            );
            let found = line.at(seen).point_mm.y;
            assert!(
                (found - beam).abs() < 1e-8 * beam,
                "{element} {at} {seen}: {found} {beam}"
            );
        }
    }
}

/// Forces between nodes converge to the closed form with the square of the length of elements.
#[test]
fn forces_between_nodes_converge() {
    let stiffness = Stiffness::default().bending_nmm2();
    let (force, at) = (1e-5, 93.0);
    let beam = force * at * at * at / (3.0 * stiffness);
    let error = |element: f64| {
        let (mut needle, mut line) = (needle(element, None), CentreLine::default());
        settle(
            &mut needle,
            &Isometry3::identity(),
            &[load(at, [force, 0.0, 0.0])],
            &mut line,
        );
        (line.at(at).point_mm.x - beam).abs()
    };
    // The polyline cuts the curve by at most h^2/8 of the curvature, and the force acts on the chord: h^3/(48 EI).
    for element in [20.0f64, 10.0, 4.0] {
        let bound = force * at * element * element / (8.0 * stiffness) + force * element.powi(3) / (48.0 * stiffness);
        assert!(error(element) < bound, "{element}: {} {bound}", error(element));
    }
    assert!(error(4.0) < 0.1 * error(20.0));
}

/// The elastica: a dead force across the tip of a cantilever, P L^2/EI = 1, 2 and 5 (K. E. Bisshopp and D. C. Drucker, "Large
/// deflection of cantilever beams", 1945: tip deflections over the length of 0.30172, 0.49346 and 0.71379).
#[test]
fn large_rotations_follow_the_elastica() {
    let stiffness = Stiffness::default().bending_nmm2();
    for (factor, expected) in [(1.0, 0.30172), (2.0, 0.49346), (5.0, 0.71379)] {
        let force = factor * stiffness / (LENGTH * LENGTH);
        let deflection = |element: f64| {
            let (mut needle, mut line) = (needle(element, None), CentreLine::default());
            for part in 1..=10 {
                let loads = [load(LENGTH, [0.1 * f64::from(part) * force, 0.0, 0.0])];
                settle(&mut needle, &Isometry3::identity(), &loads, &mut line);
            }
            line.tip().x / LENGTH
        };
        let [coarse, fine] = [10.0, 2.0].map(deflection);
        // The published values have five digits; elements of 2 mm turn by 0.05 rad at most, (0.05)^2/10 of which is 2e-4 of that part.
        assert!((fine - expected).abs() < 1e-4, "{factor}: {fine} {expected}");
        assert!((coarse - expected).abs() < 2.5e-3, "{factor}: {coarse} {expected}");
    }
}

/// Agrees with springs of short links, whose midpoint rule converges to the same integrals.
#[test]
fn springs_of_short_links_bend_alike() {
    let loads = [
        load(200.0, [0.1, -0.05, 0.02]),
        load(120.0, [0.0, 0.2, 0.0]),
        load(60.0, [-0.3, 0.0, 0.0]),
    ];
    let (mut beam, base) = (needle(2.0, Some(BEVEL)), slanted());
    let mut springs = Flexible::springs(Shaft::default(), Stiffness::default(), 2.0, Some(BEVEL)).expect("springs");
    let [mut one, mut other] = [CentreLine::default(), CentreLine::default()];
    settle(&mut beam, &base, &loads, &mut one);
    settle(&mut springs, &base, &loads, &mut other);
    let straight = base * Point3::new(0.0, 0.0, LENGTH);
    let bent = (one.tip() - straight).norm();
    // h^2/(4 L^2) of the deflection is 2.5e-5 of it; levers of a tilted needle add as much again, and more.
    assert!(
        bent > 10.0 && (one.tip() - other.tip()).norm() < 3e-4 * bent,
        "{} of {bent}",
        one.tip() - other.tip()
    );
}

/// Exact about the straight needle, also under an axial load near buckling; about a bent one up to the interaction of finite
/// rotations.
#[test]
fn linearisation_is_what_forces_move() {
    let buckling = PI * PI * Stiffness::default().bending_nmm2() / (4.0 * LENGTH * LENGTH);
    for (bend, along, tolerance) in [(0.0, 0.9 * buckling, 1e-6), (0.04, 0.04, 0.02)] {
        let bevel = Some(BEVEL).filter(|_| bend > 0.0);
        let (mut needle, base, rows) = (needle(10.0, bevel), slanted(), rows());
        let axis = base.rotation * Vector3::z();
        let mut loads = vec![
            load(200.0, (axis * -along + Vector3::x() * bend).into()),
            load(120.0, [0.0, bend, 0.0]),
        ];
        let mut line = CentreLine::default();
        settle(&mut needle, &base, &loads, &mut line);
        let (mut drift, mut found) = (vec![1.0; rows.len()], DMatrix::zeros(rows.len(), rows.len()));
        assert_eq!(
            needle.linearise(&line, &loads, &rows, &mut drift, found.as_mut_slice()),
            0
        );
        assert!(drift.iter().all(|drift| drift.abs() < 1e-9), "{drift:?}");
        let largest = (0..rows.len()).map(|i| found[(i, i)]).fold(0.0, f64::max);
        for (j, row) in rows.iter().enumerate() {
            let step = 1e-5;
            let mut moved = |force: f64| {
                loads.push(load(row.arc_mm, (row.direction * force).into()));
                let mut line = line.clone();
                settle(&mut needle, &base, &loads, &mut line);
                loads.pop();
                line
            };
            let [plus, minus] = [step, -step].map(&mut moved);
            for (i, row) in rows.iter().enumerate() {
                let difference = plus.at(row.arc_mm).point_mm - minus.at(row.arc_mm).point_mm;
                let expected = difference.dot(&row.direction) / (2.0 * step);
                let error = (found[(i, j)] - expected).abs();
                assert!(error <= tolerance * largest, "{i} {j}: {} {expected}", found[(i, j)]);
            }
        }
    }
}

/// The free needle has as many buckling modes as Euler loads, (2 n - 1)^2 times the first, lie below the axial load, each in
/// two planes. Cubics over elements of 10 mm find them to a thousandth.
#[test]
fn ways_to_buckle_are_counted() {
    let buckling = PI * PI * Stiffness::default().bending_nmm2() / (4.0 * LENGTH * LENGTH);
    let (mut needle, base) = (needle(10.0, None), slanted());
    let mut line = CentreLine::default();
    settle(&mut needle, &base, &[], &mut line);
    for (share, ways) in [(-20.0, 0), (0.999, 0), (1.005, 2), (8.95, 2), (9.1, 4)] {
        let axis = base.rotation * Vector3::z();
        let loads = [load(LENGTH, (axis * (-share * buckling)).into())];
        let (mut drift, mut out) = ([0.0], [0.0]);
        let found = needle.linearise(&line, &loads, &rows()[..1], &mut drift, &mut out);
        assert_eq!(found, ways, "{share}");
    }
}

#[test]
fn a_turned_and_moved_base_turns_and_moves_all() {
    let (mut needle, motion) = (needle(10.0, Some(BEVEL)), slanted());
    let loads = [load(199.0, [0.2, -0.1, 0.05]), load(90.0, [0.0, 0.3, 0.0])];
    let turned = loads.map(|load| Load {
        force_n: motion.rotation * load.force_n,
        ..load
    });
    let [mut here, mut there] = [CentreLine::default(), CentreLine::default()];
    settle(&mut needle, &Isometry3::identity(), &loads, &mut here);
    settle(&mut needle, &motion, &turned, &mut there);
    let mut moved = CentreLine::default();
    moved.set(here.nodes().iter().map(|&(arc, point)| (arc, motion * point)));
    assert!(there.distance(&moved) < 1e-8, "{}", there.distance(&moved));
    // The bevel follows the roll of the base.
    let rolled = motion * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI);
    let mut line = CentreLine::default();
    needle.place(&rolled, None, &[], &[], &mut line);
    assert!((rolled.inverse() * line.tip()).x > 0.59);
}

#[test]
fn no_force_tears_it() {
    for force in [1.0, 1e3, 1e30, 1e155, f64::MAX] {
        let (mut needle, mut line) = (needle(10.0, Some(BEVEL)), CentreLine::default());
        let loads = [
            load(200.0, [force, -force, 0.0]),
            load(77.0, [0.0, force, force]),
            load(30.0, [-force; 3]),
        ];
        for _ in 0..5 {
            needle.place(&slanted(), None, &loads, &loads, &mut line);
            for pair in line.nodes().windows(2) {
                let apart = (pair[1].1 - pair[0].1).norm() - (pair[1].0 - pair[0].0);
                assert!(apart.abs() < 1e-12, "{force}: {apart}");
            }
        }
    }
}

#[test]
fn without_loads_it_is_straight_to_the_bit() {
    let (mut needle, base) = (needle(7.0, None), slanted());
    let mut line = CentreLine::default();
    settle(&mut needle, &base, &[load(200.0, [0.1, 0.1, 0.1])], &mut line);
    settle(&mut needle, &base, &[load(150.0, [0.0; 3])], &mut line);
    let along = base.rotation * Vector3::z();
    for &(arc, point) in line.nodes() {
        assert_eq!(point, Point3::from(base.translation.vector) + along * arc);
    }
}

#[test]
fn numbers_out_of_range_are_named() {
    for element in [0.0, -1.0, 0.1, 201.0, f64::NAN] {
        let error = Flexible::beam(Shaft::default(), Stiffness::default(), element, None).expect_err("refused");
        assert_eq!(error.key, "element_mm");
    }
    let soft = Flexible::beam(Shaft::default(), Stiffness::BendingNmm2(0.0), 5.0, None).expect_err("refused");
    assert_eq!(soft.key, "bending_stiffness_nmm2");
}
