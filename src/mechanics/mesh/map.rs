//! Map from the world to the reference state, one scanline at a time.
//!
//! | location of a sample | position after the map | flag (`w`) |
//! |---|---|---|
//! | the deformed mesh | the reference position of the same tissue | [`MAPPED`], or [`FOLDED`] in a fold |
//! | the reference mesh only | unchanged: its tissue has moved away | [`BACKGROUND`] |
//! | neither | unchanged | [`OUTSIDE`] |

mod states;

use rayon::prelude::*;

pub use states::{Moved, States};

use super::locator::{Locator, NONE};
use crate::base::real::Real;

/// Flag of a sample in the deformed mesh; its position is now a reference position.
pub const MAPPED: u32 = 0;
/// Flag of a sample whose tissue has moved away: it is background.
pub const BACKGROUND: u32 = 1;
/// Flag of a sample where the mesh is folded: its reference position is one of several valid ones.
pub const FOLDED: u32 = 2;
/// Flag of a sample outside the mesh in both states; reference and world are the same there.
pub const OUTSIDE: u32 = 3;

/// Maps the samples of one scanline.
///
/// `positions` contains world positions (mm) in x, y, z; each is replaced as in the table of the [module](self), with its
/// flag as a number in w. `elements` contains the element of each sample in the last frame (or [`NONE`]) and receives that
/// of this one. `reference` is a locator of the same mesh in its reference state.
///
/// # Panics
/// If the slices differ in length.
pub fn map_line<T: Real>(
    deformed: &Locator<T>,
    reference: &Locator<T>,
    positions: &mut [[T; 4]],
    elements: &mut [u32],
) {
    assert_eq!(positions.len(), elements.len(), "one element a sample");
    let mut before = NONE;
    for (position, element) in positions.iter_mut().zip(elements) {
        let start = if *element == NONE { before } else { *element };
        let p = [position[0], position[1], position[2]];
        let hit = deformed.locate(p, start);
        *element = hit.element;
        before = hit.element;
        let flag = match hit.element {
            NONE if reference.locate(p, NONE).element == NONE => OUTSIDE,
            NONE => BACKGROUND,
            element => {
                let [x, y, z] = deformed.to_reference(element, p);
                (position[0], position[1], position[2]) = (x, y, z);
                if hit.folded { FOLDED } else { MAPPED }
            }
        };
        position[3] = T::of(f64::from(flag));
    }
}

/// Maps all scanlines of a frame, with `samples` per line, in parallel; a line at a time, so the result does not depend on
/// the number of threads.
///
/// # Panics
/// If the slices differ in length.
pub fn map_lines<T: Real>(
    deformed: &Locator<T>,
    reference: &Locator<T>,
    samples: usize,
    positions: &mut [[T; 4]],
    elements: &mut [u32],
) {
    assert_eq!(positions.len(), elements.len(), "one element a sample");
    let samples = samples.max(1);
    positions
        .par_chunks_mut(samples)
        .zip(elements.par_chunks_mut(samples))
        .for_each(|(positions, elements)| map_line(deformed, reference, positions, elements));
}

#[cfg(test)]
mod tests;
