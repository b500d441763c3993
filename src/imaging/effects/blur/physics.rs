//! Radial blur: its impulse response is the kernel, a constant stays constant, and depth is untouched.

use insonify_imaging::effects::blur::Blur;
use insonify_imaging::effects::slice::Boundary;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_tracking::probe::{Linear, ProbeShape};

use crate::support::anatomy::{self, Frame, PLAIN, SILENT};
use crate::support::scene::{self, SHAPES};
use crate::support::scene::{beam_after, precisions};

fn settings(shape: ProbeShape, lines: u32) -> Settings {
    let mut settings = scene::settings(scene::probe(shape, 40.0, lines, 80), scene::bare());
    settings.effects.blur = Some(Blur {
        width_mm: Some(3.0),
        growth_mm_cm: Some(0.8),
    });
    // A spot of one voxel would be smoothed away.
    settings.effects.slice.boundary = Boundary::Vote;
    settings
}

/// One bright voxel of 1 mm, over three millimetres of depth, at the middle scanline.
fn bright_spot() -> Anatomy {
    anatomy::anatomy_from(
        Frame::around([0.0, 20.0, 0.0], [61, 41, 5], 1.0),
        &[SILENT, SILENT, PLAIN],
        |p| 1 + u8::from(p[0].abs() < 0.1 && (p[1] - 24.0).abs() < 1.1),
    )
}

#[test]
fn the_impulse_response_is_the_kernel() {
    for (name, backend) in precisions() {
        let settings = settings(ProbeShape::Linear(Linear { width_mm: 60.0 }), 61);
        let beam = beam_after(&bright_spot(), &settings, backend, "blur", &scene::straight());
        let value = |line: usize, sample: usize| beam.amplitude[line * beam.samples + sample];
        for sample in 0..beam.samples {
            let depth = (sample as f64 + 0.5) * 0.5;
            // Silence is not nothing: -200 dB.
            if (depth - 24.0).abs() > 1.6 {
                assert!(
                    (0..61).all(|line| value(line, sample) < 1e-9),
                    "{name}: depth {depth} is touched"
                );
                continue;
            }
            let sigma = (3.0 + 0.8 * depth / 10.0) / 2.354_820_045_030_949_3;
            let (mut sum, mut square) = (0.0, 0.0);
            for line in 0..61 {
                let away = line as f64 - 30.0;
                sum += value(line, sample);
                square += value(line, sample) * away * away;
                // The kernel ends at three standard deviations of the widest depth.
                let expected = (-away * away / (2.0 * sigma * sigma)).exp() / (sigma * std::f64::consts::TAU.sqrt());
                let amplitude = value(line, sample);
                assert!(
                    (amplitude - expected).abs() < 2e-3,
                    "{name}: {amplitude} {away} mm aside at {depth} mm, not {expected}"
                );
            }
            assert!((sum - 1.0).abs() < 1e-6, "{name}: the kernel sums to {sum}");
            let width = 2.354_820_045_030_949_3 * square.sqrt();
            let expected = 3.0 + 0.8 * depth / 10.0;
            assert!(
                (width / expected - 1.0).abs() < 0.02,
                "{name}: {width} mm wide at {depth} mm, not {expected}"
            );
        }
    }
}

#[test]
fn a_constant_stays_constant_up_to_the_edges() {
    for (kind, shape) in SHAPES {
        for lines in [2, 9, 40] {
            let settings = settings(shape, lines);
            for (name, backend) in precisions() {
                let beam = beam_after(&anatomy::uniform(PLAIN), &settings, backend, "blur", &scene::straight());
                for (index, value) in beam.amplitude.iter().enumerate() {
                    assert!(
                        (value - 1.0).abs() < 1e-5,
                        "{name}, {kind}, {lines} lines: {value} at {index}"
                    );
                }
            }
        }
    }
}
