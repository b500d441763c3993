//! Images of a fake model, and the calls to it.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use nalgebra::{Matrix4, Point3, Vector3};

use super::{Fake, instruments, patient};
use crate::simulator::imaging::Seeds;
use crate::simulator::{Haptic, Simulator};
use insonify_imaging::parity::Case;
use insonify_imaging::scene::SceneFile;
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};
use insonify_mechanics::insertion::{Snapshot, StepError, Tissue};
use insonify_mesh::TetMesh;

/// Returns an anatomy of one block with or without a mesh of it, and a probe on it.
fn scene(meshed: bool) -> (Synthesizer, Matrix4<f64>, Option<Arc<TetMesh>>) {
    let mut text = String::from(
        "version = 1\nvolume = { phantom = \"two-layer\", resolution_mm = 3 }\nimage = { width = 64, height = 48 }\n",
    );
    if meshed {
        text += "[deform]\nnodes = 300\nfield = { kind = \"indentation\", centre_mm = [0, 0, 0], direction = [0, 1, 0], \
                 depth_mm = 0.0, radius_mm = 25.0 }\n";
    }
    let scene = SceneFile::parse(&text, "scene")
        .expect("file")
        .resolve(".".as_ref())
        .expect("scene");
    let pose = *scene.probe_pose(0, 1).probe_to_world();
    let mesh = scene.anatomy.mesh.clone();
    // Frames of one state are one image: without noise, which differs from frame to frame.
    let mut settings = scene.settings;
    (settings.effects.receiver, settings.effects.noise) = (None, None);
    let synthesizer = Synthesizer::new(scene.anatomy, settings, Backend::Cpu).expect("synthesizer");
    (synthesizer, pose, mesh)
}

/// The noise of the receiver is drawn by the number of the frame.
#[test]
fn frames_of_one_number_are_the_same() {
    let (mut synthesizer, pose, _) = scene(false);
    let mut settings = synthesizer.settings().clone();
    settings.effects.receiver = Some(Default::default());
    synthesizer.set(settings).expect("settings");
    let mut haptic = Haptic::new(Box::new(Fake::default()), patient());
    let mut imaging = haptic.imaged(synthesizer, 1.27).expect("imaging");
    let frames = [0, 1, 2].map(|_| imaging.frame(&pose).expect("a frame").pixels.clone());
    assert!(frames[0] != frames[1] && imaging.next_frame() == 3);
    imaging.set_next_frame(1);
    assert!(imaging.frame(&pose).expect("a frame").pixels == frames[1]);
    assert_eq!(imaging.next_frame(), 2);
}

#[test]
fn without_an_image_no_state_is_asked_for() {
    let model = Fake::default();
    let asked = model.asked.clone();
    let mut haptic = Haptic::new(Box::new(model), patient());
    let counts = || [&asked.snapshots, &asked.imagers, &asked.tissues].map(|count| count.load(Ordering::Relaxed));
    for step in 0..5 {
        haptic.step(&instruments(step), 1e-3).expect("step");
    }
    assert_eq!(counts(), [0, 0, 0]);
    // An image without a mesh requests no tissue.
    let (synthesizer, pose, _) = scene(false);
    let mut imaging = haptic.imaged(synthesizer, 1.27).expect("imaging");
    assert_eq!(counts(), [1, 1, 0]);
    haptic.step(&instruments(5), 1e-3).expect("step");
    imaging.frame(&pose).expect("frame");
    assert_eq!((counts(), imaging.snapshot().step), ([2, 1, 0], 6));
    drop(imaging);
    haptic.step(&instruments(6), 1e-3).expect("step");
    assert_eq!(counts(), [2, 1, 0]);
}

#[test]
fn frames_show_the_latest_state_and_tissue_is_computed_once_for_each() {
    let (synthesizer, pose, mesh) = scene(true);
    let model = Fake {
        mesh,
        ..Fake::default()
    };
    let asked = model.asked.clone();
    let tissues = || asked.tissues.load(Ordering::Relaxed);
    let mut simulator = Simulator::new(Box::new(model), synthesizer, 1.27, patient()).expect("simulator");
    let at_rest = simulator.frame(&pose).expect("frame").pixels.clone();
    assert_eq!(tissues(), 1);
    for step in 0..6 {
        simulator.step(&instruments(step), 1e-3).expect("step");
    }
    let (haptic, mut imaging) = simulator.split();
    let moved = imaging.frame(&pose).expect("frame").pixels.clone();
    assert_eq!((tissues(), imaging.snapshot().step), (2, 6));
    assert!(moved != at_rest);
    assert!(imaging.frame(&pose).expect("frame").pixels == moved);
    assert_eq!(tissues(), 2);
    drop(haptic);
    assert!(imaging.frame(&pose).expect("frame").pixels == moved);
}

