//! Quantise: to the nearest byte. A grey level known to within a bound may come out as any byte between those of its ends.

use crate::case::{Case, check_all};
use crate::scenes;
use crate::support::scene;

#[test]
fn rows_that_are_no_whole_words() {
    let mut cases = Vec::new();
    for width in [1, 2, 3, 5, 255, 256, 258] {
        let settings = scene::sized(scene::small_probe(), scenes::all_effects(), width, 9);
        cases.push(Case::new(
            format!("{width} columns"),
            scenes::random_anatomy(),
            settings,
            scenes::oblique_pose(),
        ));
    }
    check_all("words", &cases);
}
