//! The levels of remeshing along one insertion, the probe moved sideways midway (Goksel et al. 2011, figure 14).

use insonify_mechanics::insertion::{Instruments, Model, Outcome, ProbeContact};
use insonify_mechanics::tissue::remesh::{Level, Precision};
use nalgebra::{Isometry3, Translation3, UnitQuaternion};

use super::support::{USUAL, build, go, setup, tip_at, travel};

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

#[test]
fn the_level_changes_with_the_needle_in() {
    let new = || {
        let mut setup = setup(USUAL);
        // Forces come to rest so closely that what is left of a jump is rounding.
        setup.options.tolerance_mm = 1e-12;
        build(setup)
    };
    let mut finite = new();
    travel(&mut finite, 0.0, 30.0, 0.1);
    assert!(finite.support_size() > 0);
    // A step acts on the tip where the one before has found it: held in place, they come to rest.
    let before = [0; 10].map(|_| go(&mut finite, 30.0).on_hand)[9];
    assert!(before.force_n.norm() > 0.5, "{before:?}");
    let mut from = Level::Exact;
    for to in [Level::I, Level::III, Level::IV, Level::II, Level::Exact] {
        let change = finite.set_level(to).expect("a level");
        assert_eq!((change.from, change.to), (from, to));
        assert_eq!(finite.adaptation().remesher().level(), to);
        // The mesh has not changed since level I, so all are current.
        assert!(
            change.force_jump_n < 1e-9 && change.compliance_change < 1e-9,
            "{change:?}"
        );
        from = to;
    }
    let after = finite.outcome().on_hand;
    assert!((after.force_n - before.force_n).norm() < 1e-9, "{before:?} {after:?}");
    assert!(
        (after.torque_nmm - before.torque_nmm).norm() < 1e-6,
        "{before:?} {after:?}"
    );

    // Level IV leaves what remeshing changes; at the exact level it is there again, as in a model that was always at
    // it.
    finite.set_level(Level::IV).expect("a level");
    travel(&mut finite, 30.0, 50.0, 0.1);
    let change = finite.set_level(Level::Exact).expect("a level");
    assert!(
        change.compliance_change > 1e-3 && change.force_jump_n > 1e-4,
        "{change:?}"
    );
    let mut other = new();
    other.restore(&finite.save()).expect("a state");
    let [own, expected] = [&finite, &other].map(|finite| finite.adaptation().remesher().condensed());
    assert!((own - expected).norm_max() < 1e-9 * expected.norm_max());
    let again = finite.set_level(Level::Exact).expect("the same");
    assert!(again.force_jump_n < 1e-9, "{again:?}");
}
