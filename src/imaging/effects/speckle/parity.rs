//! Speckle: a lattice interpolated at positions known to within rounding, then two convolutions and a modulus.

use insonify_imaging::effects::speckle::Speckle;

use crate::parity_tests::case::{Case, check_all, random};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn speckle_on_every_probe_shape() {
    let cases: Vec<Case> = SHAPES
        .iter()
        .map(|&(name, shape)| {
            let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
            settings.effects.speckle = Some(Speckle::default());
            random(name, settings)
        })
        .collect();
    check_all(&cases);
}

#[test]
fn speckle_of_pressed_tissue() {
    let (anatomy, state) = scenes::pressed();
    let mut settings = scene::settings(scene::small_probe(), scene::bare());
    settings.effects.speckle = Some(Speckle::default());
    check_all(&[Case::new("pressed", anatomy, settings, state)]);
}

#[test]
fn short_and_long_point_spreads() {
    let mut cases = Vec::new();
    for (axial, lateral, elevational) in [(0.3, 0.4, 0.4), (3.0, 6.0, 0.8), (0.5, 8.0, 8.0)] {
        let mut settings = scene::settings(scene::small_probe(), scene::bare());
        settings.effects.speckle = Some(Speckle {
            receive_bandwidth: None,
            axial_mm: Some(axial),
            lateral_mm: Some(lateral),
            elevational_mm: Some(elevational),
            focus_mm: Some(12.0),
            focal_zone_mm: Some(9.0),
        });
        let name = format!("{axial} by {lateral} by {elevational} mm");
        cases.push(random(name, settings));
    }
    check_all(&cases);
}
