//! Geometry: probe pose times a point of a ray.

use crate::parity_tests::case::{Case, check_all, random};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};
use insonify_imaging::effects::Effects;

#[test]
fn every_probe_shape() {
    let cases: Vec<Case> = SHAPES
        .iter()
        .map(|&(name, shape)| {
            let probe = scene::probe(shape, 40.0, 24, 96);
            random(name, scene::settings(probe, scene::bare()))
        })
        .collect();
    check_all(&cases);
}

#[test]
fn one_line_one_sample_one_pixel() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (lines, samples) in [(1, 96), (24, 1), (1, 1), (2, 2)] {
            for (width, height) in [(64, 48), (1, 1)] {
                let probe = scene::probe(shape, 40.0, lines, samples);
                cases.push(random(
                    format!("{name} {lines} x {samples}, image {width} x {height}"),
                    scene::sized(probe, Effects::all(), width, height),
                ));
            }
        }
    }
    check_all(&cases);
}

#[test]
fn far_from_the_origin_of_the_world() {
    let (anatomy, state) = scenes::far_away();
    let settings = scene::settings(scene::small_probe(), Effects::all());
    check_all(&[Case::new("far away", anatomy, settings, state)]);
}
