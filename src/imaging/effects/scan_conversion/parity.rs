//! Scan conversion: bilinear between four samples, at coordinates that all backends share.

use crate::parity_tests::case::{check_all, random};
use crate::support::scene::{self, SHAPES};

#[test]
fn pixels_of_every_probe_shape_at_odd_sizes() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (width, height) in [(64, 48), (257, 31), (3, 200), (1, 1)] {
            let probe = scene::probe(shape, 40.0, 24, 96);
            let settings = scene::sized(probe, scene::bare(), width, height);
            cases.push(random(format!("{name} {width} x {height}"), settings));
        }
    }
    check_all(&cases);
}
