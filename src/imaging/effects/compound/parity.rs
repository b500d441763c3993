//! Compounding: rotated phases, rays of steered apertures and their means, with few scanlines and samples.

use insonify_imaging::effects::compound::Compound;
use insonify_imaging::effects::interface::Interface;
use insonify_imaging::effects::shadow::Shadow;
use insonify_imaging::effects::speckle::Speckle;

use crate::parity_tests::case::{Case, check_all};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn looks_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (number, (name, shape)) in SHAPES.into_iter().enumerate() {
        for (variant, (lines, samples)) in [(11, 151), (2, 9), (24, 96)].into_iter().enumerate() {
            let mut settings = scene::settings(scene::probe(shape, 40.0, lines, samples), scene::bare());
            let effects = &mut settings.effects;
            effects.speckle = Some(Speckle::default());
            effects.interface = (variant != 1).then(Interface::default);
            effects.shadow = [None, Some(None), Some(Some(0.0))][(number + variant) % 3].map(|f_number| Shadow {
                f_number,
                ..Shadow::default()
            });
            effects.compound = Some(Compound {
                looks: [3, 5, 9][(number + variant) % 3],
                angle_deg: [8.0, 1.0, 20.0][number % 3],
            });
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
