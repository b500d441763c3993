//! A block of tissue, and a hand that moves a needle.

use insonify_mechanics::block;
pub(super) use insonify_mechanics::block::USUAL;
use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::insertion::{Event, EventKind, Instruments, Interaction, Model, Outcome};
use insonify_mechanics::needle::{Needle, Rigid, Shaft};
use insonify_mechanics::tissue::material::Material;
use insonify_mesh::TetMesh;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};

/// Length of the needle, mm.
pub(super) const LENGTH: f64 = 150.0;

/// A block from the origin to `extent`, in cells of about `cell` mm, one region 0.
pub(super) fn block(extent: [f64; 3], cell: f64) -> TetMesh {
    block::plain(extent, cell).expect("a lattice")
}

/// The same, each cell the mirror image of its neighbours: a needle along planes between them is drawn aside by nothing
/// in the mesh.
pub(super) fn mirrored(extent: [f64; 3], cell: f64) -> TetMesh {
    block::mirrored(extent, cell).expect("a lattice")
}

/// Tissue on a table: a block of 60 x 60 x 80 mm, entered at z = 0, held at z = 80.
pub(super) fn setup(interaction: Interaction) -> Setup {
    on_table(block([60.0, 60.0, 80.0], 10.0), interaction)
}

/// The same of another block: held at its far end along z.
pub(super) fn on_table(mesh: TetMesh, interaction: Interaction) -> Setup {
    let material = Material::new(10.0, 0.45).expect("a material");
    block::on_table(mesh, material, interaction, rigid())
}

pub(super) fn rigid() -> Box<dyn Needle> {
    let shaft = Shaft {
        length_mm: LENGTH,
        ..Shaft::default()
    };
    Box::new(Rigid::new(shaft, None).expect("a needle"))
}

pub(super) fn build(setup: Setup) -> Finite {
    Finite::new(setup, |_, _| {}).expect("a setup")
}

/// A needle along z whose tip would be at `tip` if nothing bent it.
pub(super) fn tip_at(tip: [f64; 3]) -> Instruments {
    Instruments {
        base: Isometry3::from_parts(
            Translation3::new(tip[0], tip[1], tip[2] - LENGTH),
            UnitQuaternion::identity(),
        ),
        probe: None,
        guide: None,
        deposit: false,
    }
}

/// Point of entry: no plane of the lattice runs through it.
pub(super) const ASIDE: [f64; 2] = [31.3, 28.9];

/// One step to a depth.
pub(super) fn go(finite: &mut Finite, z: f64) -> Outcome {
    finite
        .step(&tip_at([ASIDE[0], ASIDE[1], z]), 1e-3)
        .expect("a step")
        .clone()
}

/// Steps from a depth to another, the last one to the bit there; the outcomes.
pub(super) fn travel(finite: &mut Finite, from: f64, to: f64, step: f64) -> Vec<Outcome> {
    let steps = ((to - from).abs() / step).ceil() as usize;
    (1..=steps)
        .map(|n| go(finite, from + (to - from) * n as f64 / steps as f64))
        .collect()
}

/// Events of some steps.
pub(super) fn events(outcomes: &[Outcome]) -> Vec<Event> {
    outcomes
        .iter()
        .flat_map(|outcome| outcome.events.iter().copied())
        .collect()
}

/// The kinds of it.
pub(super) fn kinds(outcomes: &[Outcome]) -> Vec<EventKind> {
    events(outcomes).iter().map(|event| event.kind).collect()
}

/// Everything in an outcome is finite.
pub(super) fn assert_finite(outcome: &Outcome) {
    let wrench = outcome.on_hand.force_n.iter().chain(outcome.on_hand.torque_nmm.iter());
    let probe = outcome
        .on_probe
        .iter()
        .flat_map(|wrench| wrench.force_n.iter().chain(wrench.torque_nmm.iter()));
    let tip = outcome.tip_mm.coords.iter();
    assert!(wrench.chain(probe).chain(tip).all(|x| x.is_finite()), "{outcome:?}");
    assert!(
        outcome.tip_deflection_mm.is_finite() && outcome.inserted_mm.is_finite(),
        "{outcome:?}"
    );
}

/// The force that pushes the needle back out, N.
pub(super) fn resistance(outcome: &Outcome) -> f64 {
    -outcome.on_hand.force_n.z
}

/// A point of the axis of the path.
pub(super) fn on_path(z: f64) -> Point3<f64> {
    Point3::new(ASIDE[0], ASIDE[1], z)
}
