//! Speckle reduction: the means of lines, weighted by how even they are.

use insonify_imaging::effects::speckle::Speckle;
use insonify_imaging::effects::speckle_reduction::SpeckleReduction;

use crate::parity_tests::case::{check_all, random};
use crate::support::scene::{self, SHAPES};

#[test]
fn short_and_long_windows_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (lines, samples, strength, window_cells) in [
            (24, 96, 0.75, 5.0),
            (24, 96, 1.0, 20.0),
            (3, 5, 1.0, 1.0),
            (1, 40, 1.0, 5.0),
            (9, 1, 1.0, 5.0),
        ] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, lines, samples), scene::bare());
            settings.effects.speckle = Some(Speckle::default());
            settings.effects.speckle_reduction = Some(SpeckleReduction {
                strength: Some(strength),
                window_cells,
            });
            let name = format!("{name}, {lines} lines of {samples}, {window_cells} cells");
            cases.push(random(name, settings));
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
