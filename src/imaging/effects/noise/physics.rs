//! Additive noise: mean, variance, whiteness, and a new draw each frame, where no clamp interferes.

use insonify_imaging::effects::noise::Noise;
use insonify_tracking::probe::{Linear, ProbeShape};

use crate::support::anatomy::{self, Acoustics, PLAIN};
use crate::support::scene;
use crate::support::scene::{precisions, synthesizer};
use crate::support::stats::{correlation, mean, std};

const SIDE: usize = 200;

/// Noise on a grey of 127.5 in a square sector that fills the image, one row of pixels after another.
fn draws(backend: insonify_imaging::synth::Backend, std_grey: f64, frames: &[u64]) -> Vec<Vec<f64>> {
    let anatomy = anatomy::uniform(Acoustics {
        echo_db: 20.0 * 0.5f64.log10(),
        ..PLAIN
    });
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 40.0 }), 40.0, 8, 8);
    let mut settings = scene::sized(probe, scene::bare(), SIDE, SIDE);
    settings.image.margin = 0.0;
    settings.effects.noise = Some(Noise { std_grey });
    let mut synthesizer = synthesizer(&anatomy, &settings, backend);
    frames
        .iter()
        .map(|&frame| {
            let mut state = scene::straight();
            state.frame = frame;
            let pixels = &synthesizer.render(&state).expect("a frame").pixels;
            pixels.iter().map(|&grey| f64::from(grey) - 127.5).collect()
        })
        .collect()
}

#[test]
fn noise_has_the_mean_and_variance_asked_and_is_white() {
    let n = (SIDE * SIDE) as f64;
    for (name, backend) in precisions() {
        let std_grey = 9.0;
        let frames = draws(backend, std_grey, &[0, 1, 2]);
        for field in &frames {
            // Rounding to bytes adds a twelfth to the variance; at 14 standard deviations nothing is clamped.
            let spread = (std_grey * std_grey + 1.0 / 12.0).sqrt();
            assert!(
                mean(field).abs() < 4.0 * spread / n.sqrt(),
                "{name}: mean {}",
                mean(field)
            );
            assert!(
                (std(field) / spread - 1.0).abs() < 4.0 / (2.0 * n).sqrt(),
                "{name}: std {}",
                std(field)
            );
            for lag in [1, 2, SIDE, SIDE + 1, 7 * SIDE + 3] {
                let measured = correlation(&field[lag..], &field[..field.len() - lag]);
                assert!(
                    measured.abs() < 4.0 / n.sqrt(),
                    "{name}: correlation {measured} at lag {lag}"
                );
            }
        }
        for (a, b) in [(0, 1), (1, 2), (0, 2)] {
            let measured = correlation(&frames[a], &frames[b]);
            assert!(
                measured.abs() < 4.0 / n.sqrt(),
                "{name}: frames {a} and {b} are correlated: {measured}"
            );
        }
    }
}

#[test]
fn the_same_frame_draws_the_same_noise_and_strong_noise_is_clamped() {
    for (name, backend) in precisions() {
        let twice = draws(backend, 128.0, &[5, 5]);
        assert_eq!(twice[0], twice[1], "{name}");
        let ends = twice[0].iter().filter(|x| x.abs() == 127.5).count() as f64 / (SIDE * SIDE) as f64;
        // Beyond one standard deviation of a Gaussian lies 0.319 of it, beyond 127 / 128 of one 0.321.
        assert!(
            (ends - 0.32).abs() < 0.02,
            "{name}: {ends} of all pixels are black or white"
        );
    }
}
