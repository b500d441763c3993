//! Refraction: whole numbers of phase, and the sum of their curvature, with few scanlines and many samples.

use insonify_imaging::effects::compound::Compound;
use insonify_imaging::effects::refraction::Refraction;
use insonify_imaging::effects::speckle::Speckle;

use crate::parity_tests::case::{Case, check_all};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn steps_of_the_speed_of_sound_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (number, (name, shape)) in SHAPES.into_iter().enumerate() {
        for (lines, samples) in [(24, 96), (5, 700)] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, lines, samples), scene::bare());
            settings.effects.refraction = Some(Refraction {
                beam_mm: [3.0, 0.5, 20.0, 6.0, 1.5][number % 5],
            });
            let mut compounded = settings.clone();
            compounded.effects.speckle = Some(Speckle::default());
            compounded.effects.compound = Some(Compound {
                looks: [3, 9, 5][number % 3],
                angle_deg: [20.0, 4.0][number % 2],
            });
            cases.push(Case::new(
                format!("{name}, {lines} lines, {samples} samples, looks"),
                scenes::random_anatomy(),
                compounded,
                scenes::oblique_pose(),
            ));
            for (volume, anatomy, state) in [
                ("random", scenes::random_anatomy(), scenes::oblique_pose()),
                ("ball", scenes::ball(), scene::straight()),
            ] {
                let name = format!("{name}, {lines} lines, {samples} samples, {volume}");
                cases.push(Case::new(name, anatomy, settings.clone(), state));
            }
        }
    }
    check_all(&cases);
}
