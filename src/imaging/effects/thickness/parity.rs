//! Thickness: a power average over sub-planes, on which every label that rounding allows counts.

use insonify_imaging::effects::slice::Boundary;
use insonify_imaging::effects::thickness::Thickness;

use crate::parity_tests::case::{Case, check_all, random};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn thick_planes_of_every_probe_shape() {
    let mut cases = Vec::new();
    for (number, (name, shape)) in SHAPES.into_iter().enumerate() {
        let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
        settings.effects.thickness = Some(Thickness {
            width_mm: (number != 2).then_some(4.0),
            planes: [3, 5, 7, 9, 5][number % 5],
        });
        settings.effects.texture = (number % 2 == 0).then(Default::default);
        settings.effects.slice.boundary = [Boundary::Smooth, Boundary::Nearest, Boundary::Vote][number % 3];
        cases.push(random(name, settings));
    }
    check_all(&cases);
}

#[test]
fn thick_planes_through_a_deforming_mesh() {
    let (anatomy, state) = scenes::pressed();
    let mut settings = scene::settings(scene::small_probe(), scene::bare());
    settings.effects.thickness = Some(Thickness {
        width_mm: Some(4.0),
        planes: 5,
    });
    check_all(&[Case::new("pressed", anatomy, settings, state)]);
}
