use nalgebra::{Matrix4, Rotation3, Vector3};

use super::*;
use crate::anatomies;
use crate::effects::common::rows;
use crate::effects::geometry;
use crate::synth::FrameState;
use crate::synth::slab::States;
use insonify_mesh::{Displacement, TetMesh};
use insonify_tracking::probe::{Curvilinear, Linear, Phased, ProbeShape, TrusTransverse};

const LOW: [f64; 3] = [-50.0, 5.0, -30.0];
const HIGH: [f64; 3] = [50.0, 90.0, 30.0];

/// Tables of 120 scanlines of 96 samples over a mesh of about `nodes` nodes.
fn tables(shape: ProbeShape, nodes: usize) -> Tables {
    let (mut anatomy, mut settings, _) = anatomies::two_layers();
    anatomy.mesh = Some(std::sync::Arc::new(TetMesh::over_box(LOW, HIGH, nodes).unwrap()));
    settings.probe.shape = shape;
    (settings.probe.lines, settings.probe.samples, settings.probe.depth_mm) = (120, 96, 100.0);
    Tables::new(anatomy, settings).unwrap()
}

/// Tissue pressed under the probe, folded where one node passes its neighbours, without a number at another, and
/// remeshed.
fn state(tables: &Tables, pose: Matrix4<f64>) -> FrameState {
    let mesh = tables.mesh.as_ref().unwrap();
    let press = Displacement::Indentation {
        centre_mm: [0.0, 5.0, 0.0],
        direction: [0.1, 1.0, 0.2],
        depth_mm: 12.0,
        radius_mm: 25.0,
    };
    let mut nodes = Vec::new();
    press.displace(mesh.nodes(), &mut nodes);
    let nearest = |p: [f64; 3]| {
        let square = |node: &[f64; 3]| (0..3).map(|axis| (node[axis] - p[axis]).powi(2)).sum::<f64>();
        (0..nodes.len())
            .min_by(|&a, &b| square(&mesh.nodes()[a]).total_cmp(&square(&mesh.nodes()[b])))
            .unwrap()
    };
    let (folded, lost) = (nearest([-8.0, 50.0, 0.0]), nearest([12.0, 60.0, 0.0]));
    nodes[folded][1] += 25.0;
    nodes[lost][2] = f64::NAN;
    let reference = mesh
        .nodes()
        .iter()
        .map(|&[x, y, z]| [x, y + 0.05 * x, 1.1 * z])
        .collect();
    FrameState {
        nodes: Some(nodes),
        reference: Some(reference),
        ..FrameState::at(pose)
    }
}

/// Lowest of all elements at some nodes that holds a position, and whether an inverted one does: every element is
/// tried.
fn exhaustive<T: Real>(frames: &[Frame<T>], position: &[T; 4]) -> (u32, bool) {
    let mut holding = (0..frames.len())
        .filter(|&at| element::holds(&frames[at], position))
        .peekable();
    let lowest = holding.peek().map_or(NO_ELEMENT, |&at| at as u32);
    (lowest, holding.any(|at| element::is_inverted(&frames[at])))
}

/// Compares the raster of a frame with the exhaustive search in every `step`-th sample; returns how many samples had
/// each flag.
fn compare<T: Real>(tables: &Tables, state: &FrameState, step: usize) -> [usize; 4] {
    let mesh = tables.mesh.as_ref().unwrap();
    let (lines, samples) = (tables.lines(), tables.samples());
    let prepared = |current: &[[f64; 3]]| -> Vec<Frame<T>> {
        let frame = |corners: &[u32; 4]| {
            let at = |node: u32| current[node as usize].map(T::of);
            element::prepare(corners.map(at), &corners.map(|node| mesh.nodes()[node as usize])).0
        };
        mesh.elements().iter().map(frame).collect()
    };
    let deformed = prepared(state.nodes.as_deref().unwrap());
    let reference = prepared(state.reference.as_deref().unwrap());
    let mut slab = Slab::<T>::new(mesh);
    slab.update(tables, state).unwrap();
    slab.sort_by_line(lines);
    let matrix = rows::<T>(&state.probe_to_world);
    let mut seen = [0; 4];
    for at in 0..lines {
        let ray = tables.rays[at];
        let mut positions = vec![[T::zero(); 4]; samples];
        geometry::scanline(ray.map(T::of), T::of(tables.sample_mm()), &matrix, &mut positions);
        // As `contact` shifts them, on every other scanline.
        for (i, position) in positions.iter_mut().enumerate().filter(|_| at % 2 == 1) {
            let left = (1.0 - (i as f64 + 0.5) * tables.sample_mm() / 50.0).max(0.0);
            for axis in 0..3 {
                position[axis] +=
                    (matrix[axis][0] * T::of(ray[2]) + matrix[axis][1] * T::of(ray[3])) * T::of(12.0 * left * left);
            }
        }
        let mut elements = vec![7; samples];
        rasterise(&slab, at, &mut positions, &mut elements);
        for (position, &slot) in positions.iter().zip(&elements).skip(at % step).step_by(step) {
            let found = match slot {
                NO_ELEMENT => NO_ELEMENT,
                slot => slab.deformed.elements[slot as usize],
            };
            let (lowest, inverted) = exhaustive(&deformed, position);
            assert_eq!(found, lowest, "{position:?}");
            let flag = match found {
                NO_ELEMENT if exhaustive(&reference, position).0 == NO_ELEMENT => OUTSIDE,
                NO_ELEMENT => BACKGROUND,
                _ if inverted => FOLDED,
                _ => MAPPED,
            };
            assert_eq!(position[3], T::of(f64::from(flag)), "{position:?}");
            seen[flag as usize] += 1;
        }
    }
    seen
}

