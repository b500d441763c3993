//! Where there is nothing, nothing shows.

use insonify_imaging::effects::Effects;
use insonify_imaging::synth::FrameState;
use insonify_mesh::Displacement;
use nalgebra::{Matrix4, Vector3};

use crate::support::anatomy::{self, Frame, PLAIN, SILENT};
use crate::support::scene;
use crate::support::scene::{beam_after, precisions, synthesizer};

#[test]
fn a_probe_wholly_outside_the_volume_gives_a_black_frame() {
    for (name, backend) in precisions() {
        let anatomy = anatomy::ball(
            Frame::around([0.0, 20.0, 0.0], [40; 3], 1.0),
            [0.0, 20.0, 0.0],
            9.0,
            &[SILENT, PLAIN, PLAIN],
        );
        let mut settings = scene::settings(scene::small_probe(), Effects::usual());
        settings.image.fill = 0;
        let mut synthesizer = synthesizer(&anatomy, &settings, backend);
        let away = FrameState::at(Matrix4::new_translation(&Vector3::new(500.0, -300.0, 0.0)));
        let beam = synthesizer.render_until("slice", &away).expect("a beam");
        assert!(beam.label.iter().all(|&label| label == 0), "{name}");
        let frame = synthesizer.render(&away).expect("a frame");
        assert!(frame.pixels.iter().all(|&pixel| pixel == 0), "{name}");
    }
}

#[test]
fn where_tissue_has_moved_away_there_is_background() {
    // A block of tissue is pressed to half its height: above it the beam meets nothing.
    let frame = Frame::around([0.0, 20.0, 0.0], [60; 3], 1.0);
    let anatomy = anatomy::with_mesh(
        anatomy::anatomy_from(frame, &[SILENT, PLAIN], |_| 1),
        [[-29.0, -9.0, -29.0], [29.0, 49.0, 29.0]],
        200,
    );
    let press = Displacement::Affine {
        matrix: [
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 0.5, 0.0, 24.5],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ],
    };
    let mut nodes = Vec::new();
    press.displace(anatomy.mesh.as_ref().expect("a mesh").nodes(), &mut nodes);
    let state = FrameState {
        nodes: Some(nodes),
        ..scene::straight()
    };
    for (name, backend) in precisions() {
        let settings = scene::settings(scene::probe(scene::SHAPES[0].1, 40.0, 24, 100), scene::bare());
        let beam = beam_after(&anatomy, &settings, backend, "slice", &state);
        // The top of the mesh moved from -9 mm to 20 mm.
        for (index, &label) in beam.label.iter().enumerate() {
            let depth = ((index % 100) as f64 + 0.5) * 0.4;
            assert_eq!(label, u8::from(depth > 20.0), "{name}: depth {depth}");
        }
    }
}

#[test]
fn poses_that_are_no_transforms_are_refused() {
    let settings = scene::settings(scene::small_probe(), scene::bare());
    for (name, backend) in precisions() {
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, backend);
        for bad in [f64::NAN, f64::INFINITY] {
            let mut state = scene::straight();
            state.probe_to_world[(0, 3)] = bad;
            assert!(synthesizer.render(&state).is_err(), "{name}: {bad}");
        }
        assert!(
            synthesizer.render(&FrameState::at(Matrix4::zeros())).is_err(),
            "{name}: singular"
        );
        assert!(
            synthesizer.render(&scene::straight()).is_ok(),
            "{name}: a refusal leaves it usable"
        );
    }
}
