//! Textures of fat: lobules and septa.

use super::cells::Cells;
use super::field::{Grid, Seed, bump, smoothstep};

/// Dark lobules, flattened across the first axis, between bright wavy septa; those that face the first axis are the
/// brightest, as mirrors to a beam from the skin.
pub(super) fn fat(grid: &Grid, seed: Seed) -> Vec<f32> {
    let lobules = Cells::new(grid, seed, 0, [5.6, 12.0, 12.0]);
    let sway = [2, 3, 4].map(|stream| grid.gaussian(seed, stream, [2.0, 3.2, 3.2]));
    let gate = grid.gaussian(seed, 5, [1.5, 3.0, 3.0]);
    let grain = grid.gaussian(seed, 6, [0.7; 3]);
    let wisps = grid.gaussian(seed, 7, [0.45, 2.4, 2.4]);
    grid.fill(|i, p| {
        let place = lobules.place([0, 1, 2].map(|axis| p[axis] + [1.0, 1.2, 1.2][axis] * sway[axis][i]));
        let brightness = (0.35 + 0.65 * place.facing[0]) * (0.35 + 0.65 * smoothstep(-1.0, 0.8, gate[i]));
        let septum = 24.0 * bump(place.wall_mm, 0.42) * brightness;
        2.0 * (place.id - 0.5) + 0.9 * grain[i] + 1.4 * wisps[i] + septum
    })
}

/// Bright fat around dark vessels and calyces.
pub(super) fn renal_sinus(grid: &Grid, seed: Seed) -> Vec<f32> {
    let clumps = grid.gaussian(seed, 0, [1.6; 3]);
    let grain = grid.gaussian(seed, 1, [0.8; 3]);
    let vessels = [2, 3].map(|stream| grid.gaussian(seed, stream, [2.8; 3]));
    grid.fill(|i, _| {
        let vessel = vessels[0][i].hypot(vessels[1][i]);
        3.4 * clumps[i] + 1.5 * grain[i] - 16.0 * smoothstep(0.6, 0.4, vessel)
    })
}
