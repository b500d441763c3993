//! The needle's share of the scan plane adds up to the volume of the cylinder inside it, in every geometry.

use insonify_imaging::effects::needle::NeedleEcho;
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::Settings;
use insonify_imaging::synth::{Backend, FrameState, NeedleShaft, Synthesizer};
use std::f64::consts::PI;

use crate::support::anatomy::{self, PLAIN, SILENT};
use crate::support::scene::{self, SHAPES};
use crate::support::scene::{beam_after, precisions, synthesizer};

const DIAMETER_MM: f64 = 1.6;

fn settings(shape: usize, thickness_mm: Option<f64>) -> Settings {
    // A full circle needs as many scanlines more for the same spacing.
    let lines = if SHAPES[shape].0 == "radial" { 2400 } else { 400 };
    let mut settings = scene::settings(scene::probe(SHAPES[shape].1, 40.0, lines, 800), scene::bare());
    settings.has_needle = true;
    settings.effects.needle = Some(NeedleEcho {
        thickness_mm,
        ..NeedleEcho::default()
    });
    settings
}

fn with_shaft(nodes: &[[f64; 3]]) -> FrameState {
    let mut state = scene::straight();
    let nodes = nodes.iter().map(|&node| node.into()).collect();
    state.needle = Some(NeedleShaft {
        nodes,
        diameter_mm: DIAMETER_MM,
    });
    state
}

/// Volume of the needle in the plane: the sum over samples of share, cell area and thickness.
fn volume(synthesizer: &Synthesizer, beam: &Beam, thickness_mm: f64) -> f64 {
    let grid = &synthesizer.tables().grid;
    let mut sum = 0.0;
    for (index, share) in beam.needle.iter().enumerate() {
        let (line, sample) = (index / beam.samples, index % beam.samples);
        // The first and last scanline stand for half a cell.
        let edge = if line == 0 || line + 1 == beam.lines { 0.5 } else { 1.0 };
        sum += edge * share * grid.lateral_spacing_mm(grid.sample_depth_mm(sample));
    }
    sum * grid.sample_spacing_mm() * thickness_mm
}

#[test]
fn the_volume_in_the_plane_is_that_of_the_cylinder() {
    let radius = DIAMETER_MM / 2.0;
    let section = PI * radius * radius;
    let oblique = [[-3.0, 22.0, -12.0], [3.0, 18.0, 12.0]];
    let sine = 24.0 / (36.0f64 + 16.0 + 576.0).sqrt();
    let length = (64.0f64 + 64.0).sqrt();
    let cases: [(&str, &[[f64; 3]], Option<f64>, f64); 5] = [
        (
            "in the plane",
            &[[-4.0, 16.0, 0.0], [4.0, 24.0, 0.0]],
            None,
            section * length,
        ),
        (
            "in a plane thicker than itself",
            &[[-4.0, 16.0, 0.3], [4.0, 24.0, 0.3]],
            Some(3.0),
            section * length,
        ),
        // Without a thickness of its own the plane is as thick as the needle.
        (
            "across the plane",
            &[[0.5, 20.0, -9.0], [0.5, 20.0, 9.0]],
            None,
            section * DIAMETER_MM,
        ),
        ("oblique", &oblique, Some(2.5), section * 2.5 / sine),
        // Half the plane's 2 mm, and 0.4 mm beyond its middle.
        (
            "ending in the plane",
            &[[0.5, 20.0, -9.0], [0.5, 20.0, 0.4]],
            Some(2.0),
            section * 1.4,
        ),
    ];
    for shape in 0..SHAPES.len() {
        for (what, shaft, thickness, expected) in cases {
            for (name, backend) in precisions() {
                let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings(shape, thickness), backend);
                let beam = synthesizer.render_until("needle", &with_shaft(shaft)).expect("a beam");
                let volume_mm3 = volume(&synthesizer, &beam, thickness.unwrap_or(DIAMETER_MM));
                assert!(
                    (volume_mm3 / expected - 1.0).abs() < 0.015,
                    "{name}, {}: {what}: {volume_mm3} mm3, not {expected}",
                    SHAPES[shape].0
                );
            }
        }
    }
}

#[test]
fn a_bent_shaft_is_the_sum_of_its_pieces_away_from_the_joints() {
    let bent = [[-8.0, 12.0, 0.0], [0.0, 20.0, 0.2], [3.0, 30.0, 1.0]];
    for (name, backend) in precisions() {
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings(1, None), backend);
        let mut beam = |nodes: &[[f64; 3]]| {
            synthesizer
                .render_until("needle", &with_shaft(nodes))
                .expect("a beam")
                .needle
        };
        let (whole, first, second) = (beam(&bent), beam(&bent[..2]), beam(&bent[1..]));
        assert!(whole.iter().any(|&share| share > 0.9));
        for ((whole, first), second) in whole.iter().zip(&first).zip(&second) {
            assert!(
                (whole - (first + second).min(1.0)).abs() < 1e-6,
                "{name}: {whole} is not {first} + {second}"
            );
        }
    }
}

#[test]
fn the_echo_falls_with_the_angle_to_the_beam_and_repeats_below() {
    let echo = NeedleEcho {
        echo_db: 20.0,
        directivity: 3.0,
        reverberations: 2,
        reverberation_mm: 5.0,
        reverberation_db: 6.0,
        thickness_mm: None,
        roughness: 0.0,
    };
    for angle in [0.0f64, 20.0, 45.0, 70.0] {
        let (sin, cos) = angle.to_radians().sin_cos();
        let mut settings = settings(0, None);
        settings.effects.needle = Some(echo.clone());
        // Through (0, 15) at an angle to the array; the beams of a linear probe run along y.
        let state = with_shaft(&[
            [-30.0 * cos, 15.0 - 30.0 * sin, 0.0],
            [30.0 * cos, 15.0 + 30.0 * sin, 0.0],
        ]);
        let beam = beam_after(&anatomy::uniform(SILENT), &settings, Backend::CpuF64, "needle", &state);
        let line = 200;
        let x = -18.0 + 36.0 * line as f64 / 399.0;
        let depth = 15.0 + x * sin / cos;
        let brightest = |around: f64| {
            let middle = (around / 0.05) as usize;
            beam.amplitude[line * beam.samples..][middle - 6..middle + 6]
                .iter()
                .fold(0.0f64, |a, &b| a.max(b))
        };
        let expected = 10.0 * cos.powi(3);
        for (repetition, below) in [0.0, 5.0, 10.0].into_iter().enumerate() {
            let expected = expected * 10f64.powf(-0.3 * repetition as f64);
            // At 70 degrees the repetitions 5 mm apart overlap: the shaft spans 4.7 mm of a scanline.
            let amplitude = brightest(depth + below);
            assert!(
                (amplitude / expected - 1.0).abs() < 0.01,
                "{angle} degrees, repetition {repetition}: {amplitude}, not {expected}"
            );
        }
    }
}
