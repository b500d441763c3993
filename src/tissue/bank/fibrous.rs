//! Muscle and connective tissue: strands and layers.

use super::cells::Cells;
use super::field::{Grid, Seed, bump, smoothstep};
use super::strands::Strands;

/// Fibres along the first axis: dark fascicles, faint walls of perimysium between them that come and go, and bright
/// strands of fibrous and fatty tissue 5 to 30 mm long.
pub(super) fn muscle(grid: &Grid, seed: Seed) -> Vec<f32> {
    let streaks = grid.gaussian(seed, 0, [4.0, 0.4, 0.4]);
    let bundles = grid.gaussian(seed, 1, [9.0, 1.6, 1.6]);
    let gate = grid.gaussian(seed, 2, [4.0, 1.2, 1.2]);
    let sway = [3, 4].map(|stream| grid.gaussian(seed, stream, [8.0, 3.0, 3.0]));
    let fascicles = Cells::new(grid, seed, 5, [32.0, 4.2, 2.6]);
    let strands = Strands {
        density: 14.0,
        length_mm: [5.0, 30.0],
        thickness_mm: [0.35, 0.6],
        width_mm: [1.0, 3.2],
        peak_db: [6.0, 17.0],
        slope: 0.1,
    }
    .lay(grid, seed, 7);
    grid.fill(|i, [x, y, z]| {
        let place = fascicles.place([x, y + 0.9 * sway[0][i], z + 0.9 * sway[1][i]]);
        let wall = 9.0 * bump(place.wall_mm, 0.3) * smoothstep(-0.3, 1.2, gate[i]);
        1.8 * streaks[i] + 1.6 * bundles[i] + wall.max(strands[i])
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
    grid.fill(|i, _| 2.5 * layers[i] + 1.2 * grain[i] - 6.0 * smoothstep(1.8, 2.6, pits[i]))
}

/// Loose connective tissue: wisps that wind in all directions over an uneven ground.
pub(super) fn soft_tissue(grid: &Grid, seed: Seed) -> Vec<f32> {
    let ground = grid.gaussian(seed, 0, [2.5; 3]);
    let grain = grid.gaussian(seed, 1, [0.8; 3]);
    let sheet = grid.gaussian(seed, 2, [2.6; 3]);
    let gate = grid.gaussian(seed, 3, [2.5; 3]);
    grid.fill(|i, _| 1.5 * ground[i] + 1.2 * grain[i] + 6.0 * bump(sheet[i], 0.16) * smoothstep(0.0, 1.0, gate[i]))
}
