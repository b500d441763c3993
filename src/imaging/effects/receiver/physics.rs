//! Noise and clutter: Rayleigh statistics where nothing echoes, powers that add, the laws in depth, a new draw each
//! frame.

use insonify_imaging::effects::receiver::Receiver;
use insonify_imaging::effects::shadow::Shadow;
use insonify_imaging::synth::Backend;
use insonify_imaging::synth::layers::Beam;
use insonify_tracking::probe::{Linear, ProbeShape};

use crate::support::anatomy::{self, Acoustics, PLAIN};
use crate::support::scene;
use crate::support::scene::{beam_after, precisions};
use crate::support::stats::{correlation, kolmogorov_smirnov, mean};

const LINES: u32 = 128;
const SAMPLES: u32 = 512;
const DEPTH_MM: f64 = 60.0;

/// Noise alone, of -20 dB at all depths.
const NOISE: Receiver = Receiver {
    noise_db: -20.0,
    clutter_db: Some(-200.0),
    clutter_decay_db_cm: 0.0,
    ring_down_db: -200.0,
};

/// Excess kurtosis of each part of the signal: of the sum of six uniform bytes, -(6/5) / 6 up to the grain of a byte,
/// times the sum of the fourth powers of the weights 1, 2, 1 on two scanlines over the square of that of their squares.
const EXCESS: f64 = -0.2 * 18.0 / 36.0 / 2.0;

/// Amplitudes after the receiver, in tissue of an echo and of an attenuation, at the frames asked for.
fn beams(receiver: &Receiver, tissue: Acoustics, attenuates: bool, backend: &Backend, frames: &[u64]) -> Vec<Beam> {
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 40.0 }), DEPTH_MM, LINES, SAMPLES);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.receiver = Some(receiver.clone());
    settings.effects.shadow = attenuates.then(Shadow::default);
    let beam = |&frame: &u64| {
        let mut state = scene::straight();
        state.frame = frame;
        let backend = match backend {
            Backend::CpuF64 => Backend::CpuF64,
            _ => Backend::Cpu,
        };
        beam_after(&anatomy::uniform(tissue), &settings, backend, "receiver", &state)
    };
    frames.iter().map(beam).collect()
}

fn echo(db: f64) -> Acoustics {
    Acoustics { echo_db: db, ..PLAIN }
}

/// Every third sample of every second line: neighbours share no draw.
fn independent(beam: &Beam) -> Vec<f64> {
    let lines = beam.amplitude.chunks(beam.samples).step_by(2);
    lines.flat_map(|line| line.iter().step_by(3).copied()).collect()
}

fn squares(values: &[f64]) -> Vec<f64> {
    values.iter().map(|a| a * a).collect()
}

#[test]
fn noise_alone_is_rayleigh() {
    for (name, backend) in precisions() {
        let beam = &beams(&NOISE, echo(-100.0), false, &backend, &[4])[0];
        let amplitudes = independent(beam);
        let n = amplitudes.len() as f64;
        let power = squares(&amplitudes);
        // The power of a complex Gaussian signal of mean 1 has variance 1; with the kurtosis of its parts 1 + EXCESS /
        // 2.
        let variance = 1.0 + EXCESS / 2.0;
        let ratio = mean(&power) / 0.01;
        assert!(
            (ratio - 1.0).abs() < 4.0 * (variance / n).sqrt(),
            "{name}: mean power {ratio}"
        );
        let fourth = mean(&squares(&power)) / 1e-4;
        // The eighth moment of a Rayleigh amplitude of mean square 1 is 4! = 24, the fourth 2: variance 20.
        assert!(
            (fourth - 1.0 - variance).abs() < 4.0 * (20.0 / n).sqrt(),
            "{name}: fourth moment {fourth}, not {}",
            1.0 + variance
        );
        // To first order in the kurtosis the distribution of the power departs from the exponential by
        // EXCESS / 8 (x - x^2 / 2) e^-x (Gram and Charlier), at most 0.0029.
        let cumulative = |a: f64| {
            let x = a * a / 0.01;
            1.0 - (-x).exp() * (1.0 + EXCESS / 4.0 * (x - x * x / 2.0))
        };
        let distance = kolmogorov_smirnov(amplitudes, cumulative);
        assert!(distance < 1.95, "{name}: {distance}");
    }
}

#[test]
fn noise_is_new_in_every_frame_and_correlated_only_within_the_pulse() {
    for (name, backend) in precisions() {
        let frames = beams(&NOISE, echo(-100.0), false, &backend, &[0, 1, 0]);
        assert_eq!(frames[0].amplitude, frames[2].amplitude, "{name}: the same frame again");
        let field: Vec<Vec<f64>> = frames.iter().map(|beam| squares(&beam.amplitude)).collect();
        let samples = SAMPLES as usize;
        let n = field[0].len() as f64;
        // Correlated draws leave fewer independent ones: 1 + 2 (4/6)^4 + 2 (1/6)^4 samples and 1 + 2 (1/2)^4 scanlines
        // count for one.
        let along = 1.0 + 2.0 * (4.0f64 / 6.0).powi(4) + 2.0 * (1.0f64 / 6.0).powi(4);
        let sigma = (along * (1.0 + 2.0 * 0.5f64.powi(4)) / n).sqrt();
        let measured = correlation(&field[0], &field[1]);
        assert!(
            measured.abs() < 4.0 * sigma,
            "{name}: frames are correlated: {measured}"
        );
        for lag in [3, 7, 2 * samples, 2 * samples + 1, 5 * samples - 2] {
            let measured = correlation(&field[0][lag..], &field[0][..field[0].len() - lag]);
            assert!(measured.abs() < 4.0 * sigma, "{name}: {measured} at lag {lag}");
        }
        // The correlation of the power is the square of that of the signal: weights 1, 2, 1 give 4/6 and 1/6, two
        // scanlines 1/2. The kurtosis moves it by its own size times products of the weights, below 0.05.
        for (lag, expected) in [
            (1, 16.0 / 36.0),
            (2, 1.0 / 36.0),
            (samples, 0.25),
            (samples + 1, 4.0 / 36.0),
        ] {
            let measured = correlation(&field[0][lag..], &field[0][..field[0].len() - lag]);
            assert!(
                (measured - expected).abs() < 4.0 * sigma + 0.05,
                "{name}: {measured} at lag {lag}, not {expected}"
            );
        }
    }
}

