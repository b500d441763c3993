use nalgebra::SymmetricEigen;

use super::*;

fn needle(link_mm: f64, bevel: Option<Bevel>) -> Flexible {
    Flexible::springs(Shaft::default(), Stiffness::default(), link_mm, bevel).expect("needle")
}

fn flexibility(needle: &mut Flexible, line: &CentreLine, loads: &[Load], rows: &[Row]) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(rows.len(), rows.len());
    let mut drift = vec![f64::NAN; rows.len()];
    needle.linearise(line, loads, rows, &mut drift, out.as_mut_slice());
    out
}

/// Deflections follow the closed forms of a cantilever, less what the midpoint rule omits from their integrals: exactly
/// h^2/12 times the smaller of the two arcs, since load and observation point lie at ends of parts.
#[test]
fn a_cantilever_bends_as_the_beam() {
    let stiffness = 10.7 * 180.0 / PI * 10.0;
    // Small: lines of finite angles add (deflection / length)^2 of it, 1e-9.
    let force = 1e-5;
    for link in [10.0, 5.0, 2.5] {
        for (loaded_mm, seen) in [
            (200.0, 200.0),
            (100.0, 200.0),
            (200.0, 100.0),
            (60.0, 40.0),
            (40.0, 60.0),
        ] {
            let (near, far) = (f64::min(loaded_mm, seen), f64::max(loaded_mm, seen));
            let beam = force * near * near * (3.0 * far - near) / (6.0 * stiffness);
            let correction = force * link * link * near / (12.0 * stiffness);
            let (mut needle, mut line) = (needle(link, None), CentreLine::default());
            let loads = [load(loaded_mm, [0.0, force, 0.0])];
            settle(&mut needle, &Isometry3::identity(), &loads, &mut line);
            let deflection_mm = line.point_at_arc(seen).point_mm.y;
            assert!(
                (deflection_mm - (beam - correction)).abs() < 1e-7 * beam,
                "{link} {loaded_mm} {seen}: {deflection_mm} {beam}"
            );
        }
    }
    let share = 10.0 * 10.0 / (4.0 * LENGTH * LENGTH);
    assert!(share < 1e-3, "of the tip's deflection for Goksel et al.'s links");
}

#[test]
fn link_lengths_and_both_ways_to_give_stiffness_agree() {
    let stiffness = Stiffness::default().bending_nmm2();
    assert!((stiffness - 6.13e3).abs() < 1.0);
    let mut lines = [Stiffness::KappaNmmPerDeg(10.7), Stiffness::BendingNmm2(stiffness)].map(|stiffness| {
        let mut line = CentreLine::default();
        let mut needle = Flexible::springs(Shaft::default(), stiffness, 8.0, None).expect("needle");
        assert_eq!(needle.chain.joints().len(), 25);
        settle(&mut needle, &slanted(), &[load(180.0, [0.1, 0.2, 0.0])], &mut line);
        line
    });
    assert!(lines[0].distance(&lines[1]) < 1e-12);
    // One joint, its spring under the torque that turns it by a degree.
    let degree = 10.7 / 5.0;
    let shaft = Shaft {
        length_mm: 10.0,
        ..Shaft::default()
    };
    let mut single = Flexible::springs(shaft, Stiffness::default(), 10.0, None).expect("needle");
    let loads = [load(10.0, [degree, 0.0, 0.0])];
    single.place(&Isometry3::identity(), None, &loads, &loads, &mut lines[0]);
    let tilt = lines[0].point_at_arc(10.0).tangent.x.asin().to_degrees();
    assert!((tilt - 1.0).abs() < 1e-12, "{tilt}");
}

/// The remaining motion is reported, and gone after a step.
#[test]
fn drift_is_what_the_shape_still_moves() {
    let (mut needle, base, rows) = (needle(10.0, None), slanted(), rows());
    let (light, heavy) = ([load(200.0, [0.01, 0.0, 0.0])], [load(200.0, [0.01, 0.002, 0.0])]);
    let mut line = CentreLine::default();
    settle(&mut needle, &base, &light, &mut line);
    let (mut drift, mut unused) = (vec![0.0; rows.len()], vec![0.0; rows.len() * rows.len()]);
    needle.linearise(&line, &light, &rows, &mut drift, &mut unused);
    assert!(drift.iter().all(|drift| drift.abs() < 1e-8), "{drift:?}");
    needle.linearise(&line, &heavy, &rows, &mut drift, &mut unused);
    let before = line.clone();
    settle(&mut needle, &base, &heavy, &mut line);
    for (row, drift) in rows.iter().zip(&drift) {
        let moved = line.point_at_arc(row.arc_mm).point_mm - before.point_at_arc(row.arc_mm).point_mm;
        let error = (moved.dot(&row.direction) - drift).abs();
        assert!(error < 0.02 * line.distance(&before), "{}: {moved} {drift}", row.arc_mm);
    }
}

