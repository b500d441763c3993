//! Textures of parenchyma: nearly homogeneous, with a few decibels of mottling, distinguished by grain, tracts and
//! lobules.

use super::cells::Cells;
use super::field::{Grid, Seed, bump, smoothstep};

/// Approximate distance to the curves where two fields vanish together: a network of winding tubes.
fn tube(a: f32, b: f32) -> f32 {
    a.hypot(b)
}

/// Even grain, slow mottling, and thin portal tracts with bright walls.
pub(super) fn liver(grid: &Grid, seed: Seed) -> Vec<f32> {
    let slow = grid.gaussian(seed, 0, [4.5; 3]);
    let grain = grid.gaussian(seed, 1, [0.9; 3]);
    let tracts = [2, 3].map(|stream| grid.gaussian(seed, stream, [3.2; 3]));
    grid.fill(|i, _| {
        let tract = tube(tracts[0][i], tracts[1][i]);
        0.9 * slow[i] + 1.1 * grain[i] + 13.0 * bump(tract, 0.22)
    })
}

/// Finer and more homogeneous than liver.
pub(super) fn spleen(grid: &Grid, seed: Seed) -> Vec<f32> {
    let slow = grid.gaussian(seed, 0, [2.5; 3]);
    let grain = grid.gaussian(seed, 1, [0.7; 3]);
    grid.fill(|i, _| 0.5 * slow[i] + 0.8 * grain[i])
}

/// Coarser grain than liver, with small bright specks where arcuate vessels are cut.
pub(super) fn kidney_cortex(grid: &Grid, seed: Seed) -> Vec<f32> {
    let slow = grid.gaussian(seed, 0, [2.2; 3]);
    let grain = grid.gaussian(seed, 1, [0.8; 3]);
    let specks = grid.gaussian(seed, 2, [0.6; 3]);
    grid.fill(|i, _| 1.0 * slow[i] + 1.3 * grain[i] + 5.0 * smoothstep(2.2, 3.2, specks[i]))
}

/// Smooth: pyramids show little but a slow variation.
pub(super) fn kidney_medulla(grid: &Grid, seed: Seed) -> Vec<f32> {
    let slow = grid.gaussian(seed, 0, [3.5; 3]);
    let grain = grid.gaussian(seed, 1, [1.2; 3]);
    grid.fill(|i, _| 0.7 * slow[i] + 0.5 * grain[i])
}

/// Small lobules with bright fatty clefts.
pub(super) fn pancreas(grid: &Grid, seed: Seed) -> Vec<f32> {
    let cells = Cells::new(grid, seed, 0, [4.4; 3]);
    let grain = grid.gaussian(seed, 2, [0.8; 3]);
    let sway = [3, 4, 5].map(|stream| grid.gaussian(seed, stream, [1.5; 3]));
    grid.fill(|i, p| {
        let place = cells.place([0, 1, 2].map(|axis| p[axis] + 0.6 * sway[axis][i]));
        7.0 * (place.id - 0.5) + 1.2 * grain[i] + 9.0 * bump(place.wall_mm, 0.5)
    })
}

/// Fine even granules.
pub(super) fn prostate_peripheral(grid: &Grid, seed: Seed) -> Vec<f32> {
    let grain = grid.gaussian(seed, 0, [0.5; 3]);
    let slow = grid.gaussian(seed, 1, [2.0; 3]);
    grid.fill(|i, _| 1.6 * grain[i] + 0.5 * slow[i])
}

/// Nodules of unequal brightness with dark rims, finely granular inside.
pub(super) fn prostate_central(grid: &Grid, seed: Seed) -> Vec<f32> {
    let cells = Cells::new(grid, seed, 0, [7.0; 3]);
    let grain = grid.gaussian(seed, 2, [0.6; 3]);
    let sway = [3, 4, 5].map(|stream| grid.gaussian(seed, stream, [2.0; 3]));
    grid.fill(|i, p| {
        let place = cells.place([0, 1, 2].map(|axis| p[axis] + 0.9 * sway[axis][i]));
        11.0 * (place.id - 0.5) + 1.4 * grain[i] - 9.0 * bump(place.wall_mm, 0.8)
    })
}

/// Patchy, with darker spots of necrosis.
pub(super) fn lesion(grid: &Grid, seed: Seed) -> Vec<f32> {
    let patches = grid.gaussian(seed, 0, [1.8; 3]);
    let grain = grid.gaussian(seed, 1, [0.7; 3]);
    grid.fill(|i, _| 3.0 * patches[i] + 1.5 * grain[i] - 9.0 * smoothstep(1.2, 2.0, patches[i]))
}
