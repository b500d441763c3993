//! Warp between states that both move: tissue moves the current nodes, remeshing the reference nodes.

use insonify_base::random::{hash3, unit};
use insonify_imaging::effects::Effects;
use insonify_imaging::effects::warp::{BACKGROUND, MAPPED};
use insonify_imaging::synth::tables::Anatomy;
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use insonify_mesh::{Displacement, InvalidMesh, TetMesh};
use nalgebra::Vector3;

use super::case::{Case, check_all};
use super::scenes;
use crate::support::gpu::{backend, gpu_or_skip};
use crate::support::scene::{self, SHAPES};

/// Every third node inside the mesh moved by up to `amount` mm along each axis; the surface stays.
fn remeshed(mesh: &TetMesh, amount: f64, seed: u32) -> Vec<[f64; 3]> {
    let [low, high] = mesh.bounds();
    let nodes = mesh.nodes().iter().enumerate();
    nodes
        .map(|(index, node)| {
            let inside = (0..3).all(|axis| node[axis] > low[axis] + 1e-6 && node[axis] < high[axis] - 1e-6);
            if !inside || index % 3 != 0 {
                return *node;
            }
            std::array::from_fn(|axis| {
                let drawn = f64::from(unit(hash3([index as i32, axis as i32, 0], [seed, 5])[0]));
                node[axis] + amount * (2.0 * drawn - 1.0)
            })
        })
        .collect()
}

/// All nodes moved towards the middle: two thirds of the size.
fn shrunk(mesh: &TetMesh) -> Vec<[f64; 3]> {
    let [low, high] = mesh.bounds();
    let along = |axis: usize, x: f64| 0.5 * (low[axis] + high[axis]) / 3.0 + x * 2.0 / 3.0;
    let nodes = mesh.nodes().iter();
    nodes
        .map(|node| std::array::from_fn(|axis| along(axis, node[axis])))
        .collect()
}

/// The pressed anatomy, its reference nodes moved, and the current ones to where `field` takes those.
fn moved(reference: impl Fn(&TetMesh) -> Vec<[f64; 3]>, field: &Displacement) -> (Anatomy, FrameState) {
    let (anatomy, mut state) = scenes::pressed();
    let reference = reference(anatomy.mesh.as_deref().expect("a mesh"));
    let mut nodes = Vec::new();
    field.displace(&reference, &mut nodes);
    (state.nodes, state.reference) = (Some(nodes), Some(reference));
    (anatomy, state)
}

fn swirl() -> Displacement {
    Displacement::Swirl {
        centre_mm: [31.0, -44.0, 57.0],
        axis: [0.3, 0.2, 1.0],
        angle_deg: 25.0,
        radius_mm: 12.0,
    }
}

