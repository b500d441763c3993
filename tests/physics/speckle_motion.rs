//! Speckle moves with the tissue: a rigid motion of the mesh moves the pattern by as much.

use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState};
use insonify_tracking::probe::{Linear, ProbeShape};

use crate::support::anatomy::{self, PLAIN};
use crate::support::scene;
use crate::support::scene::{precisions, synthesizer};
use crate::support::stats::{correlation, peak};

const LINES: usize = 96;
const SAMPLES: usize = 240;
const SAMPLE_MM: f64 = 0.2;
const LINE_MM: f64 = 0.4;

fn scene() -> (Anatomy, Settings) {
    let shape = ProbeShape::Linear(Linear {
        width_mm: LINE_MM * (LINES as f64 - 1.0),
    });
    let probe = scene::probe(shape, SAMPLE_MM * SAMPLES as f64, LINES as u32, SAMPLES as u32);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.speckle = Some(insonify_imaging::effects::speckle::Speckle {
        axial_mm: Some(0.8),
        lateral_mm: Some(1.5),
        elevational_mm: Some(1.8),
        focal_zone_mm: Some(10_000.0),
        ..Default::default()
    });
    // The mesh reaches well beyond the beam on all sides.
    let anatomy = anatomy::with_mesh(
        anatomy::uniform(PLAIN),
        [[-60.0, -40.0, -40.0], [60.0, 90.0, 40.0]],
        300,
    );
    (anatomy, settings)
}

fn moved(anatomy: &Anatomy, by: [f64; 3]) -> FrameState {
    let nodes = anatomy.mesh.as_ref().expect("a mesh").nodes();
    let nodes = nodes
        .iter()
        .map(|node| [node[0] + by[0], node[1] + by[1], node[2] + by[2]])
        .collect();
    FrameState {
        nodes: Some(nodes),
        ..scene::straight()
    }
}

/// Correlation of `after` with `before` moved by `lag` scanlines and samples.
fn lagged(before: &Beam, after: &Beam, lines: i64, samples: i64) -> f64 {
    let (mut a, mut b) = (Vec::new(), Vec::new());
    for line in 10..LINES as i64 - 10 {
        for sample in 20..SAMPLES as i64 - 20 {
            a.push(before.amplitude[(line - lines) as usize * SAMPLES + (sample - samples) as usize]);
            b.push(after.amplitude[line as usize * SAMPLES + sample as usize]);
        }
    }
    correlation(&a, &b)
}

#[test]
fn the_pattern_follows_a_rigid_motion_to_a_tenth_of_a_sample() {
    let (anatomy, settings) = scene();
    for (name, backend) in precisions() {
        let mut synthesizer = synthesizer(&anatomy, &settings, backend);
        let still = synthesizer
            .render_until("speckle_lateral", &moved(&anatomy, [0.0; 3]))
            .expect("a beam");
        // Shifts in scanlines and samples.
        for (lines, samples) in [(3.0, 0.0), (0.0, 5.0), (0.0, 0.37), (0.45, 0.0), (-1.7, 3.25)] {
            let state = moved(&anatomy, [lines * LINE_MM, samples * SAMPLE_MM, 0.0]);
            let after = synthesizer.render_until("speckle_lateral", &state).expect("a beam");
            let (near_line, near_sample) = (lines.round() as i64, samples.round() as i64);
            let across: Vec<f64> = (-3..=3)
                .map(|lag| lagged(&still, &after, near_line + lag, near_sample))
                .collect();
            let down: Vec<f64> = (-3..=3)
                .map(|lag| lagged(&still, &after, near_line, near_sample + lag))
                .collect();
            let (found_lines, found_samples) = (peak(&across, near_line - 3), peak(&down, near_sample - 3));
            println!("{name}: moved by {lines} lines, {samples} samples; found {found_lines:.3}, {found_samples:.3}");
            assert!(
                (found_lines - lines).abs() < 0.1,
                "{name}: {found_lines} scanlines, not {lines}"
            );
            assert!(
                (found_samples - samples).abs() < 0.1,
                "{name}: {found_samples} samples, not {samples}"
            );
        }
    }
}

#[test]
fn a_motion_of_probe_and_tissue_together_changes_nothing() {
    let (anatomy, settings) = scene();
    let mut synthesizer = synthesizer(&anatomy, &settings, Backend::CpuF64);
    let still = synthesizer
        .render_until("speckle_lateral", &moved(&anatomy, [0.0; 3]))
        .expect("a beam");
    let by = [2.3, -1.1, 4.7];
    let mut state = moved(&anatomy, by);
    state.probe_to_world = nalgebra::Matrix4::new_translation(&by.into());
    let after = synthesizer.render_until("speckle_lateral", &state).expect("a beam");
    for (index, (a, b)) in still.amplitude.iter().zip(&after.amplitude).enumerate() {
        assert!((a - b).abs() < 1e-9, "sample {index}: {a} became {b}");
    }
}

#[test]
fn a_rotation_of_probe_and_tissue_together_changes_nothing() {
    let (anatomy, settings) = scene();
    let mut synthesizer = synthesizer(&anatomy, &settings, Backend::CpuF64);
    let still = synthesizer
        .render_until("speckle_lateral", &moved(&anatomy, [0.0; 3]))
        .expect("a beam");
    // About an axis of no symmetry, so that the elevation leaves its plane.
    for degrees in [20.0f64, 60.0, 180.0] {
        let axis = nalgebra::Unit::new_normalize(nalgebra::Vector3::new(1.0, 0.7, -0.4));
        let turn = nalgebra::Rotation3::from_axis_angle(&axis, degrees.to_radians());
        let mut state = moved(&anatomy, [0.0; 3]);
        for node in state.nodes.iter_mut().flatten() {
            *node = (turn * nalgebra::Vector3::from(*node)).into();
        }
        state.probe_to_world = turn.to_homogeneous();
        let after = synthesizer.render_until("speckle_lateral", &state).expect("a beam");
        for (index, (a, b)) in still.amplitude.iter().zip(&after.amplitude).enumerate() {
            assert!(
                (a - b).abs() < 1e-9,
                "{degrees} degrees, sample {index}: {a} became {b}"
            );
        }
    }
}
