//! Brachytherapy seeds: bright specks with shadows of their own, with or without a needle.

use std::f64::consts::FRAC_PI_4;

use insonify_imaging::effects::needle::NeedleEcho;
use insonify_imaging::effects::shadow::{Shadow, UNITS_PER_DB};
use insonify_imaging::synth::layers::Beam;
use insonify_imaging::synth::tables::Settings;
use insonify_imaging::synth::{FrameState, NeedleShaft, SEED_DIAMETER_MM, SEED_LENGTH_MM};
use insonify_tracking::probe::{Linear, ProbeShape};
use nalgebra::{Point3, Vector3};

use crate::support::anatomy::{self, PLAIN};
use crate::support::scene;
use crate::support::scene::{precisions, synthesizer};

const BEAM_MM: f64 = 2.0;
const DB_MM: f64 = 6.0;
const LINES: u32 = 81;
const LINE_MM: f64 = 0.25;
const SAMPLES: usize = 800;
const SAMPLE_MM: f64 = 0.05;

/// A fine linear array over tissue that only the seeds shade.
fn settings() -> Settings {
    let shape = ProbeShape::Linear(Linear {
        width_mm: LINE_MM * f64::from(LINES - 1),
    });
    let probe = scene::probe(shape, SAMPLE_MM * SAMPLES as f64, LINES, SAMPLES as u32);
    let mut settings = scene::settings(probe, scene::bare());
    settings.has_needle = true;
    settings.effects.needle = Some(NeedleEcho {
        echo_db: 20.0,
        reverberations: 1,
        roughness: 0.0,
        ..NeedleEcho::default()
    });
    settings.effects.shadow = Some(Shadow {
        needle_db_mm: DB_MM,
        beam_mm: Some(BEAM_MM),
        f_number: Some(0.0),
        ..Shadow::default()
    });
    settings
}

/// A seed in the plane, across the beams.
fn seed(x: f64, depth: f64) -> NeedleShaft {
    NeedleShaft::seed(Point3::new(x, depth, 0.0), &Vector3::x())
}

fn with(seeds: Vec<NeedleShaft>) -> FrameState {
    FrameState {
        seeds,
        ..scene::straight()
    }
}

/// Index in a beam of the sample nearest to a place, mm.
fn at(beam: &Beam, x: f64, depth: f64) -> usize {
    let line = (x / LINE_MM + f64::from(LINES - 1) / 2.0).round() as usize;
    line * beam.samples + (depth / SAMPLE_MM - 0.5).round() as usize
}

#[test]
fn a_seed_is_bright_where_it_is_and_dark_behind() {
    for (name, backend) in precisions() {
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings(), backend);
        // Its ends lie between scanlines.
        let centre = 0.1;
        let state = with(vec![seed(centre, 15.0)]);
        let echo = synthesizer.render_until("needle", &state).expect("a beam");
        let shaded = synthesizer.render_until("shadow", &state).expect("a beam");
        for line in 0..echo.lines {
            let x = (line as f64 - f64::from(LINES - 1) / 2.0) * LINE_MM;
            // Square to the beam an echo of 20 dB is ten times that of the tissue.
            let inside = (x - centre).abs() < SEED_LENGTH_MM / 2.0;
            let amplitude = echo.amplitude[at(&echo, x, 15.0)];
            let expected = if inside { 11.0 } else { 1.0 };
            assert!(
                (amplitude / expected - 1.0).abs() < 0.01,
                "{name}: {amplitude} at {x} mm, not {expected}"
            );
            // The mean share along the chord is pi / 4; of a beam of 2 mm the seed takes its diameter. A root in steps
            // of a sixteenth of the diameter is off by less than 2 %.
            let below = echo_free(&shaded, x);
            let chord = FRAC_PI_4 * SEED_DIAMETER_MM;
            let loss = if inside {
                DB_MM * chord * SEED_DIAMETER_MM / BEAM_MM
            } else {
                0.0
            };
            let loss_db = f64::from(shaded.loss[below]) / UNITS_PER_DB;
            assert!(
                (loss_db - loss).abs() <= 0.02 * loss,
                "{name}: {loss_db} dB at {x} mm, not {loss}"
            );
            // Behind its middle the whole beam (2 mm wide at half maximum) is within the seed, to a part in a hundred.
            if (x - centre).abs() < 0.3 {
                let left = 10f64.powf(-loss / 20.0);
                let amplitude = shaded.amplitude[below];
                assert!(
                    (amplitude - left).abs() < 0.02 * (1.0 - left),
                    "{name}: {amplitude} at {x} mm, not {left}"
                );
            }
        }
        let beside = shaded.amplitude[echo_free(&shaded, 8.0)];
        assert_eq!(beside, 1.0, "{name}: no shadow beside the seed");
    }
}

