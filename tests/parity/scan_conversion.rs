//! Scan conversion: bilinear between four samples, at coordinates that all backends share.

use super::case::{Case, check_all};
use super::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn pixels_of_every_probe_shape_at_odd_sizes() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (width, height) in [(64, 48), (257, 31), (3, 200), (1, 1)] {
            let probe = scene::probe(shape, 40.0, 24, 96);
            let settings = scene::sized(probe, scene::bare(), width, height);
            cases.push(Case::new(
                format!("{name} {width} x {height}"),
                scenes::random_anatomy(),
                settings,
                scenes::oblique_pose(),
            ));
        }
    }
    check_all("scan conversion", &cases);
}
