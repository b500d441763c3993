//! Tone: a logarithm, clamped. Its slope is steep for faint echoes, so the bound is taken at both ends of the interval
//! that the amplitude is known to. Automatic gain is a ratio of two sums over a band of depth, of terms that rise with
//! the amplitude: so are its ends.

use insonify_imaging::effects::receiver::Receiver;
use insonify_imaging::effects::tone::{Curve, Tone};

use crate::parity_tests::case::{Case, check_all, random};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn linear_and_compressed_tones() {
    let curves = [
        ("linear", None),
        ("60 dB", Some(Tone::default())),
        (
            "30 dB, gamma 0.5",
            Some(Tone {
                dynamic_range_db: 30.0,
                gamma: 0.5,
                gain_db: -3.0,
                ..Tone::linear()
            }),
        ),
        (
            "90 dB, gamma 2.2, points",
            Some(Tone {
                dynamic_range_db: 90.0,
                gamma: 2.2,
                tgc_db_cm: Some(2.5),
                tgc_points: vec![[5.0, -10.0], [20.0, 4.0], [33.0, 9.0]],
                curve: Curve::Linear,
                ..Tone::default()
            }),
        ),
        (
            "45 dB, S, gamma 0.7, all taken out",
            Some(Tone {
                dynamic_range_db: 45.0,
                gamma: 0.7,
                auto_gain: 1.0,
                ..Tone::default()
            }),
        ),
    ];
    let mut cases = Vec::new();
    for (number, (name, tone)) in curves.into_iter().enumerate() {
        // Of the bands of depth: as many samples in each, not, and fewer than bands.
        for (speckled, samples) in [(false, 96), (true, 151), (false, 11)] {
            let mut settings = scene::settings(scene::probe(SHAPES[number].1, 40.0, 24, samples), scene::bare());
            // Noise that the automatic gain must not lift.
            settings.effects.receiver = (number == 4 && samples == 96).then(|| Receiver {
                noise_db: -25.0,
                ..Receiver::default()
            });
            settings.effects.tone = tone.clone();
            settings.effects.speckle = speckled.then(Default::default);
            cases.push(random(
                format!("{name}, speckle {speckled}, {samples} samples"),
                settings,
            ));
        }
    }
    // What lies behind gas is not measured.
    for (_, shape) in SHAPES {
        let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 151), scene::bare());
        settings.effects.shadow = Some(Default::default());
        settings.effects.tone = Some(Tone::default());
        cases.push(Case::new(
            "behind gas",
            scenes::with_gas(),
            settings,
            scenes::oblique_pose(),
        ));
    }
    check_all(&cases);
}
