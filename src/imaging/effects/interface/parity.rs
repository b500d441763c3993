//! Interface: normals of labels and roughness at positions known to within rounding, with and without a point spread.

use insonify_imaging::effects::interface::Interface;

use crate::parity_tests::case::{Case, check_all, random};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn steps_of_impedance_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (number, (name, shape)) in SHAPES.into_iter().enumerate() {
        let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
        settings.effects.interface = Some(Interface {
            directivity: [0.0, 1.0, 6.0, 20.0, 64.0][number % 5],
            roughness: [0.0, 0.4, 1.0, 0.4, 0.2][number % 5],
            ..Default::default()
        });
        settings.effects.speckle = (number % 2 == 0).then(Default::default);
        cases.push(random(name, settings.clone()));
        cases.push(Case::new(
            format!("{name}, ball"),
            scenes::ball(),
            settings,
            scene::straight(),
        ));
    }
    check_all(&cases);
}
