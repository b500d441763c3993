//! Speckle reduction: gain in noise and in speckle against closed forms; edges, lines and a constant stay.

use std::f64::consts::FRAC_PI_4;

use insonify_imaging::effects::receiver::Receiver;
use insonify_imaging::effects::slice::Boundary;
use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::speckle_reduction::SpeckleReduction;
use insonify_imaging::effects::tone::Tone;
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState};
use insonify_tracking::probe::{Linear, ProbeShape};
use nalgebra::Matrix4;

use crate::support::anatomy::{self, Acoustics, Frame, PLAIN, SILENT};
use crate::support::scene::{self, SHAPES};
use crate::support::scene::{beam_after, precisions, synthesizer};
use crate::support::stats::{mean, std};

const LINES: usize = 96;
const SAMPLES: usize = 240;
const DEPTH_MM: f64 = 48.0;
const WIDTH_MM: f64 = 38.0;

/// A cell of speckle: four samples, and as many scanlines.
const CELL_MM: [f64; 2] = [4.0 * WIDTH_MM / (LINES as f64 - 1.0), 4.0 * DEPTH_MM / SAMPLES as f64];

fn settings(reduction: SpeckleReduction) -> Settings {
    let shape = ProbeShape::Linear(Linear { width_mm: WIDTH_MM });
    let probe = scene::probe(shape, DEPTH_MM, LINES as u32, SAMPLES as u32);
    let mut settings = scene::settings(probe, scene::bare());
    settings.effects.speckle_reduction = Some(reduction);
    settings.effects.slice.boundary = Boundary::Vote;
    settings
}

/// The usual window at a strength.
fn of_strength(strength: f64) -> SpeckleReduction {
    SpeckleReduction {
        strength: Some(strength),
        ..Default::default()
    }
}

/// Speckle of an anatomy before and after its reduction, under several seeds and beside each other in the tissue.
fn speckle(anatomy: &Anatomy, strength: f64, count: u64) -> Vec<[Beam; 2]> {
    let mut settings = settings(of_strength(strength));
    settings.effects.speckle = Some(Speckle {
        receive_bandwidth: None,
        axial_mm: Some(CELL_MM[1]),
        lateral_mm: Some(CELL_MM[0]),
        elevational_mm: Some(1.6),
        focus_mm: None,
        focal_zone_mm: Some(10_000.0),
    });
    let mut synthesizer = synthesizer(anatomy, &settings, Backend::Cpu);
    let pair = |number: u64| {
        let seed = (number + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        synthesizer
            .set(Settings {
                seed,
                ..settings.clone()
            })
            .expect("another seed");
        let aside = FrameState::at(Matrix4::new_translation(&[0.0, 0.0, 0.319 * number as f64].into()));
        ["speckle_lateral", "speckle_reduction"].map(|pass| synthesizer.render_until(pass, &aside).expect("a beam"))
    };
    (0..count).map(pair).collect()
}

/// Amplitudes whose lines do not leave the grid.
fn interior(beam: &Beam) -> Vec<f64> {
    let lines = beam.amplitude.chunks(beam.samples).skip(10).take(beam.lines - 20);
    lines
        .flat_map(|line| line[10..beam.samples - 10].iter().copied())
        .collect()
}

fn snr(values: &[f64]) -> f64 {
    mean(values) / std(values)
}

/// Share of each sample, at an offset of scanlines and samples in steps, in a smooth value where all is even: the mean
/// of the sample itself and of the means of five on each of four lines through it.
fn shares() -> Vec<([isize; 2], f64)> {
    let lines = [[1, 0], [0, 1], [1, 1], [1, -1]]
        .into_iter()
        .flat_map(|[across, along]: [isize; 2]| {
            (-2..=2).map(move |tap: isize| ([across * tap, along * tap], 0.2 * 0.2))
        });
    lines.chain([([0, 0], 0.2)]).collect()
}

/// Gain in mean over standard deviation by the average, from the correlation of samples at an offset in steps.
fn gain_of(correlation: impl Fn([isize; 2]) -> f64) -> f64 {
    let shares = shares();
    let pairs = shares.iter().flat_map(|a| shares.iter().map(move |b| (a, b)));
    let variance: f64 = pairs
        .map(|((a, share), (b, other))| share * other * correlation([0, 1].map(|axis| (a[axis] - b[axis]).abs())))
        .sum();
    variance.sqrt().recip()
}

/// Noise on a strong echo varies so little that every line is even.
#[test]
fn even_noise_falls_as_the_closed_form_says() {
    for (name, backend) in precisions() {
        // A window of one cell has steps of one sample on this grid.
        let mut settings = settings(SpeckleReduction {
            strength: Some(1.0),
            window_cells: 1.0,
        });
        settings.effects.receiver = Some(Receiver {
            noise_db: -20.0,
            clutter_db: Some(-200.0),
            clutter_decay_db_cm: 0.0,
            ring_down_db: -200.0,
        });
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, backend);
        let [before, after] = ["receiver", "speckle_reduction"].map(|pass| {
            let beam = synthesizer.render_until(pass, &scene::straight()).expect("a beam");
            snr(&interior(&beam))
        });
        let gain = after / before;
        // Parts of the noise are smoothed by 1, 2, 1 along a scanline and over two of them; the correlation of powers
        // is the square of theirs.
        let lag = |of: &[f64], away: isize| of.get(away as usize).copied().unwrap_or(0.0);
        let expected =
            gain_of(|[lines, samples]| (lag(&[1.0, 0.5], lines) * lag(&[1.0, 2.0 / 3.0, 1.0 / 6.0], samples)).powi(2));
        assert!(
            (gain / expected - 1.0).abs() < 0.03,
            "{name}: gain {gain}, not {expected}"
        );
    }
}

