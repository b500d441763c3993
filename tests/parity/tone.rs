//! Tone: a logarithm, clamped. Its slope is steep for faint echoes, so the bound is taken at both ends of the interval that
//! the amplitude is known to.

use insonify::effects::tone::Tone;

use crate::case::{Case, check_all};
use crate::scenes;
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
