//! Speckle reduction: the means of lines, weighted by how even they are.

use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::speckle_reduction::SpeckleReduction;

use crate::parity_tests::case::{check_all, random};
use crate::support::scene::{self, SHAPES};

#[test]
fn short_and_long_windows_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (lines, samples) in [(24, 96), (3, 5), (1, 40), (9, 1)] {
            for (strength, window_cells) in [(0.6, 4.0), (1.0, 16.0), (1.0, 1.0)] {
                let mut settings = scene::settings(scene::probe(shape, 40.0, lines, samples), scene::bare());
                settings.effects.speckle = Some(Speckle::default());
                settings.effects.speckle_reduction = Some(SpeckleReduction { strength, window_cells });
                cases.push(random(
                    format!("{name}, {lines} lines, {samples} samples, {window_cells} cells"),
                    settings,
                ));
            }
        }
    }
    check_all(&cases);
}

/// Without speckle an edge has the same amplitude on each side: weights there are exactly 1 or near 0.
#[test]
fn labels_without_speckle() {
    let mut settings = scene::settings(scene::small_probe(), scene::bare());
    settings.effects.speckle_reduction = Some(SpeckleReduction::default());
    check_all(&[random("labels alone", settings)]);
}
