//! Whole insertions with the inverse on a GPU: the forces of the CPU, at every step.

use insonify_base::blame::Blame;
use insonify_mechanics::insertion::finite::{Finite, FiniteOptions, Setup};
use insonify_mechanics::insertion::{EventKind, Instruments, Interaction, Model, Outcome};
use insonify_mechanics::needle::{Rigid, Shaft};
use insonify_mechanics::remesh_gpu::maker;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::remesh::{Level, Precision};
use insonify_mesh::TetMesh;
use nalgebra::{Isometry3, Matrix4, Vector3};

use insonify_testing::gpu::gpu_or_skip;

/// Steps in, and as many out.
const WAY: usize = 150;
/// The farthest that forces in f32 may be from those in f64, over the largest force. Entries of the inverse are rounded
/// to 6e-8 of themselves; updates and the equations of the needle may make a hundred times as much of that. Forces of
/// two levels are 1e-4 apart.
const ALLOWED: f64 = 1e-5;
/// And those of two implementations in f32 from each other.
const ALIKE: f64 = 2.0 * ALLOWED;

/// A block of 60 x 60 x 80 mm at 10 kPa, held at its far end along z, and a rigid needle.
fn tissue(level: Level, precision: Precision) -> Setup {
    let to_world = Matrix4::new_nonuniform_scaling(&Vector3::new(60.0, 60.0, 80.0));
    let mesh = TetMesh::lattice([6, 6, 8], &to_world).unwrap();
    let held = (0..).zip(mesh.nodes()).filter(|(_, at)| at[2] == 80.0);
    Setup {
        materials: vec![Material::new(10.0, 0.45).unwrap(); mesh.elements().len()],
        fixed: held.flat_map(|(node, _)| [0, 1, 2].map(|axis| (node, axis))).collect(),
        interactions: vec![(
            0,
            Interaction {
                friction_n_per_mm: 0.02,
                cutting_n: 0.5,
                puncture_n: 1.0,
                ..Interaction::default()
            },
        )],
        anatomy: None,
        needle: Box::new(Rigid::new(Shaft::default(), None).unwrap()),
        probe: None,
        level,
        precision,
        options: FiniteOptions::default(),
        mesh,
    }
}

/// Through no plane of the lattice, 45 mm in and out again.
fn depth(step: usize) -> f64 {
    0.3 * WAY.abs_diff(step.abs_diff(WAY)) as f64
}

fn go(finite: &mut Finite, step: usize) -> Outcome {
    let instruments = Instruments {
        base: Isometry3::translation(31.3, 28.9, depth(step) - Shaft::default().length_mm),
        probe: None,
        guide: None,
        deposit: false,
    };
    finite.step(&instruments, 1e-3).unwrap().clone()
}

fn driven(mut finite: Finite) -> Vec<Outcome> {
    (1..=2 * WAY).map(|step| go(&mut finite, step)).collect()
}

/// The farthest that the force on the hand is apart at one step, N, and at which.
fn apart(a: &[Outcome], b: &[Outcome]) -> (f64, usize) {
    let each = a
        .iter()
        .zip(b)
        .map(|(a, b)| (a.on_hand.force_n - b.on_hand.force_n).norm());
    each.zip(1..)
        .fold((0.0, 0), |most, now| if now.0 > most.0 { now } else { most })
}

#[test]
fn a_whole_insertion_has_the_forces_of_the_cpu() {
    let gpu = gpu_or_skip();
    for level in [Level::I, Level::II, Level::III] {
        let single = || tissue(level, Precision::Single);
        let double = Finite::new(tissue(level, Precision::Double), |_, _| {}).unwrap();
        let double = driven(double);
        let cpu = driven(Finite::new(single(), |_, _| {}).unwrap());
        let largest = double.iter().map(|it| it.on_hand.force_n.norm()).fold(0.0, f64::max);
        let remeshes: usize = double.iter().map(|it| it.remeshes).sum();
        assert!(largest > 1.0 && remeshes >= 8, "{largest} N, {remeshes} remeshes");
        let check = |what: &str, (far, step): (f64, usize), allowed: f64| {
            println!("level {level}, {what}: {far:e} N of {largest} N at step {step}");
            assert!(
                far <= allowed * largest,
                "level {level}, {what}: {far} N of {largest} N at step {step}"
            );
        };
        check("CPU in f32", apart(&cpu, &double), ALLOWED);
        let Some(gpu) = &gpu else { continue };
        let device = driven(Finite::with_maker(single(), maker(gpu), |_, _| {}).unwrap());
        check("GPU", apart(&device, &double), ALLOWED);
        check("GPU against CPU, both in f32", apart(&device, &cpu), ALIKE);
        assert!(
            device
                .iter()
                .all(|it| it.events.iter().all(|event| event.kind != EventKind::DeviceLost))
        );
    }
}

#[test]
fn the_cpu_goes_on_where_a_device_fails_and_levels_change_on_it() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let single = || tissue(Level::I, Precision::Single);
    let cpu = driven(Finite::new(single(), |_, _| {}).unwrap());
    let mut finite = Finite::with_maker(single(), maker(&gpu), |_, _| {}).unwrap();
    let mut found: Vec<_> = (1..=60).map(|step| go(&mut finite, step)).collect();
    for level in [Level::Exact, Level::I] {
        let change = finite.set_level(level).unwrap();
        assert!(change.compliance_change < ALLOWED, "{change:?}");
    }
    gpu.simulate_loss().unwrap();
    found.extend((61..=2 * WAY).map(|step| go(&mut finite, step)));
    let lost = |outcome: &Outcome| outcome.events.iter().any(|event| event.kind == EventKind::DeviceLost);
    assert_eq!(found.iter().filter(|outcome| lost(outcome)).count(), 1);
    let largest = cpu.iter().map(|it| it.on_hand.force_n.norm()).fold(0.0, f64::max);
    let (far, step) = apart(&found, &cpu);
    assert!(far <= ALIKE * largest, "{far} N of {largest} N at step {step}");
}

#[test]
fn a_gpu_keeps_no_inverse_in_double_precision() {
    let Some(gpu) = gpu_or_skip() else {
        return;
    };
    let refused = Finite::with_maker(tissue(Level::I, Precision::Double), maker(&gpu), |_, _| {})
        .err()
        .unwrap();
    assert!(refused.to_string().contains("f32"), "{refused}");
    assert!(!refused.is_machine());
}