/// Shears and stretches.
fn affine() -> Displacement {
    Displacement::Affine {
        matrix: [
            [1.05, 0.2, 0.0, 7.0],
            [-0.1, 0.9, 0.15, 1.0],
            [0.0, 0.1, 1.1, -3.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
    }
}

#[test]
fn every_effect_on_remeshed_tissue_under_every_probe_shape() {
    let (anatomy, state) = moved(|mesh| remeshed(mesh, 1.5, 1), &swirl());
    let cases: Vec<Case> = SHAPES
        .iter()
        .enumerate()
        .map(|(at, &(name, shape))| {
            // Speckle carries directions through the elements too.
            let effects = [scene::bare(), Effects::all()][at % 2].clone();
            let settings = scene::settings(scene::probe(shape, 40.0, 24, 96), effects);
            Case::new(format!("{name}, remeshed"), anatomy.clone(), settings, state.clone())
        })
        .collect();
    check_all(&cases);
}

#[test]
fn the_background_is_where_the_moved_reference_mesh_was() {
    let away = Displacement::Affine {
        matrix: [
            [1.0, 0.0, 0.0, 3.0],
            [0.0, 1.0, 0.0, 4.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
    };
    // The tissue of the shrunk mesh moves half out of it.
    let (anatomy, state) = moved(shrunk, &away);
    let settings = scene::settings(scene::small_probe(), scene::bare());
    let case = Case::new("shrunk", anatomy, settings, state);
    let mut exact = case.exact().expect("the reference");
    let world = exact.render_until("geometry", &case.state).expect("positions");
    let warped = exact.render_until("warp", &case.state).expect("positions");
    let reference = case.state.reference.as_ref().expect("reference nodes");
    let bounds = |axis: usize| {
        let along = reference.iter().map(|node| node[axis]);
        along.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)))
    };
    let bounds = [bounds(0), bounds(1), bounds(2)];
    let inside = |p: [f64; 3]| (0..3).all(|axis| p[axis] > bounds[axis].0 && p[axis] < bounds[axis].1);
    let (mut mapped, mut background) = (0, 0);
    for (before, after) in world.position.iter().zip(&warped.position) {
        let [x, y, z, _] = *before;
        if inside([x - 3.0, y - 4.0, z]) {
            assert_eq!(after[3], f64::from(MAPPED), "{before:?}");
            assert!(
                (after[0] - x + 3.0).abs().max((after[1] - y + 4.0).abs()) < 1e-11,
                "{before:?} {after:?}"
            );
            mapped += 1;
        } else {
            assert_eq!(after[3] == f64::from(BACKGROUND), inside([x, y, z]), "{before:?}");
            background += usize::from(inside([x, y, z]));
        }
    }
    assert!(
        mapped > 200 && background > 50,
        "{mapped} mapped, {background} background"
    );
    check_all(&[case]);
}

#[test]
fn under_an_affine_map_remeshing_changes_nothing() {
    let settings = scene::settings(scene::small_probe(), Effects::all());
    let (anatomy, plain) = moved(|mesh| mesh.nodes().to_vec(), &affine());
    let (_, state) = moved(|mesh| remeshed(mesh, 2.0, 2), &affine());
    assert_ne!(plain.reference, state.reference);
    let case = Case::new("affine", anatomy, settings, state);
    let mut exact = case.exact().expect("the reference");
    for pass in ["warp", "speckle_lateral", "tone"] {
        let [expected, found] = [&plain, &case.state].map(|state| exact.render_until(pass, state).expect("a beam"));
        assert_eq!(found.label, expected.label, "{pass}");
        let count = found.position.iter().filter(|p| p[3] == f64::from(MAPPED)).count();
        assert!(count > 500, "{count} samples are mapped");
        for (index, (a, b)) in found.position.iter().zip(&expected.position).enumerate() {
            // Coordinates of 100 mm; the map is a few dozen operations on them, and elements no flatter than 1 to 100.
            let off = (0..4).map(|axis| (a[axis] - b[axis]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-11, "{pass}: sample {index} is off by {off} mm");
        }
        let brightest = expected.amplitude.iter().fold(0.0f64, |a, &b| a.max(b));
        for (index, (a, b)) in found.amplitude.iter().zip(&expected.amplitude).enumerate() {
            // Textures and scatterers change by no more than themselves in a tenth of a millimetre. Grey levels are the
            // logarithm of amplitudes down to 1e-6 of the brightest.
            let allowed = if pass == "tone" { 1e-4 } else { 1e-9 } * brightest;
            assert!((a - b).abs() <= allowed, "{pass}: sample {index}: {a}, not {b}");
        }
    }
    check_all(&[case]);
}

/// Frames of one synthesizer against those of one made anew for each.
fn follow(name: &str, make: impl Fn() -> Backend) {
    let settings = scene::settings(scene::small_probe(), Effects::all());
    let (anatomy, first) = moved(|mesh| remeshed(mesh, 1.5, 3), &swirl());
    // Of another outline too, so that other samples are background.
    let (_, second) = moved(shrunk, &affine());
    let plain = FrameState {
        reference: Some(anatomy.mesh.as_ref().expect("a mesh").nodes().to_vec()),
        ..first.clone()
    };
    let without = |nodes: bool, reference: bool, state: &FrameState| {
        let mut state = state.clone();
        state.nodes = state.nodes.filter(|_| nodes);
        state.reference = state.reference.filter(|_| reference);
        state
    };
    let fresh = || Synthesizer::new(anatomy.clone(), settings.clone(), make()).expect("a synthesizer");
    let mut used = fresh();
    // What is given, and the whole state that it leaves.
    let frames = [
        (first.clone(), first.clone()),
        (without(false, false, &first), first.clone()),
        (
            without(true, false, &second),
            FrameState {
                reference: first.reference.clone(),
                ..second.clone()
            },
        ),
        (without(false, true, &second), second.clone()),
        (without(false, false, &first), second.clone()),
        (plain.clone(), plain.clone()),
        (without(true, false, &first), plain),
        (first.clone(), first),
    ];
    let mut last = Vec::new();
    for (at, (given, whole)) in frames.iter().enumerate() {
        let found = used.render(given).expect("a frame").pixels.clone();
        let expected = fresh().render(whole).expect("a frame").pixels.clone();
        assert!(found == expected, "{name}: frame {at}");
        if ![1, 4, 6].contains(&at) {
            assert!(found != last, "{name}: frame {at} is another than the one before");
        }
        last = found;
    }
}

#[test]
fn nodes_that_are_not_given_stay_where_they_are() {
    follow("cpu", || Backend::Cpu);
    follow("cpu-f64", || Backend::CpuF64);
    if let Some(gpu) = gpu_or_skip() {
        follow("gpu", || backend(gpu.clone()));
    }
}

#[test]
fn reference_nodes_that_are_not_finite_leave_out_their_elements_alone() {
    let (anatomy, mut state) = moved(|mesh| remeshed(mesh, 1.5, 5), &swirl());
    let whole = state.clone();
    let mesh = anatomy.mesh.clone().expect("a mesh");
    let lost = mesh.nodes().len() / 2;
    state.reference.as_mut().expect("reference nodes")[lost] = [f64::NAN, 0.0, f64::INFINITY];
    let settings = scene::settings(scene::small_probe(), scene::bare());
    let case = Case::new("lost", anatomy, settings, state);
    let gpus: Vec<_> = gpu_or_skip().into_iter().collect();
    let mut synthesizers = vec![case.exact().expect("the reference")];
    synthesizers.extend(case.twins(&gpus).expect("backends"));
    for mut synthesizer in synthesizers {
        let expected = synthesizer.render_until("warp", &whole).expect("positions");
        let found = synthesizer.render_until("warp", &case.state).expect("positions");
        let mut torn = 0;
        for (index, &element) in expected.element.iter().enumerate() {
            let own = mesh
                .elements()
                .get(element as usize)
                .is_some_and(|corners| corners.contains(&(lost as u32)));
            if own {
                assert!(found.position[index].iter().all(|x| x.is_finite()), "sample {index}");
                assert_ne!(found.element[index], element, "sample {index}");
                torn += 1;
            } else if expected.position[index][3] == f64::from(MAPPED) {
                assert_eq!(found.position[index], expected.position[index], "sample {index}");
            }
        }
        assert!(torn > 10, "{torn}");
    }
}

#[test]
fn a_wrong_number_of_reference_nodes_is_refused_and_leaves_everything_as_it_was() {
    let (anatomy, state) = moved(|mesh| remeshed(mesh, 1.5, 6), &swirl());
    let count = anatomy.mesh.as_ref().expect("a mesh").nodes().len();
    let settings = scene::settings(scene::small_probe(), scene::bare());
    let case = Case::new("too few", anatomy, settings, state);
    let gpus: Vec<_> = gpu_or_skip().into_iter().collect();
    let mut synthesizers = vec![case.exact().expect("the reference")];
    synthesizers.extend(case.twins(&gpus).expect("backends"));
    for mut synthesizer in synthesizers {
        let before = synthesizer.render(&case.state).expect("a frame").clone();
        let mut bad = case.state.clone();
        bad.probe_to_world[(0, 3)] += 1.0;
        bad.nodes.as_mut().expect("nodes")[0] = Vector3::zeros().into();
        bad.reference.as_mut().expect("reference nodes").pop();
        let expected = InvalidMesh::Positions {
            state: "reference",
            found: count - 1,
            expected: count,
        };
        match synthesizer.render(&bad) {
            Err(SynthError::Nodes(error)) => assert_eq!(error, expected),
            other => panic!("{other:?}"),
        }
        assert_eq!(synthesizer.frame(), &before);
        let still = FrameState {
            nodes: None,
            reference: None,
            ..case.state.clone()
        };
        assert_eq!(synthesizer.render(&still).expect("a frame"), &before);
    }
}