/// In speckle chance makes some lines uneven, which costs an eighth of the gain.
#[test]
fn speckle_gains_by_the_cells_of_the_window() {
    let pairs = speckle(&anatomy::uniform(PLAIN), 1.0, 12);
    let both = |of: usize| -> Vec<f64> { pairs.iter().flat_map(|pair| interior(&pair[of])).collect() };
    let [before, after] = [0, 1].map(both);
    let (level, variance) = (mean(&before), std(&before).powi(2));
    let correlation = |[lines, samples]: [isize; 2]| {
        let products = pairs.iter().flat_map(|[raw, _]| {
            let pair = move |line: usize, sample: usize| {
                let at = |line: usize, sample: usize| raw.amplitude[line * SAMPLES + sample] - level;
                at(line, sample) * at(line + 2 * lines as usize, sample + 2 * samples as usize)
            };
            (8..LINES - 16).flat_map(move |line| (8..SAMPLES - 16).map(move |sample| pair(line, sample)))
        });
        mean(&products.collect::<Vec<_>>()) / variance
    };
    let table: Vec<f64> = (0..25).map(|at| correlation([at / 5, at % 5])).collect();
    let expected = gain_of(|[lines, samples]| table[(5 * lines + samples) as usize]);
    let gain = snr(&after) / snr(&before);
    assert!((gain / expected - 0.88).abs() < 0.03, "gain {gain} of {expected}");
    let level = mean(&after) / level;
    assert!((level - 1.0).abs() < 0.03, "the level changes by {level}");
}

#[test]
fn the_usual_strength_makes_grey_as_even_as_stated() {
    let tone = Tone::linear();
    let grey = |amplitude: &f64| 255.0 * tone.shown(0.42 + 20.0 * amplitude.max(1e-9).log10() / tone.dynamic_range_db);
    let pairs = speckle(&anatomy::uniform(PLAIN), SpeckleReduction::default().strength(), 4);
    let [before, after] = [0, 1].map(|of| {
        let greys = pairs.iter().flat_map(|pair| interior(&pair[of]));
        snr(&greys.map(|amplitude| grey(&amplitude)).collect::<Vec<_>>())
    });
    let gain = after / before;
    assert!((gain - 1.8).abs() < 0.05, "{before} to {after}: {gain}");
}

/// Two tissues, or a layer in one, about a plane through the middle of the field of view, whose normal lies at an angle
/// from the scanlines' in cells of speckle; and the distance of a sample from that plane, in cells.
fn about_plane(
    angle: f64,
    tissues: [Acoustics; 2],
    is_second: impl Fn(f64) -> bool,
) -> (Anatomy, impl Fn(usize) -> f64) {
    let cells = move |x_mm: f64, y_mm: f64| {
        angle.sin() * x_mm / CELL_MM[0] + angle.cos() * (y_mm - 0.5 * DEPTH_MM) / CELL_MM[1]
    };
    let frame = Frame::around([0.0, 0.5 * DEPTH_MM, 1.2], [200, 260, 16], 0.2).stretched([1.0, 1.0, 5.0]);
    let anatomy = anatomy::anatomy_from(frame, &[SILENT, tissues[0], tissues[1]], |p| {
        1 + u8::from(is_second(cells(p[0], p[1])))
    });
    let distance = move |index: usize| {
        let x_mm = ((index / SAMPLES) as f64 / (LINES as f64 - 1.0) - 0.5) * WIDTH_MM;
        cells(x_mm, ((index % SAMPLES) as f64 + 0.5) * DEPTH_MM / SAMPLES as f64)
    };
    (anatomy, distance)
}

