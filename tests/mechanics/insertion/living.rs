//! Tissue that moves by itself.

use std::sync::Arc;

use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::insertion::{Instruments, Model, Outcome, Snapshot, Tissue, TissueMotion};
use insonify_mechanics::needle::{Bevel, Flexible, Needle, Shaft, Stiffness};
use nalgebra::{Translation3, Vector3};

use super::support::{ASIDE, LENGTH, USUAL, build, rigid, setup, tip_at};

const DT_S: f64 = 1e-3;
/// Steps are solved to 1e-5 mm, at some newtons per mm of tissue.
const SAME_N: f64 = 2e-4;

fn bent() -> Box<dyn Needle> {
    let shaft = Shaft {
        length_mm: LENGTH,
        ..Shaft::default()
    };
    let bevel = Bevel {
        r_mm: 0.6,
        length_mm: 10.0,
    };
    let stiffness = Stiffness::default();
    Box::new(Flexible::beam(shaft, stiffness, 10.0, Some(bevel)).expect("a needle"))
}

/// A block whose nodes at rest move by `by(node)` times a share of time.
fn living(
    needle: Box<dyn Needle>,
    by: impl Fn(&[f64; 3]) -> [f64; 3],
    share_at: impl Fn(f64) -> f64 + Send + Sync + 'static,
) -> Finite {
    let of_block = Setup { needle, ..setup(USUAL) };
    let mut finite = build(of_block);
    let displacements = finite.mesh().nodes().iter().map(by).collect();
    finite.live(vec![TissueMotion {
        displacements,
        share_at: Arc::new(share_at),
    }]);
    finite
}

fn inward(z: f64) -> Instruments {
    tip_at([ASIDE[0], ASIDE[1], z])
}

fn shifted(instruments: &Instruments, by: Vector3<f64>) -> Instruments {
    Instruments {
        base: Translation3::from(by) * instruments.base,
        ..*instruments
    }
}

fn same(a: &Outcome, b: &Outcome, by: Vector3<f64>) {
    let difference = (a.on_hand.force_n - b.on_hand.force_n).norm();
    assert!(difference < SAME_N, "{:?} {:?}", a.on_hand, b.on_hand);
    assert!((a.tip_mm + by - b.tip_mm).norm() < 1e-4, "{} {}", a.tip_mm, b.tip_mm);
    assert_eq!((a.contacts, a.events.len()), (b.contacts, b.events.len()));
}

/// A needle that goes along with a body that moves as a whole, or lies elsewhere, feels what it feels in one at rest; one
/// held still against it feels what a needle feels that is moved the other way.
#[test]
fn only_motion_relative_to_the_tissue_is_felt() {
    const BY: [f64; 3] = [7.0, -4.0, -11.0];
    type Share = fn(f64) -> f64;
    let breath: Share = |time_s| (12.0 * time_s).sin().powi(2);
    let elsewhere: Share = |_| 0.8;
    for needle in [rigid as fn() -> Box<dyn Needle>, bent] {
        for share_at in [breath, elsewhere] {
            let mut still = build(Setup {
                needle: needle(),
                ..setup(USUAL)
            });
            let mut moving = living(needle(), |_| BY, share_at);
            let mut force_n = 0.0f64;
            // In by 35 mm, a pause, and out.
            let depths =
                (0..240).map(|step| 0.25 * f64::from(step.min(160)) - 5.0 - 0.25 * f64::from((step - 200).max(0)));
            for (step, z) in depths.enumerate() {
                let by = Vector3::from(BY) * share_at((step + 1) as f64 * DT_S);
                let at_rest = still.step(&inward(z), DT_S).expect("a step").clone();
                let along = moving.step(&shifted(&inward(z), by), DT_S).expect("a step");
                same(&at_rest, along, by);
                force_n = force_n.max(at_rest.on_hand.force_n.norm());
            }
            assert!(force_n > 1.0, "{force_n} N");
        }
    }
    // Both have a needle 30 mm deep; then the tissue goes by 1.5 mm, or the needle by as much the other way.
    let late: Share = |time_s| 0.1 * (time_s - 0.14).clamp(0.0, 0.015) / 0.015;
    let (mut still, mut moving) = (build(setup(USUAL)), living(rigid(), |_| BY, late));
    for step in 1..=170 {
        let z = 0.25 * f64::from(step.min(140)) - 5.0;
        let by = Vector3::from(BY) * late(f64::from(step) * DT_S);
        let against = still.step(&shifted(&inward(z), -by), DT_S).expect("a step").clone();
        let held = moving.step(&inward(z), DT_S).expect("a step");
        same(&against, held, by);
        if step == 170 {
            // It is taken along, sideways and out of the body.
            let force = held.on_hand.force_n;
            assert!(force.x > 0.05 && force.y < -0.03, "{force}");
        }
    }
}

/// While the breath is held nothing changes, and the picture has the nodes where the motion and the needle put them.
#[test]
fn a_held_breath_changes_nothing() {
    let shear = |node: &[f64; 3]| [0.1 * node[2], 0.0, 0.0];
    let held = |time_s: f64| (time_s / 0.05).min(1.0);
    let mut finite = living(rigid(), shear, held);
    for step in 0..150 {
        finite
            .step(&inward(0.25 * f64::from(step.min(120)) - 5.0), DT_S)
            .expect("a step");
    }
    let before = finite.outcome().on_hand.force_n;
    assert!(before.norm() > 0.1);
    for _ in 0..20 {
        let outcome = finite.step(&inward(25.0), DT_S).expect("a step");
        assert!((outcome.on_hand.force_n - before).norm() < 1e-6, "{before}");
    }
    let mut alone = living(rigid(), shear, held);
    for _ in 0..60 {
        alone.step(&inward(-20.0), DT_S).expect("a step");
    }
    let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
    alone.snapshot(&mut snapshot);
    alone.imager().tissue(&snapshot, &mut tissue);
    for (rest, now) in tissue.reference.iter().zip(&tissue.current) {
        assert!((now[0] - rest[0] - 0.1 * rest[2]).abs() < 1e-12 && now[1..] == rest[1..]);
    }
    // Nodes on the needle lie on it, wherever remeshing has moved them.
    finite.snapshot(&mut snapshot);
    finite.imager().tissue(&snapshot, &mut tissue);
    for (node, _, _) in finite.contact_forces() {
        let [x, y, _] = tissue.current[node as usize];
        assert!((x - ASIDE[0]).hypot(y - ASIDE[1]) < 0.05, "{x} {y}");
    }
}