#[test]
fn powers_of_echo_and_noise_add() {
    for (name, backend) in precisions() {
        for db in [-30.0, -20.0, -6.0] {
            let beam = &beams(&NOISE, echo(db), false, &backend, &[9])[0];
            let power = squares(&independent(beam));
            let echo_power = 10f64.powf(db / 10.0);
            // Noise of power 0.01 has a standard deviation of that.
            let slack = 4.0 * 0.01 / (power.len() as f64).sqrt() + 1e-6 * echo_power;
            let measured = mean(&power);
            assert!(
                (measured - echo_power - 0.01).abs() < slack,
                "{name}: {measured} with an echo of {echo_power}"
            );
            assert!(power.iter().all(|&power| power >= echo_power * (1.0 - 1e-6)), "{name}");
        }
    }
}

/// Clutter fades beyond the attenuation of average soft tissue, stands still from frame to frame while noise is new,
/// and is another with another seed.
#[test]
fn clutter_stands_still_and_fades() {
    let receiver = Receiver {
        noise_db: -65.0,
        clutter_db: Some(-10.0),
        clutter_decay_db_cm: 2.0,
        ring_down_db: -200.0,
    };
    const SEEDS: u64 = 60;
    let mut probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 40.0 }), DEPTH_MM, LINES, SAMPLES);
    // Pulses of one frequency, whose loss grows with depth evenly.
    probe.aperture.bandwidth = Some(0.05);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.receiver = Some(receiver);
    for attenuates in [false, true] {
        settings.effects.shadow = attenuates.then(Shadow::default);
        let beam = |seed: u64, frame: u64| {
            let settings = insonify_imaging::synth::tables::Settings {
                seed,
                ..settings.clone()
            };
            let state = insonify_imaging::synth::FrameState {
                frame,
                ..scene::straight()
            };
            beam_after(
                &anatomy::uniform(echo(-100.0)),
                &settings,
                Backend::Cpu,
                "receiver",
                &state,
            )
        };
        let beams: Vec<Beam> = (0..SEEDS).map(|seed| beam(seed, 0)).collect();
        // Average soft tissue at the 5 MHz of the probe takes 2 x 0.5 x 5 dB/cm both ways.
        let fade = 2.0 + if attenuates { 5.0 } else { 0.0 };
        for sample in (5..SAMPLES as usize).step_by(50) {
            let depth_cm = (sample as f64 + 0.5) * DEPTH_MM / f64::from(SAMPLES) / 10.0;
            let expected = 10f64.powf(-6.5) + 10f64.powf(-1.0 - fade * depth_cm / 10.0);
            let at_depth = |beam: &Beam| {
                mean(&squares(
                    &beam.amplitude[sample..]
                        .iter()
                        .copied()
                        .step_by(beam.samples)
                        .collect::<Vec<_>>(),
                ))
            };
            let ratio = mean(&beams.iter().map(at_depth).collect::<Vec<_>>()) / expected;
            // Bands of 3 dB (variance 0.61) and some 20 cells of a row leave 11 %.
            assert!(
                (ratio - 1.0).abs() < 0.45,
                "{ratio} of the power expected at {depth_cm} cm"
            );
        }
        let near = |beam: &Beam| {
            squares(&beam.amplitude)
                .chunks(beam.samples)
                .flat_map(|line| line[..100].to_vec())
                .collect::<Vec<_>>()
        };
        let next = correlation(&near(&beams[0]), &near(&beam(0, 1)));
        let other = correlation(&near(&beams[0]), &near(&beams[1]));
        assert!(next > 0.99 && other.abs() < 0.3, "{next} {other}");
    }
}

/// The array rings at its face on every scanline, and falls to 1/e over 3.15 mm at 1 MHz.
#[test]
fn the_array_rings_down() {
    let receiver = Receiver {
        noise_db: -200.0,
        clutter_db: Some(-200.0),
        ring_down_db: 14.0,
        ..Receiver::default()
    };
    for (name, backend) in precisions() {
        let beam = &beams(&receiver, echo(-200.0), false, &backend, &[0])[0];
        for (index, amplitude) in beam
            .amplitude
            .iter()
            .enumerate()
            .filter(|(index, _)| index % beam.samples < 30)
        {
            let depth = ((index % beam.samples) as f64 + 0.5) * DEPTH_MM / f64::from(SAMPLES);
            let expected = 10f64.powf(0.7) * (-depth * 5.0 / 3.15).exp();
            assert!(
                (amplitude - expected).abs() < 1e-5 * expected,
                "{name}: {amplitude} at {depth} mm, not {expected}"
            );
        }
    }
}