/// Angles across the beam, along it and between.
const ANGLES: [f64; 3] = [0.0, 2.0 * FRAC_PI_4, 0.7 * FRAC_PI_4];

/// Distance between 10 % and 90 % of a step of a profile about its middle, bins.
fn width(profile: &[f64]) -> f64 {
    let share = profile.len() / 6;
    let [low, high] = [&profile[..share], &profile[profile.len() - share..]].map(mean);
    let reached = |level: f64| {
        let level = low + level * (high - low);
        let steps = profile
            .windows(2)
            .enumerate()
            .filter(|(_, pair)| (pair[0] < level) != (pair[1] < level));
        let crossings: Vec<f64> = steps
            .map(|(at, pair)| at as f64 + (level - pair[0]) / (pair[1] - pair[0]))
            .collect();
        mean(&crossings)
    };
    reached(0.9) - reached(0.1)
}

#[test]
fn edges_of_20_db_keep_their_width() {
    let bright = Acoustics { echo_db: 20.0, ..PLAIN };
    for angle in ANGLES {
        let (anatomy, distance) = about_plane(angle, [PLAIN, bright], |cells| cells > 0.0);
        let pairs = speckle(&anatomy, SpeckleReduction::default().strength(), 40);
        let widths = [0, 1].map(|of| {
            // Mean amplitude by the distance from the edge, in eighths of a cell.
            let (mut sums, mut counts) = ([0.0; 48], [0.0; 48]);
            for pair in &pairs {
                for (index, amplitude) in pair[of].amplitude.iter().enumerate() {
                    let bin = 8.0 * distance(index) + 24.5;
                    if (0.0..48.0).contains(&bin) {
                        sums[bin as usize] += amplitude;
                        counts[bin as usize] += 1.0;
                    }
                }
            }
            let filled = sums.iter().zip(counts).filter(|(_, count)| *count > 0.0);
            width(&filled.map(|(sum, count)| sum / count).collect::<Vec<_>>())
        });
        let growth = widths[1] / widths[0] - 1.0;
        assert!(growth.abs() < 0.05, "{angle}: {widths:?}");
    }
}

#[test]
fn bright_lines_keep_their_peak() {
    let bright = Acoustics { echo_db: 26.0, ..PLAIN };
    for angle in ANGLES {
        let (anatomy, distance) = about_plane(angle, [PLAIN, bright], |cells| cells.abs() < 0.25);
        let pairs = speckle(&anatomy, SpeckleReduction::default().strength(), 4);
        let [before, after] = [0, 1].map(|of| {
            let on_line = |pair: &[Beam; 2]| {
                let all = pair[of].amplitude.iter().enumerate();
                let near = all.filter(|(index, _)| distance(*index).abs() < 0.15);
                near.map(|(_, amplitude)| *amplitude).collect::<Vec<_>>()
            };
            20.0 * mean(&pairs.iter().flat_map(on_line).collect::<Vec<_>>()).log10()
        });
        assert!((before - after).abs() < 1.0, "{angle}: {before} dB to {after} dB");
    }
}

#[test]
fn a_constant_stays_constant_however_few_lines_and_samples() {
    for (kind, shape) in SHAPES {
        for (lines, samples) in [(1, 1), (1, 40), (2, 80), (40, 3)] {
            let mut settings = settings(of_strength(1.0));
            settings.probe = scene::probe(shape, 40.0, lines, samples);
            for (name, backend) in precisions() {
                let plain = anatomy::uniform(PLAIN);
                let beam = beam_after(&plain, &settings, backend, "speckle_reduction", &scene::straight());
                for (index, value) in beam.amplitude.iter().enumerate() {
                    assert!(
                        (value - 1.0).abs() < 1e-6,
                        "{name}, {kind}, {lines} lines of {samples}: {value} at {index}"
                    );
                }
            }
        }
    }
}