/// A sample below all echoes of a seed at 15 mm.
fn echo_free(beam: &Beam, x: f64) -> usize {
    at(beam, x, 30.0)
}

#[test]
fn two_seeds_are_two_single_ones() {
    let [first, second] = [seed(-1.0, 12.0), seed(1.5, 22.0)];
    for (name, backend) in precisions() {
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings(), backend);
        let mut beams = |seeds: &[&NeedleShaft]| {
            let state = with(seeds.iter().copied().cloned().collect());
            let beam = synthesizer.render_until("needle", &state).expect("a beam");
            (beam, synthesizer.render_until("shadow", &state).expect("a beam"))
        };
        let (none, a, b) = (beams(&[]), beams(&[&first]), beams(&[&second]));
        let both = beams(&[&first, &second]);
        let mut shared = 0;
        for index in 0..none.0.amplitude.len() {
            let of = |beams: &(Beam, Beam)| {
                (
                    beams.0.amplitude[index] - 1.0,
                    beams.0.needle[index],
                    beams.1.loss[index],
                )
            };
            let [none, a, b, both] = [&none, &a, &b, &both].map(of);
            assert_eq!(none, (0.0, 0.0, 0), "{name}: nothing without seeds");
            assert!(
                (both.0 - a.0 - b.0).abs() < 1e-5,
                "{name}: echo {} of {} and {}",
                both.0,
                a.0,
                b.0
            );
            assert_eq!(both.1, a.1 + b.1, "{name}: share");
            assert_eq!(both.2, a.2 + b.2, "{name}: loss");
            shared += usize::from(a.2 > 0 && b.2 > 0);
        }
        assert!(shared > 100, "{name}: {shared} samples lie in both shadows");
    }
}

#[test]
fn needle_and_seed_shade_by_their_own_diameters() {
    let thick = NeedleShaft {
        nodes: vec![[4.0, 12.0, 0.0].into(), [9.0, 12.0, 0.0].into()],
        diameter_mm: 1.6,
    };
    for (name, backend) in precisions() {
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings(), backend);
        let state = FrameState {
            needle: Some(thick.clone()),
            ..with(vec![seed(-4.0, 15.0)])
        };
        let beam = synthesizer.render_until("shadow_loss", &state).expect("a beam");
        for (x, diameter) in [(-4.0, SEED_DIAMETER_MM), (6.0, 1.6)] {
            let loss_db = f64::from(beam.loss[echo_free(&beam, x)]) / UNITS_PER_DB;
            let expected = DB_MM * FRAC_PI_4 * diameter * diameter / BEAM_MM;
            assert!(
                (loss_db / expected - 1.0).abs() < 0.02,
                "{name}: {loss_db} dB at {x} mm, not {expected}"
            );
        }
    }
}

#[test]
fn a_scene_that_excludes_needles_shows_no_seeds_and_pays_nothing() {
    for (name, backend) in precisions() {
        let mut settings = settings();
        settings.effects.needle = None;
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, backend);
        assert!(!synthesizer.plan().has("needle"), "{name}");
        let empty = synthesizer.render(&scene::straight()).expect("a frame").clone();
        let state = with((0..300).map(|_| seed(0.0, 15.0)).collect());
        assert_eq!(synthesizer.render(&state).expect("a frame"), &empty, "{name}");
        assert!(!synthesizer.plan().has("needle"), "{name}");
    }
}

#[test]
fn a_frame_tells_how_many_seeds_it_leaves_out() {
    for (name, backend) in precisions() {
        let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings(), backend);
        let many = |count: usize| with((0..count).map(|_| seed(0.0, 15.0)).collect());
        assert_eq!(synthesizer.render(&many(256)).expect("a frame").left_out, 0, "{name}");
        assert_eq!(synthesizer.render(&many(259)).expect("a frame").left_out, 3, "{name}");
    }
}
