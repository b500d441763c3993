//! Tone: a logarithm, clamped. Its slope is steep for faint echoes, so the bound is taken at both ends of the interval that
//! the amplitude is known to.

use insonify::effects::tone::{MID_GREY, Tone};

use crate::case::{Case, check_all};
use crate::rounding::{ULP, log2, pow};
use crate::scenes;
use crate::slack::{Slack, Step};
use crate::support::scene::{self, SHAPES};

/// Echoes below this are black on all backends.
const SMALLEST: f64 = 1e-10;

pub fn carry(step: &Step, slack: &mut Slack) {
    let gain = step.tables.gain.of::<f64>();
    for index in 0..step.after.amplitude.len() {
        let gain = gain[index % step.samples()];
        let (amplitude, off) = (step.before.amplitude[index], slack.amplitude[index]);
        // Gain stored (1/2), product (1).
        let off = gain * (off + 1.5 * ULP * (amplitude + off));
        let exact = gain * amplitude;
        let [low, high] = match &step.tables.settings.effects.tone {
            Some(tone) => [compressed(tone, exact - off)[0], compressed(tone, exact + off)[1]],
            None => [exact - off, exact + off].map(|a| (255.0 * a).clamp(0.0, 255.0)),
        };
        let found = step.after.amplitude[index];
        slack.amplitude[index] = (found - low).max(high - found) + ULP * 255.0;
    }
}

/// Lowest and highest grey level of an amplitude.
fn compressed(tone: &Tone, amplitude: f64) -> [f64; 2] {
    let per_octave = 20.0 * 2f64.log10() / tone.dynamic_range_db;
    let octaves = amplitude.max(SMALLEST).log2();
    let share = MID_GREY + per_octave * octaves;
    // Constants stored (1/2 each), product and sum.
    let off = per_octave * log2(octaves) + ULP * (1.5 * per_octave * octaves.abs() + 0.5 * MID_GREY + share.abs());
    [share - off, share + off]
        .map(|share| share.clamp(0.0, 1.0))
        .map(|share| {
            let mapped = if tone.gamma == 1.0 {
                share
            } else {
                share.powf(tone.gamma)
            };
            (share, mapped)
        })
        .map(|(share, mapped)| {
            (
                mapped,
                if tone.gamma == 1.0 {
                    0.0
                } else {
                    mapped * (pow(share, tone.gamma) + tone.gamma * 0.5 * ULP * share.max(1e-30).log2().abs())
                },
            )
        })
        .into_iter()
        .zip([-1.0, 1.0])
        .map(|((mapped, off), side)| (255.0 * (mapped + side * (off + ULP * mapped))).clamp(0.0, 255.0))
        .collect::<Vec<f64>>()
        .try_into()
        .expect("two ends")
}

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
                ..Tone::default()
            }),
        ),
        (
            "90 dB, gamma 2.2, points",
            Some(Tone {
                dynamic_range_db: 90.0,
                gamma: 2.2,
                tgc_db_cm: Some(2.5),
                tgc_points: vec![[5.0, -10.0], [20.0, 4.0], [33.0, 9.0]],
                ..Tone::default()
            }),
        ),
    ];
    let mut cases = Vec::new();
    for (at, (name, tone)) in curves.into_iter().enumerate() {
        for speckled in [false, true] {
            let mut settings = scene::settings(scene::probe(SHAPES[at].1, 40.0, 24, 96), scene::bare());
            settings.effects.tone = tone.clone();
            settings.effects.speckle = speckled.then(Default::default);
            cases.push(Case::new(
                format!("{name}, speckle {speckled}"),
                scenes::random_anatomy(),
                settings,
                scenes::oblique_pose(),
            ));
        }
    }
    check_all("tone", &cases);
}