#[test]
fn flexibility_is_symmetric_and_positive_semidefinite() {
    let (mut needle, rows) = (needle(10.0, None), rows());
    let loads = [load(200.0, [0.2, 0.1, 0.0])];
    let mut line = CentreLine::default();
    settle(&mut needle, &slanted(), &loads, &mut line);
    let computed = flexibility(&mut needle, &line, &loads, &rows);
    let size = rows.len();
    let dense = DMatrix::from_fn(size, size, |i, j| computed[(i, j)]);
    assert_eq!(dense, dense.transpose());
    let values = SymmetricEigen::new(dense).eigenvalues;
    // Rounding of the sums (40 terms) and of the eigenvalues.
    let rounding = 100.0 * size as f64 * f64::EPSILON * values.max();
    assert!(values.max() > 1.0 && values.min() > -rounding, "{values}");
    // It adds, and to the line of this needle only.
    let (mut twice, mut drift) = (computed.clone(), vec![0.0; size]);
    needle.linearise(&line, &loads, &rows, &mut drift, twice.as_mut_slice());
    let error = (0..size * size)
        .map(|index| (twice[(index / size, index % size)] - 2.0 * computed[(index / size, index % size)]).abs());
    assert!(error.fold(0.0, f64::max) < rounding);
    let before = twice.clone();
    line.set([(0.0, Point3::origin()), (LENGTH, Point3::new(0.0, 0.0, LENGTH))]);
    needle.linearise(&line, &loads, &rows, &mut drift, twice.as_mut_slice());
    assert_eq!(twice, before);
}

/// The frame at the tip is the base's, carried along by the smallest rotation from link to link.
#[test]
fn there_is_no_torsion() {
    let (mut needle, base) = (needle(10.0, Some(BEVEL)), slanted());
    // It bends in two planes. A force at the tip, off the centre line, has a torque along the shaft; forces elsewhere
    // have none at rest, since torsion is constant along a round rod.
    let loads = |arc_mm| [load(arc_mm, [0.2, -0.1, 0.05]), load(90.0, [-0.4, 0.9, 0.3])];
    let mut offset = |roll, loads: [Load; 2]| {
        let rolled = base * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
        let mut line = CentreLine::default();
        settle_within(1e-9, &mut needle, &rolled, &loads, &mut line);
        let nodes = line.nodes();
        let mut carried = rolled.rotation * Vector3::x();
        let mut before = rolled.rotation * Vector3::z();
        for pair in nodes[..nodes.len() - 1].windows(2) {
            let tangent = (pair[1].1 - pair[0].1).normalize();
            let turn = UnitQuaternion::rotation_between(&before, &tangent).expect("no reversal");
            (carried, before) = (turn * carried, tangent);
        }
        let end = nodes[nodes.len() - 2];
        let offset = line.tip() - (end.1 + before * (16.0f64 - 0.36).sqrt());
        assert!((offset - carried * 0.6).norm() < 1e-9, "{offset} {carried}");
        offset
    };
    offset(0.3, loads(200.0));
    let offsets = [0.0, 1.0, PI].map(|roll| offset(roll, loads(190.0)));
    assert!((offsets[0] + offsets[2]).norm() < 1e-9);
    assert!((offsets[0].angle(&offsets[1]) - 1.0).abs() < 1e-9);
}

