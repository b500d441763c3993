//! Warp: the reference position of every sample. A twin may choose another element only if the sample provably lies within
//! rounding of it, and another side of the mesh's surface only within rounding of that surface.

use insonify::imaging::synth::{Backend, Synthesizer};
use insonify::mechanics::mesh::map::{BACKGROUND, FOLDED, MAPPED, OUTSIDE, States};
use insonify::mechanics::mesh::{Displacement, Locator, NONE};
use insonify::tracking::probe::ProbeShape;
use nalgebra::{Point3, Vector3};

use super::case::{Case, check_all};
use super::scenes;
use crate::support::anatomy;
use crate::support::gpu::{backend, gpu_or_skip};
use crate::support::scene::{self, SHAPES};

#[test]
fn pressed_tissue_under_every_probe_shape() {
    let (anatomy, state) = scenes::pressed();
    let cases: Vec<Case> = SHAPES
        .iter()
        .map(|&(name, shape)| {
            let settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
            Case::new(name, anatomy.clone(), settings, state.clone())
        })
        .collect();
    check_all("warp", &cases);
}

#[test]
fn samples_on_faces_edges_and_nodes_of_the_mesh() {
    // A lattice of whole millimetres under an axis-aligned probe: samples lie on shared faces, edges, nodes and the surface.
    let settings = {
        let shape = insonify::tracking::probe::ProbeShape::Linear { width_mm: 24.0 };
        scene::settings(scene::probe(shape, 40.0, 25, 80), scene::bare())
    };
    let mut state = scene::straight();
    let anatomy = scenes::on_a_lattice();
    let stretch = Displacement::Affine {
        matrix: [
            [1.25, 0.0, 0.0, 0.0],
            [0.0, 0.5, 0.0, 8.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
    };
    let mut nodes = Vec::new();
    stretch.displace(anatomy.mesh.as_ref().expect("a mesh").nodes(), &mut nodes);
    state.nodes = Some(nodes);
    check_all("faces of a mesh", &[Case::new("lattice", anatomy, settings, state)]);
}

#[test]
fn an_affine_displacement_is_undone_and_what_it_leaves_is_background() {
    let (anatomy, mut state) = scenes::pressed();
    let mesh = anatomy.mesh.clone().expect("a mesh");
    let shear = Displacement::Shear {
        fixed_mm: [0.0, 20.0, 0.0],
        direction: [1.0, 0.0, 0.2],
        normal: [0.0, 1.0, 0.3],
        amount: 0.25,
    };
    let mut nodes = Vec::new();
    shear.displace(mesh.nodes(), &mut nodes);
    state.nodes = Some(nodes);
    let case = Case::new(
        "sheared",
        anatomy,
        scene::settings(scene::small_probe(), scene::bare()),
        state,
    );
    let mut exact = case.exact().expect("the reference");
    let world = exact.render_until("geometry", &case.state).expect("positions");
    let warped = exact.render_until("warp", &case.state).expect("positions");
    let (mut mapped, mut background) = (0, 0);
    let [low, high] = mesh.bounds();
    let inside = |p: [f64; 4], by: f64| (0..3).all(|axis| p[axis] > low[axis] + by && p[axis] < high[axis] - by);
    for (before, after) in world.position.iter().zip(&warped.position) {
        if after[3] == f64::from(MAPPED) {
            let moved =
                Point3::new(after[0], after[1], after[2]) + Vector3::from(shear.apply([after[0], after[1], after[2]]));
            assert!(
                (moved.coords - Vector3::new(before[0], before[1], before[2])).norm() < 1e-11,
                "{before:?} came from {after:?}"
            );
            assert!(
                inside(*after, -1e-9),
                "a mapped sample comes from inside the mesh: {after:?}"
            );
            mapped += 1;
        } else {
            assert_eq!(&before[..3], &after[..3], "what is not mapped stays where it is");
            // Background where the reference mesh held the point, outside where neither does.
            let expected = after[3] == f64::from(BACKGROUND);
            assert!(
                if expected {
                    inside(*before, -1e-9)
                } else {
                    !inside(*before, 1e-9)
                },
                "{before:?} {after:?}"
            );
            background += usize::from(expected);
        }
    }
    assert!(
        mapped > 500 && background > 20,
        "{mapped} mapped, {background} background"
    );
    check_all("shear", &[case]);
}

/// Coordinates are below 128 mm, where f32 holds them to 8e-6 mm; sums in another order move a world position by a few of these, and the
/// map by a few times the stretch of the field.
const POSITION_TOLERANCE_MM: f64 = 1e-3;
/// Where two backends disagree on the element, the sample lies at a face to within rounding: 4e-5 mm over heights above 1 mm.
const FACE_TOLERANCE: f32 = 2e-4;

/// Depth of a press, mm, whether a node is lost, and how far every seventh reference node moves, mm.
const BROKEN: [(f64, bool, f64); 8] = [
    (6.0, false, 0.0),
    (9.0, false, 0.0),
    (40.0, false, 0.0),
    (9.0, true, 0.0),
    (9.0, false, 0.0),
    (9.0, false, 2.5),
    (6.0, true, 2.5),
    (6.0, false, -3.0),
];

/// Folds, a lost node and remeshing, frame after frame: each backend looks first in the elements of its own last frame.
#[test]
fn broken_tissue_gives_the_same_samples_frame_after_frame() {
    let Some(gpu) = gpu_or_skip("broken tissue") else {
        return;
    };
    let anatomy = anatomy::with_mesh(
        scenes::random_anatomy(),
        [[-40.0, 0.0, -20.0], [40.0, 70.0, 20.0]],
        1500,
    );
    let probe = scene::probe(ProbeShape::Phased { angle_deg: 75.0 }, 82.0, 64, 128);
    let settings = scene::settings(probe, scene::bare());
    let make = |backend| Synthesizer::new(anatomy.clone(), settings.clone(), backend).expect("a synthesizer");
    let (mut cpu, mut gpu) = (make(Backend::Cpu), make(backend(gpu)));
    let mesh = anatomy.mesh.clone().expect("a mesh");
    let mut states = States::<f32>::new(&mesh);
    let mut state = scene::aimed([0.0, -3.0, 3.0], [0.0, 40.0, 7.0], 0.0);
    let mut seen = [0usize; 4];
    for (depth_mm, lost, remeshed_mm) in BROKEN {
        let press = Displacement::Indentation {
            centre_mm: [0.0; 3],
            direction: [0.1, 1.0, 0.0],
            depth_mm,
            radius_mm: 15.0,
        };
        let (mut nodes, mut reference) = (Vec::new(), mesh.nodes().to_vec());
        press.displace(mesh.nodes(), &mut nodes);
        if lost {
            nodes[mesh.nodes().len() / 2] = [f64::NAN; 3];
        }
        for node in reference.iter_mut().step_by(7) {
            *node = [
                node[0] + remeshed_mm,
                node[1] - 0.5 * remeshed_mm,
                node[2] + 0.3 * remeshed_mm,
            ];
        }
        states.update(Some(&nodes), Some(&reference)).expect("positions");
        (state.nodes, state.reference) = (Some(nodes), Some(reference));
        let world = cpu.render_until("geometry", &state).expect("positions");
        let [one, other] = [&mut cpu, &mut gpu].map(|synth| synth.render_until("warp", &state).expect("positions"));
        for (index, (a, b)) in one.position.iter().zip(&other.position).enumerate() {
            seen[a[3] as usize] += 1;
            if one.element[index] == other.element[index] && a[3] == b[3] {
                let near = (0..3).all(|axis| (a[axis] - b[axis]).abs() < POSITION_TOLERANCE_MM);
                assert!(near, "{depth_mm} mm: sample {index}: {a:?}, {b:?}");
                continue;
            }
            let p = [0, 1, 2].map(|axis| world.position[index][axis] as f32);
            let at_face = |locator: &Locator<f32>, start: u32| {
                let hit = locator.locate(p, start);
                hit.element != NONE && hit.bary.iter().any(|share| share.abs() < FACE_TOLERANCE)
            };
            let explained = at_face(states.deformed(), one.element[index])
                || at_face(states.deformed(), other.element[index])
                || at_face(states.reference(), NONE);
            assert!(explained, "{depth_mm} mm: sample {index} at {p:?}: {a:?}, {b:?}");
        }
    }
    for flag in [MAPPED, BACKGROUND, FOLDED, OUTSIDE] {
        assert!(seen[flag as usize] > 50, "flags {seen:?}");
    }
}
