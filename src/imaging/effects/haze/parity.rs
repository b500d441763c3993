//! Haze: means of power over columns, its decay in parallel, and the sum of powers, with few scanlines and samples.

use insonify_imaging::effects::haze::Haze;
use insonify_imaging::effects::shadow::Shadow;

use crate::parity_tests::case::{Case, check_all};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn haze_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (number, (name, shape)) in SHAPES.into_iter().enumerate() {
        for (lines, samples) in [(11, 151), (1, 9), (40, 700)] {
            let haze = Haze {
                behind_db: [-3.0, -12.0][number % 2],
                behind_mm: [80.0, 7.0, 30.0][number % 3],
                level_db: [-20.0, -3.0, 0.0][number % 3],
                lateral_mm: [15.0, 0.5, 500.0, 4.0][number % 4],
                axial_mm: [8.0, 0.1, 500.0, 1.0][number % 4],
            };
            let mut settings = scene::settings(scene::probe(shape, 40.0, lines, samples), scene::bare());
            settings.effects.haze = Some(haze);
            settings.effects.shadow = (lines != 11).then(Shadow::default);
            let name = format!("{name}, {lines} lines, {samples} samples");
            cases.push(Case::new(
                name,
                scenes::random_anatomy(),
                settings,
                scenes::oblique_pose(),
            ));
        }
    }
    check_all(&cases);
}