#[test]
fn a_patient_far_from_the_origin_is_imaged_as_one_near_it() {
    let (synthesizer, pose, _) = scene(true);
    let mut settings = synthesizer.settings().clone();
    (settings.has_needle, settings.effects.needle) = (true, Some(Default::default()));
    let near = Case::new(
        "patient",
        synthesizer.tables().anatomy.clone(),
        settings,
        FrameState::at(pose),
    );
    // Whole metres, and a needle with seeds behind it in the plane, some of them in the tissue.
    let shift_mm = [-64_000.0, 1e5, 2_000.0];
    let far = near.moved(shift_mm).expect("a place");
    let entry = Vector3::new(-3.0, 2.0, -4.0);
    let frames = [(&near, entry), (&far, entry + Vector3::from(shift_mm))].map(|(case, entry)| {
        let model = Fake {
            mesh: case.anatomy.mesh.clone(),
            entry,
            ..Fake::default()
        };
        let synthesizer = case.on(Backend::Cpu).expect("synthesizer");
        let mut simulator = Simulator::new(Box::new(model), synthesizer, 1.27, patient()).expect("simulator");
        let mut frames = Vec::new();
        for step in 0..6 {
            simulator.step(&instruments(step), 1e-3).expect("step");
            frames.push(simulator.frame(&case.state.probe_to_world).expect("frame").clone());
        }
        frames
    });
    for (near, far) in frames[0].iter().zip(&frames[1]) {
        assert!(near.pixels == far.pixels);
        let back = Matrix4::new_translation(&-Vector3::from(shift_mm)) * far.image_to_world;
        assert!((back - near.image_to_world).abs().max() < 1e-9);
    }
    assert!(
        frames[0].windows(2).all(|pair| pair[0].pixels != pair[1].pixels),
        "they move"
    );
}

#[test]
fn another_mesh_is_refused() {
    let (synthesizer, _, mesh) = scene(true);
    let element_count = mesh.as_ref().map_or(0, |mesh| mesh.elements().len());
    let refused = Simulator::new(Box::new(Fake::default()), synthesizer, 1.27, patient());
    let text = refused.err().map(|error| error.to_string());
    let expected = format!("the imaged mesh has {element_count} elements; expected the 0 of the tissue model");
    assert_eq!(text, Some(expected));
    let (synthesizer, ..) = scene(true);
    let refused = Simulator::new(
        Box::new(Fake {
            mesh,
            ..Fake::default()
        }),
        synthesizer,
        0.0,
        patient(),
    );
    let text = refused.err().map(|error| error.to_string());
    assert_eq!(
        text.as_deref(),
        Some("`needle_diameter_mm` is 0; expected a finite number above 0")
    );
    let (synthesizer, _, mesh) = scene(true);
    let mut moved = TetMesh::clone(&mesh.expect("a mesh"));
    moved = TetMesh::new(
        moved.nodes().iter().map(|&[x, y, z]| [x, y + 30.0, z]).collect(),
        moved.elements().to_vec(),
        moved.regions().to_vec(),
    )
    .expect("a mesh");
    let model = Fake {
        mesh: Some(Arc::new(moved)),
        ..Fake::default()
    };
    let refused = Simulator::new(Box::new(model), synthesizer, 1.27, patient());
    let text = refused.err().map(|error| error.to_string()).unwrap_or_default();
    assert!(
        text.starts_with("node 0 of the imaged mesh lies at") && text.contains("30 mm from"),
        "{text}"
    );
}

/// A device gets no force that is not a number.
#[test]
fn forces_that_are_not_finite_are_refused() {
    let mut haptic = Haptic::new(
        Box::new(Fake {
            state: f64::NAN,
            ..Fake::default()
        }),
        patient(),
    );
    let refused = haptic.step(&instruments(1), 1e-3);
    assert!(
        matches!(
            refused,
            Err(StepError::Outcome {
                what: "the force on the hand",
                ..
            })
        ),
        "{refused:?}"
    );
}

#[test]
fn seeds_move_with_the_tissue() {
    let size = Vector3::new(10.0, 10.0, 10.0);
    let mesh = TetMesh::lattice([3; 3], &Matrix4::new_nonuniform_scaling(&size)).expect("mesh");
    let (mesh, mut tissue) = (Arc::new(mesh), Tissue::default());
    // Linear in each element, so exact: a stretch along x, after a remesh that left the boundary unchanged.
    let stretched =
        |tissue: &Tissue, stretch: f64| tissue.reference.iter().map(|&[x, y, z]| [x * stretch, y, z]).collect();
    tissue.reference = mesh.nodes().to_vec();
    let inner = |node: &&mut [f64; 3]| node.iter().all(|x| (0.1..9.9).contains(x));
    tissue
        .reference
        .iter_mut()
        .filter(inner)
        .for_each(|node| node[1] += 0.3);
    let mut snapshot = Snapshot::default();
    snapshot
        .line
        .set([(0.0, Point3::origin()), (10.0, Point3::new(0.0, 6.0, 8.0))]);
    let mut seeds = Seeds::new(Some(mesh));
    let (mut plain, mut shown, mut still) = (Seeds::new(None), Vec::new(), Vec::new());
    for (count, stretch) in [(0, 1.0), (1, 1.1), (3, 1.3), (2, 0.8)] {
        tissue.current = stretched(&tissue, stretch);
        let places = [[3.0, 4.0, 5.0], [9.0, 1.0, 1.0], [-5.0, 0.0, 0.0]].map(Point3::from);
        snapshot.seeds = places[..count].to_vec();
        seeds.show(&snapshot, &tissue, &mut shown);
        plain.show(&snapshot, &tissue, &mut still);
        assert_eq!((shown.len(), still.len()), (count, count));
        for ((position, shown), still) in places.iter().zip(&shown).zip(&still) {
            // The last one lies outside.
            let expected = if position.x < 0.0 {
                *position
            } else {
                Point3::new(position.x * stretch, position.y, position.z)
            };
            let direction = shown.nodes[1] - shown.nodes[0];
            assert!((nalgebra::center(&shown.nodes[0], &shown.nodes[1]) - expected).norm() < 1e-9);
            assert!((direction.normalize() - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-9);
            assert!((nalgebra::center(&still.nodes[0], &still.nodes[1]) - position).norm() < 1e-12);
        }
    }
}
