//! The levels of remeshing along one insertion, the probe moved sideways midway (Goksel et al. 2011, figure 14).

use insonify::mechanics::insertion::{Instruments, Model, Outcome, ProbeContact};
use insonify::mechanics::tissue::remesh::{Level, Precision};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::support::{USUAL, build, setup, tip_at};

/// Needle in, probe towards it, needle half out.
fn run(level: Level, precision: Precision) -> Vec<Outcome> {
    let mut setup = setup(USUAL);
    let nodes = setup.mesh.nodes();
    let under = |node: &u32| {
        let [x, y, z] = nodes[*node as usize];
        y == 0.0 && (x - 30.0).abs() < 11.0 && (15.0..65.0).contains(&z)
    };
    let at = |y: f64| Isometry3::from_parts(Translation3::new(30.0, y - 10.0, 70.0), UnitQuaternion::identity());
    setup.probe = Some(ProbeContact {
        nominal: at(0.0),
        length_mm: 60.0,
        candidates: (0..nodes.len() as u32).filter(under).collect(),
        driven_at_mm: None,
    });
    (setup.level, setup.precision) = (level, precision);
    let mut finite = build(setup);
    let mut outcomes = Vec::new();
    for step in 0..320 {
        let step = f64::from(step);
        let depth = if step < 120.0 {
            0.4 * step
        } else {
            48.0 - 0.4 * (step - 200.0).max(0.0)
        };
        let aside = 0.1 * (step - 120.0).clamp(0.0, 60.0);
        let instruments = Instruments {
            probe: Some(at(aside)),
            ..tip_at([31.3, 21.9, depth])
        };
        outcomes.push(finite.step(&instruments, 1e-3).expect("a step").clone());
    }
    outcomes
}

/// The largest difference of the force on the hand, N.
fn difference(a: &[Outcome], b: &[Outcome]) -> f64 {
    let pairs = a.iter().zip(b);
    pairs
        .map(|(a, b)| (a.on_hand.force_n - b.on_hand.force_n).norm())
        .fold(0.0, f64::max)
}

#[test]
fn the_exact_level_equals_the_first_and_the_others_come_near() {
    let first = run(Level::I, Precision::Double);
    let largest = first.iter().map(|it| it.on_hand.force_n.norm()).fold(0.0, f64::max);
    let exact = difference(&run(Level::Exact, Precision::Double), &first);
    // Rounding of K^c (1e-10 relative) through a system of a condition of some 1e3.
    assert!(exact < 1e-6 * largest, "{exact:e} of {largest}");
    let third = difference(&run(Level::III, Precision::Double), &first);
    let fourth = difference(&run(Level::IV, Precision::Double), &first);
    assert!(
        third < 0.25 * largest && third < fourth,
        "III {third}, IV {fourth} of {largest}"
    );
    assert!(fourth < largest, "{fourth} of {largest}");
}