/// Poses upright, tilted and turned, and from behind the mesh.
fn poses() -> [Matrix4<f64>; 3] {
    let tilted = Rotation3::from_euler_angles(0.4, -0.7, 0.3).to_homogeneous();
    let behind = Rotation3::from_euler_angles(std::f64::consts::PI, 0.1, 0.0).to_homogeneous();
    [
        Matrix4::identity(),
        tilted.append_translation(&Vector3::new(12.0, 3.0, -5.0)),
        behind.append_translation(&Vector3::new(3.0, 80.0, 2.0)),
    ]
}

#[test]
fn every_sample_gets_the_answer_of_an_exhaustive_search() {
    let shapes = [
        ProbeShape::Linear(Linear { width_mm: 60.0 }),
        ProbeShape::Phased(Phased { angle_deg: 90.0 }),
        ProbeShape::TrusTransverse(TrusTransverse {
            radius_mm: 10.0,
            angle_deg: 160.0,
        }),
    ];
    let mut seen = [0; 4];
    for (shape, pose) in shapes.into_iter().zip(poses()) {
        let tables = tables(shape, 500);
        let state = state(&tables, pose);
        for (flag, count) in compare::<f32>(&tables, &state, 1).into_iter().enumerate() {
            seen[flag] += count;
        }
        compare::<f64>(&tables, &state, 7);
    }
    assert!(seen.iter().all(|&count| count > 100), "{seen:?}");
}

#[test]
fn fine_meshes_get_the_answer_of_an_exhaustive_search() {
    let shape = ProbeShape::Curvilinear(Curvilinear {
        radius_mm: 60.0,
        angle_deg: 60.0,
    });
    for (nodes, step) in [(5_000, 37), (100_000, 1_531)] {
        let tables = tables(shape, nodes);
        let seen = compare::<f32>(&tables, &state(&tables, poses()[1]), step);
        assert!(seen[MAPPED as usize] > 1, "{seen:?}");
    }
}

/// A frame whose pose alone, or whose nodes alone have changed, is that of a new slab.
#[test]
fn a_slab_depends_on_no_earlier_frame() {
    let tables = tables(ProbeShape::Linear(Linear { width_mm: 60.0 }), 500);
    let mut slab = Slab::<f32>::new(tables.mesh.as_ref().unwrap());
    let [first, second, _] = poses().map(|pose| state(&tables, pose));
    slab.update(&tables, &first).unwrap();
    let posed = FrameState::at(second.probe_to_world);
    slab.update(&tables, &posed).unwrap();
    let mut fresh = Slab::<f32>::new(tables.mesh.as_ref().unwrap());
    fresh.update(&tables, &second).unwrap();
    for (kept, new) in [(&slab.deformed, &fresh.deformed), (&slab.reference, &fresh.reference)] {
        assert!(!new.elements.is_empty() && new.elements.len() < tables.mesh.as_ref().unwrap().elements().len());
        assert_eq!((&kept.elements, &kept.carries), (&new.elements, &new.carries));
    }
    let moved = slab.update(&tables, &FrameState::at(second.probe_to_world)).unwrap();
    assert_eq!(moved, States::default());
    let few = FrameState {
        nodes: Some(vec![[0.0; 3]]),
        ..posed
    };
    assert!(slab.update(&tables, &few).is_err());
}

/// A mesh of one layer of cells across the image plane: every element crosses the slab, in each of several tasks.
#[test]
fn every_element_is_tested_against_the_slab() {
    let tables = tables(ProbeShape::Linear(Linear { width_mm: 60.0 }), 500);
    let mesh = TetMesh::over_box([-28.0, 5.0, -0.7], [28.0, 90.0, 0.7], 25_000).unwrap();
    let all: Vec<u32> = (0..mesh.elements().len() as u32).collect();
    assert!(all.len() > 65_536, "more than one task: {}", all.len());
    let mut slab = Slab::<f32>::new(&std::sync::Arc::new(mesh));
    slab.update(&tables, &FrameState::at(Matrix4::identity())).unwrap();
    assert_eq!(slab.deformed.elements, all);
}
