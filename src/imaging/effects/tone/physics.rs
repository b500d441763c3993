//! Tone: known ramps through the pipeline.

use insonify_imaging::effects::receiver::Receiver;
use insonify_imaging::effects::shadow::Shadow;
use insonify_imaging::effects::tone::auto_gain::{FULL_WEIGHT, PRIOR, USUAL_DB, ZERO_WEIGHT};
use insonify_imaging::effects::tone::{MID_GREY, NOISE_GREY, Tone};
use insonify_imaging::synth::Backend;
use insonify_tracking::probe::{Linear, ProbeShape};

use crate::support::anatomy::{self, Acoustics, PLAIN};
use crate::support::scene::{self, SHAPES};
use crate::support::scene::{beam_after, precisions};
use crate::support::stats::mean;

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
                    ..Tone::linear()
                });
                let beam = beam_after(
                    &anatomy::uniform(echo(db)),
                    &settings,
                    backend,
                    "tone",
                    &scene::straight(),
                );
                let expected = 255.0 * (MID_GREY + (db + 3.0) / range).clamp(0.0, 1.0);
                for grey in &beam.amplitude {
                    assert!(
                        (grey - expected).abs() < 1e-3,
                        "{name}: {db} dB in {range} dB: {grey}, not {expected}"
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
            ..Tone::linear()
        });
        let beam = beam_after(
            &anatomy::uniform(echo(-4.0)),
            &settings,
            backend,
            "tone",
            &scene::straight(),
        );
        for (index, grey) in beam.amplitude.iter().enumerate() {
            let depth = ((index % 96) as f64 + 0.5) * 40.0 / 96.0;
            let points = 8.0 * ((depth - 10.0) / 20.0).clamp(0.0, 1.0);
            let expected = 255.0 * (MID_GREY + (-4.0 - 0.15 * depth + points) / 60.0);
            assert!(
                (grey - expected).abs() < 1e-3,
                "{name}: {grey} at {depth} mm, not {expected}"
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
                ..Tone::linear()
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
            ..Tone::linear()
        });
        settings.effects.shadow = Some(Shadow::default());
        let beam = beam_after(
            &anatomy::uniform(tissue),
            &settings,
            Backend::CpuF64,
            "tone",
            &scene::straight(),
        );
        for grey in &beam.amplitude {
            assert!((grey - 255.0 * MID_GREY).abs() < 0.05, "{kind}: {grey}");
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

/// Grey levels of a linear probe, scanline by scanline.
fn greys(anatomy: &insonify_imaging::synth::tables::Anatomy, receiver: Option<Receiver>, tone: Tone) -> Vec<f64> {
    let probe = scene::probe(ProbeShape::Linear(Linear { width_mm: 30.0 }), 96.0, 24, 192);
    let mut settings = scene::settings(probe, scene::bare());
    // Pulses of one frequency, whose loss grows with depth evenly.
    settings.probe.aperture.bandwidth = Some(0.05);
    settings.effects.shadow = Some(Shadow::default());
    settings.effects.receiver = receiver;
    settings.effects.tone = Some(tone);
    beam_after(anatomy, &settings, Backend::CpuF64, "tone", &scene::straight()).amplitude
}

#[test]
fn automatic_gain_takes_out_its_share_whatever_the_gain() {
    for (db, gain_db) in [(-14.0, 6.0), (-5.0, -3.0), (0.0, 6.0), (0.0, 0.0), (12.0, -3.0)] {
        let level = 10f64.powf((db - USUAL_DB) / 20.0);
        let weight = ((level - ZERO_WEIGHT) / (FULL_WEIGHT - ZERO_WEIGHT)).clamp(0.0, 1.0);
        let level = (weight * level + PRIOR) / (weight + PRIOR);
        let expected = 255.0 * (MID_GREY + (db + gain_db - 15.0 * level.log10()) / 60.0);
        for (name, backend) in precisions() {
            let mut settings = scene::settings(scene::small_probe(), scene::bare());
            settings.effects.tone = Some(Tone {
                auto_gain: 0.75,
                gain_db,
                ..Tone::linear()
            });
            let anatomy = anatomy::uniform(echo(db));
            let beam = beam_after(&anatomy, &settings, backend, "tone", &scene::straight());
            for grey in &beam.amplitude {
                // The prior counts one sample more than the band has.
                assert!(
                    (grey - expected).abs() < 0.02,
                    "{name}: {db} dB: {grey}, not {expected}"
                );
            }
        }
    }
}

/// 5 cm of urine in tissue of average attenuation are compensated for by 25 dB too much: of that a fifth is left, and
/// the urine stays black.
#[test]
fn tissue_behind_urine_is_at_most_8_db_too_bright() {
    let tissue = Acoustics {
        attenuation_db_cm_mhz: 0.5,
        ..echo(USUAL_DB)
    };
    let urine = Acoustics { ..echo(-60.0) };
    let frame = anatomy::Frame::around([0.0, 60.0, 0.0], [3, 122, 3], 1.0).stretched([40.0, 1.0, 40.0]);
    let anatomy = anatomy::layers(frame, &[0.0, 18.0, 68.0], &[anatomy::SILENT, tissue, urine, tissue]);
    let over = |tone: Tone| {
        let greys = greys(&anatomy, None, tone);
        let grey_at = |depth_mm: f64| greys[(2.0 * depth_mm) as usize];
        assert_eq!(grey_at(45.0), 0.0, "urine");
        [grey_at(9.0), grey_at(93.0)].map(|grey| (grey / 255.0 - MID_GREY) * 60.0 - USUAL_DB)
    };
    let [before, behind] = over(Tone::linear());
    assert!(before.abs() < 0.3 && (behind - 25.0).abs() < 0.3, "{before} {behind}");
    let automatic = Tone {
        auto_gain: 0.8,
        ..Tone::linear()
    };
    let [before, behind] = over(automatic);
    assert!(before.abs() < 0.3 && (4.0..8.0).contains(&behind), "{before} {behind}");
}

#[test]
fn automatic_gain_lifts_faint_tissue_and_no_noise() {
    let receiver = Receiver {
        noise_db: -60.0,
        clutter_db: Some(-200.0),
        ring_down_db: -200.0,
        ..Receiver::default()
    };
    let tones = || {
        [0.0, 1.0].map(|auto_gain| Tone {
            auto_gain,
            ..Tone::linear()
        })
    };
    let shown = |tissue: Acoustics, tone: Tone| greys(&anatomy::uniform(tissue), Some(receiver.clone()), tone);
    let [plain, lifted] = tones().map(|tone| shown(echo(-150.0), tone));
    assert!(mean(&lifted) < 255.0 * NOISE_GREY, "{}", mean(&lifted));
    // Beyond 82 mm the compensation has brought the noise to where it may be.
    let deep = |greys: &[f64]| {
        mean(
            &greys
                .chunks(192)
                .flat_map(|line| line[176..].to_vec())
                .collect::<Vec<_>>(),
        )
    };
    assert!((deep(&plain) - deep(&lifted)).abs() < 1e-9);
    // Tissue 10 dB below the usual is lifted where there is room.
    let faint = Acoustics {
        attenuation_db_cm_mhz: 0.5,
        ..echo(USUAL_DB - 10.0)
    };
    let [plain, lifted] = tones().map(|tone| mean(&shown(faint, tone)));
    assert!(lifted > plain + 20.0, "{plain} {lifted}");
}
