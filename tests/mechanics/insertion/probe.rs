//! A probe that presses on the tissue.

use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::insertion::{Instruments, Model, Outcome, ProbeContact, Snapshot, Tissue};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::support::{USUAL, build, setup, tip_at};

const NOMINAL: [f64; 3] = [30.0, -10.0, 70.0];

fn pose(shift: [f64; 3]) -> Isometry3<f64> {
    let at = [0, 1, 2].map(|axis| NOMINAL[axis] + shift[axis]);
    Isometry3::from_parts(Translation3::from(at), UnitQuaternion::identity())
}

/// Tissue with a probe along z under its face y = 0, every n-th node under it a candidate.
fn pressed(every: usize) -> Setup {
    let mut setup = setup(USUAL);
    let nodes = setup.mesh.nodes();
    let under = |node: &u32| {
        let [x, y, z] = nodes[*node as usize];
        y == 0.0 && (x - 30.0).abs() < 11.0 && (15.0..65.0).contains(&z)
    };
    setup.probe = Some(ProbeContact {
        nominal: pose([0.0; 3]),
        length_mm: 60.0,
        candidates: (0..nodes.len() as u32).filter(under).step_by(every).collect(),
        driven_at_mm: None,
    });
    setup
}

fn press(finite: &mut Finite, shift: [f64; 3]) -> Outcome {
    let instruments = Instruments {
        probe: Some(pose(shift)),
        ..tip_at([31.3, 28.9, -5.0])
    };
    finite.step(&instruments, 1e-3).expect("a step").clone()
}

/// Pushed in, the probe is pushed back in proportion; tissue follows it across its axis and slides along it.
#[test]
fn the_probe_feels_tissue_and_slides_along_it() {
    let mut finite = build(pressed(1));
    let at_rest = press(&mut finite, [0.0; 3]);
    assert_eq!(
        (
            at_rest.probe_contacts,
            at_rest.on_probe.expect("a probe").force_n.norm()
        ),
        (15, 0.0)
    );
    let force = |finite: &mut Finite, shift| press(finite, shift).on_probe.expect("a probe").force_n;
    let one = force(&mut finite, [0.0, 1.0, 0.0]);
    let two = force(&mut finite, [0.0, 2.0, 0.0]);
    assert!(one.y < 0.0 && one.z.abs() < 1e-9, "{one:?}");
    assert!((two - one * 2.0).norm() < 1e-9, "linear: {one:?} {two:?}");
    // Along its axis nothing resists; only the nodes beside it change.
    let along = force(&mut finite, [0.0, 2.0, 3.0]);
    assert!((along - two).norm() < 1e-9, "{along:?}");

    let mut imager = finite.imager();
    let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
    finite.snapshot(&mut snapshot);
    imager.tissue(&snapshot, &mut tissue);
    let candidates = pressed(1).probe.expect("a probe").candidates;
    for node in candidates {
        let (from, to) = (tissue.reference[node as usize], tissue.current[node as usize]);
        assert!(
            (to[0] - from[0]).abs() < 1e-9 && (to[1] - from[1] - 2.0).abs() < 1e-9,
            "{from:?} {to:?}"
        );
    }
    // Taken away, it leaves nothing behind.
    let away = finite.step(&tip_at([31.3, 28.9, -5.0]), 1e-3).expect("a step").clone();
    assert_eq!((away.on_probe, away.probe_contacts), (None, 0));
    finite.snapshot(&mut snapshot);
    imager.tissue(&snapshot, &mut tissue);
    assert_eq!(tissue.current, tissue.reference);
}

/// The frame of contact does not roll with the probe, but turns with its axis.
#[test]
fn rolling_the_probe_changes_nothing() {
    let mut finite = build(pressed(1));
    let plain = press(&mut finite, [0.0, 2.0, 0.0]).on_probe.expect("a probe");
    let mut rolled = pose([0.0, 2.0, 0.0]);
    rolled.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7);
    let instruments = Instruments {
        probe: Some(rolled),
        ..tip_at([31.3, 28.9, -5.0])
    };
    let turned = finite
        .step(&instruments, 1e-3)
        .expect("a step")
        .on_probe
        .expect("a probe");
    assert!((turned.force_n - plain.force_n).norm() < 1e-9);
}

