//! Contact: gaps found once for all backends, then a shift along the beam.

use insonify_imaging::effects::contact::Contact;
use insonify_imaging::effects::thickness::Thickness;

use crate::parity_tests::case::{Case, check_all};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn every_probe_shape_pressed_to_random_tissue() {
    let mut cases = Vec::new();
    for (number, (name, shape)) in SHAPES.into_iter().enumerate() {
        let mut settings = scene::settings(scene::probe(shape, 70.0, 11, 151), scene::bare());
        settings.effects.contact = Some(Contact {
            reach_mm: [12.0, 20.0, 3.0, 0.0, 7.0][number % 5],
            ..Contact::default()
        });
        settings.effects.thickness = (number % 2 == 0).then(Thickness::default);
        settings.effects.speckle = (number > 2).then(Default::default);
        let (anatomy, state) = match number {
            1 => scenes::far_away(),
            2 => scenes::pressed(),
            _ => (scenes::random_anatomy(), scenes::oblique_pose()),
        };
        cases.push(Case::new(name, anatomy, settings, state));
    }
    check_all(&cases);
}
