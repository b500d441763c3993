//! Tests of flexible needles: properties common to the spring and beam models, and closed-form solutions of each.

mod beam;
mod springs;

use std::f64::consts::PI;

use nalgebra::{DMatrix, Point3, Translation3, UnitQuaternion};

use super::*;

const LENGTH: f64 = 200.0;
const BEVEL: Bevel = Bevel {
    r_mm: 0.6,
    length_mm: 4.0,
};

/// A needle of springs and one of beam elements.
fn both(element_mm: f64, bevel: Option<Bevel>) -> [Flexible; 2] {
    [Flexible::springs, Flexible::beam]
        .map(|model| model(Shaft::default(), Stiffness::default(), element_mm, bevel).expect("needle"))
}

fn load(arc_mm: f64, force: [f64; 3]) -> Load {
    Load {
        arc_mm,
        force_n: force.into(),
    }
}

/// Calls `place` until nothing moves by more than 1e-10 mm; returns the number of calls.
fn settle(needle: &mut Flexible, base: &Isometry3<f64>, loads: &[Load], line: &mut CentreLine) -> usize {
    settle_within(1e-10, needle, base, loads, line)
}

fn settle_within(
    tolerance_mm: f64,
    needle: &mut Flexible,
    base: &Isometry3<f64>,
    loads: &[Load],
    line: &mut CentreLine,
) -> usize {
    for count in 1..=400 {
        let before = line.clone();
        needle.place(base, None, loads, loads, line);
        if line.distance(&before) < tolerance_mm {
            return count;
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

/// The first axial load at which a cantilever buckles (Euler), N.
fn buckling_n() -> f64 {
    PI * PI * Stiffness::default().bending_nmm2() / (4.0 * LENGTH * LENGTH)
}

/// Exact about the straight needle, also under an axial load near buckling; about a bent one up to the interaction of
/// finite rotations: the square of the bend.
#[test]
fn linearisation_is_what_forces_move() {
    for (bend, along, tolerance) in [(0.0, 0.0, 1e-6), (0.0, 0.8 * buckling_n(), 1e-6), (0.04, 0.04, 0.02)] {
        let bevel = Some(BEVEL).filter(|_| bend > 0.0);
        for mut needle in both(10.0, bevel) {
            let (base, rows) = (slanted(), rows());
            let axis = base.rotation * Vector3::z();
            let mut loads = vec![
                load(200.0, (axis * -along + Vector3::x() * bend).into()),
                load(120.0, [0.0, bend, 0.0]),
            ];
            let mut line = CentreLine::default();
            settle(&mut needle, &base, &loads, &mut line);
            let (mut drift, mut flexibility) = (vec![1.0; rows.len()], DMatrix::zeros(rows.len(), rows.len()));
            assert_eq!(
                needle.linearise(&line, &loads, &rows, &mut drift, flexibility.as_mut_slice()),
                0
            );
            assert!(drift.iter().all(|drift| drift.abs() < 1e-8), "{drift:?}");
            let largest = (0..rows.len()).map(|i| flexibility[(i, i)]).fold(0.0, f64::max);
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
                    let difference = plus.point_at_arc(row.arc_mm).point_mm - minus.point_at_arc(row.arc_mm).point_mm;
                    let expected = difference.dot(&row.direction) / (2.0 * step);
                    let error = (flexibility[(i, j)] - expected).abs();
                    assert!(
                        error <= tolerance * largest,
                        "{i} {j}: {} {expected}",
                        flexibility[(i, j)]
                    );
                }
            }
        }
    }
}

/// The free needle has as many buckling modes as Euler loads, (2 n - 1)^2 times the first, lie below the axial load,
/// each in two planes. Links of 10 mm buckle a little earlier; cubics over elements of 10 mm find the loads to a
/// thousandth.
#[test]
fn ways_to_buckle_are_counted() {
    let of_springs = [(-20.0, 0), (0.98, 0), (1.02, 2), (8.8, 2), (9.2, 4), (26.0, 6)];
    let of_beam = [(-20.0, 0), (0.999, 0), (1.005, 2), (8.95, 2), (9.1, 4), (26.0, 6)];
    for (mut needle, expected) in both(10.0, None).into_iter().zip([of_springs, of_beam]) {
        let (base, mut line) = (slanted(), CentreLine::default());
        settle(&mut needle, &base, &[], &mut line);
        for (share, ways) in expected {
            let axis = base.rotation * Vector3::z();
            let loads = [load(LENGTH, (axis * (-share * buckling_n())).into())];
            let (mut drift, mut out) = ([0.0], [0.0]);
            let unstable_ways = needle.linearise(&line, &loads, &rows()[..1], &mut drift, &mut out);
            assert_eq!(unstable_ways, ways, "{share}");
        }
    }
}

#[test]
fn a_turned_and_moved_base_turns_and_moves_all() {
    let bevel = Bevel {
        length_mm: 25.0,
        ..BEVEL
    };
    for mut needle in both(10.0, Some(bevel)) {
        let motion = slanted();
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
}

#[test]
fn no_force_tears_it() {
    for force in [1.0, 1e3, 1e30, 1e155, f64::MAX] {
        for (mut needle, is_springs) in both(10.0, Some(BEVEL)).into_iter().zip([true, false]) {
            let mut line = CentreLine::default();
            let loads = [
                load(200.0, [force, -force, 0.0]),
                load(77.0, [0.0, force, force]),
                load(30.0, [-force; 3]),
            ];
            for _ in 0..5 {
                needle.place(&slanted(), None, &loads, &loads, &mut line);
                let links = line.nodes().windows(2);
                let segments: Vec<_> = links
                    .map(|pair| (pair[1].1 - pair[0].1, pair[1].0 - pair[0].0))
                    .collect();
                for (segment, length) in &segments {
                    assert!((segment.norm() - length).abs() < 1e-12, "{force}: {segment}");
                }
                for pair in segments.windows(2).filter(|_| is_springs) {
                    assert!(pair[0].0.angle(&pair[1].0) < MAX_TURN + 1e-7, "{force}");
                }
            }
        }
    }
}

#[test]
fn without_loads_it_is_straight_to_the_bit() {
    for mut needle in both(7.0, None) {
        let (base, mut line) = (slanted(), CentreLine::default());
        settle(&mut needle, &base, &[load(200.0, [0.1, 0.1, 0.1])], &mut line);
        settle(&mut needle, &base, &[load(150.0, [0.0; 3])], &mut line);
        let direction = base.rotation * Vector3::z();
        for &(arc, point) in line.nodes() {
            assert_eq!(point, Point3::from(base.translation.vector) + direction * arc);
        }
    }
}