/// Fewer candidates hold less: a looser coupling, to be measured as a trade.
#[test]
fn thinning_loosens_the_coupling() {
    let force = |every| {
        press(&mut build(pressed(every)), [0.0, 2.0, 0.0])
            .on_probe
            .expect("a probe")
            .force_n
            .y
    };
    let [all, half] = [force(1), force(2)];
    assert!(half.abs() < all.abs() && half.abs() > 0.3 * all.abs(), "{all} {half}");
}

/// The force of the probe split between two points of its axis: as a lever has it.
#[test]
fn two_driving_points_share_the_force() {
    let mut setup = pressed(1);
    if let Some(probe) = &mut setup.probe {
        probe.driven_at_mm = Some([10.0, 50.0]);
    }
    let contact = setup.probe.clone().expect("a probe");
    let mut finite = build(setup);
    let wrench = press(&mut finite, [0.0, 2.0, 0.0]).on_probe.expect("a probe");
    let [first, second] = contact.split(&wrench, &pose([0.0, 2.0, 0.0])).expect("driving points");
    assert!((first + second - wrench.force_n).norm() < 1e-9);
    // The same torque about the probe's origin, across its axis.
    let at = |behind: f64| Vector3::new(0.0, 0.0, -behind);
    let torque = at(10.0).cross(&first) + at(50.0).cross(&second);
    assert!(
        (torque - wrench.torque_nmm).xy().norm() < 1e-6,
        "{torque:?} {:?}",
        wrench.torque_nmm
    );
}

/// A needle in, then the probe moved towards it: the hand that holds the needle still feels it sideways (figure 13b).
#[test]
fn a_probe_beside_a_needle_is_felt_by_the_hand() {
    let mut finite = build(pressed(1));
    let mut last = Outcome::default();
    for step in 0..180 {
        let instruments = Instruments {
            probe: Some(pose([0.0; 3])),
            ..tip_at([31.3, 20.9, 0.25 * f64::from(step)])
        };
        last = finite.step(&instruments, 1e-3).expect("a step").clone();
    }
    let before = last.on_hand.force_n.y;
    for step in 0..40 {
        let instruments = Instruments {
            probe: Some(pose([0.0, 0.1 * f64::from(step), 0.0])),
            ..tip_at([31.3, 20.9, 44.75])
        };
        last = finite.step(&instruments, 1e-3).expect("a step").clone();
        assert!(last.converged);
    }
    assert!(last.on_hand.force_n.y > before + 0.1, "{before} {last:?}");
}

/// What is not named is not there: no probe, no candidates.
#[test]
fn without_a_probe_nothing_of_it_is_built() {
    let mut finite = build(setup(USUAL));
    let outcome = press(&mut finite, [0.0, 5.0, 0.0]);
    assert_eq!((outcome.on_probe, outcome.probe_contacts), (None, 0));
    assert!(finite.adaptation().remesher().contacts().is_empty());
    let with = build(pressed(1));
    assert_eq!(with.adaptation().remesher().contacts().len(), 45);
}

/// Nodes that the probe does not reach, or has passed, are free.
#[test]
fn nodes_beyond_the_end_are_free() {
    let mut finite = build(pressed(1));
    let all = press(&mut finite, [0.0, 1.0, 0.0]).probe_contacts;
    let fewer = press(&mut finite, [0.0, 1.0, -20.0]).probe_contacts;
    let none = press(&mut finite, [0.0, 1.0, -80.0]);
    assert!(fewer < all && fewer > 0);
    assert_eq!(
        (none.probe_contacts, none.on_probe.map(|wrench| wrench.force_n.norm())),
        (0, Some(0.0))
    );
}
