//! Flexible needles.

use nalgebra::Vector3;

use super::super::testing::*;
use super::super::*;
use crate::insertion::Interaction;

/// A needle a thousand times softer than usual cannot be pushed against friction: tissue then has none.
fn with_beam(young_kpa: f64, ei: f64) -> MassSpring {
    let parameters = MassSpringParameters { young_kpa, ..coarse() };
    let needle = Box::new(Beam { length_mm: 150.0, ei });
    let tissue = if ei < 100.0 { Interaction::default() } else { soft() };
    MassSpring::new(parameters, Box::new(Layers::one(tissue)), needle).unwrap()
}

/// Returns the largest distance of the nodes from the shaft, mm.
fn gap(springs: &MassSpring) -> f64 {
    let distances = springs.contacts.stack.iter().map(|contact| {
        let on_shaft = springs.body.line.point_at_arc(contact.arc);
        let miss = springs.network.now(contact.node) - on_shaft.point_mm.coords;
        (miss - on_shaft.tangent.into_inner() * on_shaft.tangent.dot(&miss)).norm()
    });
    distances.fold(0.0, f64::max)
}

/// Inserted 50 mm and moved 3 mm aside at the base: needle and tissue come to rest together, where the needle bends
/// just so that tissue exerts the forces that bend it. A needle stiff relative to the tissue moves it, a soft one
/// stays.
#[test]
fn needle_and_tissue_find_each_other() {
    let mut tips = Vec::new();
    for (young_kpa, ei) in [(10.0, 6e3), (10.0, 6e6), (10.0, 6.0), (0.1, 6e3), (1e3, 6e3)] {
        let mut springs = with_beam(young_kpa, ei);
        drive(&mut springs, [-2.0, 50.0], 100.0, 1e-3, |_| {});
        let before = springs.outcome.tip_mm;
        for step in 1..=100 {
            springs
                .step(&tip_at(0.3 + 0.03 * step as f64, 0.2, 50.0), 1e-3)
                .unwrap();
            assert!(springs.outcome.on_hand.force_n.norm() < 30.0, "{young_kpa} {ei} {step}");
        }
        // The softest tissue takes a second to lose a third of its remaining motion.
        for _ in 0..60 {
            springs.step(&tip_at(3.3, 0.2, 50.0), 0.4).unwrap();
        }
        let (force, line) = (springs.outcome.on_hand.force_n, springs.body.line.clone());
        springs.step(&tip_at(3.3, 0.2, 50.0), 0.05).unwrap();
        assert!(
            (springs.outcome.on_hand.force_n - force).norm() < 1e-6 * force.norm() + 1e-9,
            "{young_kpa} {ei}"
        );
        assert!(line.distance(&springs.body.line) < 1e-6, "{young_kpa} {ei}");
        // The polyline of the needle has chords of 5 mm.
        assert!(gap(&springs) < 0.02, "{young_kpa} {ei} {}", gap(&springs));
        tips.push(springs.outcome.tip_mm.x - before.x);
    }
    let [usual, stiff, soft, in_soft, in_stiff] = tips[..] else {
        panic!()
    };
    // 1.5 N of tissue bend the stiff one by 0.3 mm.
    assert!((stiff - 3.0).abs() < 0.5, "{tips:?}");
    assert!(soft.abs() < 0.01 && in_stiff.abs() < 0.01, "{tips:?}");
    assert!(usual < in_soft && in_soft < stiff, "{tips:?}");
}

/// The static shape computed independently: with the displacement of the tissue at the nodes given, the force on each
/// node from the springs alone bends the beam to where the nodes are.
#[test]
fn forces_of_springs_bend_the_needle() {
    let mut springs = with_beam(10.0, 6e3);
    drive(&mut springs, [-2.0, 50.0], 100.0, 1e-3, |_| {});
    for _ in 0..40 {
        springs.step(&tip_at(3.3, 0.2, 50.0), 0.1).unwrap();
    }
    springs.network.find_forces();
    for contact in &springs.contacts.stack {
        let mut position = Vector3::new(3.3, 0.2, 0.0);
        for loaded in &springs.contacts.stack {
            let tangent = springs.body.line.point_at_arc(loaded.arc).tangent;
            let force = springs.network.force[loaded.node as usize];
            // Only the component across the shaft bends it.
            let force = force - tangent.into_inner() * tangent.dot(&force);
            let (near, far) = (contact.arc.min(loaded.arc), contact.arc.max(loaded.arc));
            position += Vector3::new(force.x, force.y, 0.0) * (near * near * (3.0 * far - near) / (6.0 * 6e3));
        }
        let now = springs.network.now(contact.node);
        // Chords of 5 mm, and shaft directions that turn with the needle.
        assert!((now - position).xy().norm() < 0.02, "{now} {position}");
    }
}

/// Needles a thousand times stiffer and softer in tissue of 0.1 kPa to 1 MPa, shaken at the base at every step:
/// bounded.
#[test]
fn shaken_needles_do_not_run_away() {
    for young_kpa in [0.1, 10.0, 1e3] {
        for ei in [6.0, 6e3, 6e6] {
            let mut springs = with_beam(young_kpa, ei);
            drive(&mut springs, [-2.0, 40.0], 200.0, 1e-3, |_| {});
            let mut halves = [0.0f64; 2];
            for step in 0..200 {
                let x = if step % 2 == 0 { 0.5 } else { 0.1 };
                let force = springs
                    .step(&tip_at(x, 0.2, 40.0), 1e-3)
                    .unwrap()
                    .on_hand
                    .force_n
                    .norm();
                assert!(force.is_finite());
                halves[step / 100] = halves[step / 100].max(force);
            }
            // An instability grows by a factor in every substep.
            assert!(halves[1] <= 1.5 * halves[0], "{young_kpa} {ei} {halves:?}");
        }
    }
}
