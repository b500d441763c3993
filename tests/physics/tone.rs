//! Tone: known ramps through the pipeline.

use insonify::effects::shadow::Shadow;
use insonify::effects::tone::{MID_GREY, Tone};

use crate::support::anatomy::{self, Acoustics, PLAIN};
use crate::support::scene::{self, SHAPES};
use crate::{beam_after, precisions};

fn echo(db: f64) -> anatomy::Acoustics {
    Acoustics { echo_db: db, ..PLAIN }
}

#[test]
fn decibels_become_grey_levels_in_a_straight_line() {
    for range in [30.0, 60.0, 90.0] {
        for db in [-60.0, -20.0, -5.0, 0.0, 7.0, 40.0] {
            for (name, backend) in precisions() {
                let mut settings = scene::settings(scene::small_probe(), scene::bare());
                settings.effects.tone = Some(Tone {
                    dynamic_range_db: range,
                    gain_db: 3.0,
                    ..Tone::default()
                });
                let beam = beam_after(
                    &anatomy::uniform(echo(db)),
                    &settings,
                    backend,
                    "tone",
                    &scene::straight(),
                );
                let expected = 255.0 * (MID_GREY + (db + 3.0) / range).clamp(0.0, 1.0);
                for found in &beam.amplitude {
                    assert!(
                        (found - expected).abs() < 1e-3,
                        "{name}: {db} dB in {range} dB: {found}, not {expected}"
                    );
                }
            }
        }
    }
}

#[test]
fn time_gain_compensation_is_a_ramp_in_depth() {
    for (name, backend) in precisions() {
        let mut settings = scene::settings(scene::small_probe(), scene::bare());
        settings.effects.tone = Some(Tone {
            gain_db: 0.0,
            tgc_db_cm: Some(-1.5),
            tgc_points: vec![[10.0, 0.0], [30.0, 8.0]],
            ..Tone::default()
        });
        let beam = beam_after(
            &anatomy::uniform(echo(-4.0)),
            &settings,
            backend,
            "tone",
            &scene::straight(),
        );
        for (index, found) in beam.amplitude.iter().enumerate() {
            let depth = ((index % 96) as f64 + 0.5) * 40.0 / 96.0;
            let points = 8.0 * ((depth - 10.0) / 20.0).clamp(0.0, 1.0);
            let expected = 255.0 * (MID_GREY + (-4.0 - 0.15 * depth + points) / 60.0);
            assert!(
                (found - expected).abs() < 1e-3,
                "{name}: {found} at {depth} mm, not {expected}"
            );
        }
    }
}

#[test]
fn gamma_bends_the_grey_map() {
    for gamma in [0.5, 2.0] {
        for (name, backend) in precisions() {
            let mut settings = scene::settings(scene::small_probe(), scene::bare());
            settings.effects.tone = Some(Tone {
                gain_db: 0.0,
                gamma,
                ..Tone::default()
            });
            let beam = beam_after(
                &anatomy::uniform(echo(-6.0)),
                &settings,
                backend,
                "tone",
                &scene::straight(),
            );
            let expected = 255.0 * (MID_GREY - 0.1f64).powf(gamma);
            assert!(
                (beam.amplitude[0] - expected).abs() < 1e-3,
                "{name}: {} for gamma {gamma}",
                beam.amplitude[0]
            );
        }
    }
}

#[test]
fn compensation_without_a_value_undoes_the_attenuation_of_average_tissue() {
    for (kind, shape) in SHAPES {
        let tissue = Acoustics {
            attenuation_db_cm_mhz: 0.5,
            ..PLAIN
        };
        let mut settings = scene::settings(scene::probe(shape, 40.0, 9, 96), scene::bare());
        settings.effects.tone = Some(Tone {
            gain_db: 0.0,
            ..Tone::default()
        });
        settings.effects.shadow = Some(Shadow::default());
        let beam = beam_after(
            &anatomy::uniform(tissue),
            &settings,
            insonify::synth::Backend::CpuF64,
            "tone",
            &scene::straight(),
        );
        for found in &beam.amplitude {
            assert!((found - 255.0 * MID_GREY).abs() < 0.05, "{kind}: {found}");
        }
    }
}

#[test]
fn without_a_curve_grey_is_the_amplitude() {
    for (name, backend) in precisions() {
        let settings = scene::settings(scene::small_probe(), scene::bare());
        let beam = beam_after(
            &anatomy::uniform(echo(20.0 * 0.3f64.log10())),
            &settings,
            backend,
            "tone",
            &scene::straight(),
        );
        assert!((beam.amplitude[5] - 76.5).abs() < 1e-4, "{name}: {}", beam.amplitude[5]);
    }
}