/// Newton's method takes a few steps, however close an axial force is to the buckling force.
#[test]
fn it_settles() {
    let (base, stiffness) = (Isometry3::identity(), Stiffness::default().bending_nmm2());
    let buckling = PI * PI * stiffness / (4.0 * LENGTH * LENGTH);
    for share in [0.1, 0.5, 0.9] {
        let (mut needle, mut line) = (needle(10.0, None), CentreLine::default());
        // Deflections of some millimetres.
        let loads = [load(LENGTH, [0.02 * (1.0 - share), 0.0, -share * buckling])];
        let count = settle(&mut needle, &base, &loads, &mut line);
        assert!(count <= 8, "{share}: {count}");
        // Beam columns deflect more by 1 / (1 - share), to 2 % (the shape is not quite the buckling mode).
        let straight = loads[0].force_n.x * LENGTH.powi(3) / (3.0 * stiffness);
        let column = line.tip().x / straight;
        assert!((column * (1.0 - share) - 1.0).abs() < 0.02, "{share}: {column}");
        let settled = line.clone();
        needle.place(&base, None, &loads, &loads, &mut line);
        assert!(line.distance(&settled) < 1e-9);
    }
}

#[test]
fn a_bevel_tilts_the_last_part() {
    let loads = [load(195.0, [0.1, 0.0, 0.0])];
    let placed = |bevel| {
        let (mut needle, mut line) = (needle(10.0, bevel), CentreLine::default());
        settle(&mut needle, &slanted(), &loads, &mut line);
        line
    };
    let plain = placed(None);
    let zero = placed(Some(Bevel {
        r_mm: 0.0,
        length_mm: 4.0,
    }));
    assert_eq!(zero, plain);
    // Joints stay where they are if the bevel begins between them.
    let faint = placed(Some(Bevel {
        r_mm: 1e-9,
        length_mm: 33.0,
    }));
    for &(arc, point) in plain.nodes() {
        assert!((faint.point_at_arc(arc).point_mm - point).norm() < 1e-7);
    }
    // Within the last link, from a joint on, over several links, all of it.
    for (length_mm, nodes) in [(4.0, 23), (5.0, 22), (33.0, 23), (200.0, 22)] {
        let bevel = Bevel { r_mm: 0.6, length_mm };
        let (mut needle, mut line) = (needle(10.0, Some(bevel)), CentreLine::default());
        needle.place(&Isometry3::identity(), None, &[], &[], &mut line);
        assert_eq!(line.nodes().len(), nodes);
        let start = line.point_at_arc(LENGTH - length_mm).point_mm;
        assert!((start - Point3::new(0.0, 0.0, LENGTH - length_mm)).norm() < 1e-12);
        assert!((line.tip().x - 0.6).abs() < 1e-12 && line.tip().y == 0.0);
        assert!(((line.tip() - start).norm() - length_mm).abs() < 1e-12);
    }
}

#[test]
fn numbers_out_of_range_are_named() {
    let (shaft, bevel) = (Shaft::default(), BEVEL);
    let stiff = Stiffness::default();
    let spoiled = [
        (
            "length_mm",
            Shaft {
                length_mm: f64::NAN,
                ..shaft
            },
            stiff,
            10.0,
            bevel,
        ),
        (
            "radius_mm",
            Shaft {
                radius_mm: 0.0,
                ..shaft
            },
            stiff,
            10.0,
            bevel,
        ),
        ("kappa_nmm_per_deg", shaft, Stiffness::KappaNmmPerDeg(0.0), 10.0, bevel),
        (
            "bending_stiffness_nmm2",
            shaft,
            Stiffness::BendingNmm2(f64::INFINITY),
            10.0,
            bevel,
        ),
        ("link_mm", shaft, stiff, 201.0, bevel),
        ("link_mm", shaft, stiff, 0.1, bevel),
        ("link_mm", shaft, stiff, -10.0, bevel),
        (
            "bevel.r_mm",
            shaft,
            stiff,
            10.0,
            Bevel {
                r_mm: 5.1,
                length_mm: 9.0,
            },
        ),
        (
            "bevel.r_mm",
            shaft,
            stiff,
            10.0,
            Bevel {
                r_mm: 0.6,
                length_mm: 0.6,
            },
        ),
        (
            "bevel.length_mm",
            shaft,
            stiff,
            10.0,
            Bevel {
                r_mm: 0.0,
                length_mm: 0.0,
            },
        ),
        (
            "bevel.length_mm",
            shaft,
            stiff,
            10.0,
            Bevel {
                r_mm: 0.6,
                length_mm: 201.0,
            },
        ),
    ];
    for (key, shaft, stiffness, link_mm, bevel) in spoiled {
        let error = Flexible::springs(shaft, stiffness, link_mm, Some(bevel)).expect_err(key);
        assert_eq!(error.key, key);
        assert!(error.to_string().starts_with(&format!("`{key}` is ")), "{error}");
    }
}
