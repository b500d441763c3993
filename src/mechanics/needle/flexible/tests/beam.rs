use super::*;

fn needle(element_mm: f64, bevel: Option<Bevel>) -> Flexible {
    Flexible::beam(Shaft::default(), Stiffness::default(), element_mm, bevel).expect("needle")
}

/// Nodes lie on the closed form of the cantilever under forces at nodes, with elements of any length: Hermite cubics
/// contain it.
#[test]
fn a_cantilever_bends_as_the_closed_form() {
    let stiffness = Stiffness::default().bending_nmm2();
    // Small: finite angles add (deflection / length)^2 of the deflection, 1e-9.
    let force = 1e-5;
    for element in [50.0, 25.0, 5.0, 1.0] {
        for (loaded_mm, seen) in [(200.0, 200.0), (100.0, 200.0), (200.0, 100.0), (100.0, 50.0)] {
            let (near, far) = (f64::min(loaded_mm, seen), f64::max(loaded_mm, seen));
            let beam = force * near * near * (3.0 * far - near) / (6.0 * stiffness);
            let (mut needle, mut line) = (needle(element, None), CentreLine::default());
            settle(
                &mut needle,
                &Isometry3::identity(),
                &[load(loaded_mm, [0.0, force, 0.0])],
                &mut line,
            );
            let deflection_mm = line.point_at_arc(seen).point_mm.y;
            assert!(
                (deflection_mm - beam).abs() < 1e-8 * beam,
                "{element} {loaded_mm} {seen}: {deflection_mm} {beam}"
            );
        }
    }
}

/// Forces between nodes converge to the closed form with the square of the length of elements.
#[test]
fn forces_between_nodes_converge() {
    let stiffness = Stiffness::default().bending_nmm2();
    let (force, arc_mm) = (1e-5, 93.0);
    let beam = force * arc_mm * arc_mm * arc_mm / (3.0 * stiffness);
    let error = |element: f64| {
        let (mut needle, mut line) = (needle(element, None), CentreLine::default());
        settle(
            &mut needle,
            &Isometry3::identity(),
            &[load(arc_mm, [force, 0.0, 0.0])],
            &mut line,
        );
        (line.point_at_arc(arc_mm).point_mm.x - beam).abs()
    };
    // The polyline cuts the curve by at most h^2/8 of the curvature, and the force acts on the chord: h^3/(48 EI).
    for element in [20.0f64, 10.0, 4.0] {
        let bound =
            force * arc_mm * element * element / (8.0 * stiffness) + force * element.powi(3) / (48.0 * stiffness);
        assert!(error(element) < bound, "{element}: {} {bound}", error(element));
    }
    assert!(error(4.0) < 0.1 * error(20.0));
}

/// The elastica: a dead force across the tip of a cantilever, P L^2/EI = 1, 2 and 5 (K. E. Bisshopp and D. C. Drucker,
/// "Large deflection of cantilever beams", 1945: tip deflections over the length of 0.30172, 0.49346 and 0.71379).
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
        // The published values have five digits; elements of 2 mm turn by 0.05 rad at most, (0.05)^2/10 of which is
        // 2e-4 of that part.
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
    let [mut beam_line, mut spring_line] = [CentreLine::default(), CentreLine::default()];
    settle(&mut beam, &base, &loads, &mut beam_line);
    settle(&mut springs, &base, &loads, &mut spring_line);
    let straight = base * Point3::new(0.0, 0.0, LENGTH);
    let bent = (beam_line.tip() - straight).norm();
    // h^2/(4 L^2) of the deflection is 2.5e-5 of it; levers of a tilted needle add as much again, and more.
    assert!(
        bent > 10.0 && (beam_line.tip() - spring_line.tip()).norm() < 3e-4 * bent,
        "{} of {bent}",
        beam_line.tip() - spring_line.tip()
    );
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
