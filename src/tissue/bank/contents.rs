//! Textures of the contents of hollow organs, and of phantoms' gel.

use super::field::{Grid, Seed, smoothstep};

/// Drifting haze.
pub(super) fn blood(grid: &Grid, seed: Seed) -> Vec<f32> {
    let swirls = grid.gaussian(seed, 0, [1.6; 3]);
    grid.fill(|i, _| 2.0 * swirls[i])
}

/// Faint slow haze.
pub(super) fn bile(grid: &Grid, seed: Seed) -> Vec<f32> {
    let haze = grid.gaussian(seed, 0, [4.0; 3]);
    grid.fill(|i, _| 2.5 * haze[i])
}

/// Patches of fluid and of solids, with bright bubbles.
pub(super) fn bowel(grid: &Grid, seed: Seed) -> Vec<f32> {
    let patches = grid.gaussian(seed, 0, [3.2; 3]);
    let lumps = grid.gaussian(seed, 1, [1.3; 3]);
    let bubbles = grid.gaussian(seed, 2, [0.6; 3]);
    grid.fill(|i, _| {
        let fluid = smoothstep(0.5, 1.4, patches[i]);
        let solid = 3.5 * lumps[i] + 11.0 * smoothstep(1.7, 2.6, bubbles[i]);
        solid * (1.0 - 0.7 * fluid) - 9.0 * fluid
    })
}

/// An irregular mirror: bright patches.
pub(super) fn gas(grid: &Grid, seed: Seed) -> Vec<f32> {
    let patches = grid.gaussian(seed, 0, [2.0; 3]);
    grid.fill(|i, _| 3.0 * patches[i])
}

/// Homogeneous, as a moulded phantom.
pub(super) fn gel(grid: &Grid, seed: Seed) -> Vec<f32> {
    let grain = grid.gaussian(seed, 0, [0.6; 3]);
    grid.fill(|i, _| 0.6 * grain[i])
}
