//! Quantise: to the nearest byte. A grey level known to within a bound may come out as any byte between those of its
//! ends.

use crate::parity_tests::case::{check_all, random};
use crate::support::scene;
use insonify_imaging::effects::Effects;

#[test]
fn rows_that_are_no_whole_words() {
    let mut cases = Vec::new();
    for width in [1, 2, 3, 5, 255, 256, 258] {
        let probe = scene::probe(scene::SHAPES[1].1, 40.0, 8, 32);
        let settings = scene::sized(probe, Effects::all(), width, 9);
        cases.push(random(format!("{width} columns"), settings));
    }
    check_all(&cases);
}
