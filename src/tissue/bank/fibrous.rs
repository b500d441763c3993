//! Textures of muscle and connective tissue: strands and layers.

use super::cells::Cells;
use super::field::{Grid, Seed, bump, smoothstep};
use super::strands::Strands;

/// Fibres along the first axis: dark fascicles, faint intermittent walls of perimysium between them, and bright
/// strands of fibrous and fatty tissue 5 to 30 mm long.
pub(super) fn muscle(grid: &Grid, seed: Seed) -> Vec<f32> {
    let streaks = grid.gaussian(seed, 0, [5.0, 0.4, 0.5]);
    let bundles = grid.gaussian(seed, 1, [9.0, 1.6, 1.6]);
    let gate = grid.gaussian(seed, 2, [4.0, 1.2, 1.2]);
    let sway = [3, 4].map(|stream| grid.gaussian(seed, stream, [8.0, 3.0, 3.0]));
    let fascicles = Cells::new(grid, seed, 5, [32.0, 4.7, 9.0]);
    let strands = Strands {
        density: 2.8,
        length_mm: [5.0, 30.0],
        thickness_mm: [0.4, 0.7],
        width_mm: [2.0, 8.0],
        peak_db: [14.0, 36.0],
        slope: 0.1,
        roll: 0.6,
    }
    .lay(grid, seed, 7);
    grid.fill(|i, [x, y, z]| {
        let place = fascicles.place([x, y + 0.9 * sway[0][i], z + 0.9 * sway[1][i]]);
        let wall = 18.0 * bump(place.wall_mm, 0.35) * place.facing[1] * smoothstep(0.2, 1.8, gate[i]);
        2.8 * streaks[i] + 1.6 * bundles[i] + wall.max(strands[i])
    })
}

/// Thin sheets across the first axis.
pub(super) fn fascia(grid: &Grid, seed: Seed) -> Vec<f32> {
    let sheets = grid.gaussian(seed, 0, [0.3, 5.0, 5.0]);
    let breaks = grid.gaussian(seed, 1, [0.8, 2.5, 2.5]);
    grid.fill(|i, _| 5.0 * sheets[i] + 1.5 * breaks[i])
}

/// Fine layers across the first axis, broken by follicles and glands.
pub(super) fn skin(grid: &Grid, seed: Seed) -> Vec<f32> {
    let layers = grid.gaussian(seed, 0, [0.25, 2.5, 2.5]);
    let grain = grid.gaussian(seed, 1, [0.4, 0.6, 0.6]);
    let pits = grid.gaussian(seed, 2, [1.2, 0.7, 0.7]);
    grid.fill(|i, _| 4.5 * layers[i] + 1.2 * grain[i] - 9.0 * smoothstep(1.6, 2.4, pits[i]))
}

/// Loose connective tissue: wisps that wind in all directions over an irregular background.
pub(super) fn soft_tissue(grid: &Grid, seed: Seed) -> Vec<f32> {
    let ground = grid.gaussian(seed, 0, [2.5; 3]);
    let grain = grid.gaussian(seed, 1, [0.8; 3]);
    let sheet = grid.gaussian(seed, 2, [2.6; 3]);
    let gate = grid.gaussian(seed, 3, [2.5; 3]);
    grid.fill(|i, _| 2.2 * ground[i] + 1.2 * grain[i] + 13.0 * bump(sheet[i], 0.15) * smoothstep(0.0, 1.0, gate[i]))
}
