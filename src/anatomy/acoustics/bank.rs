//! Bank of solid textures: structure larger than speckle, generated from a name and a seed.
//!
//! Each texture is a field of decibels on a periodic grid, built from smoothed hashed noise (`field`), cells (`cells`)
//! and strands (`strands`). Lattice coordinates wrap before they are hashed, so the period is exact. Speckle is not
//! part of a texture: correlation lengths are about a millimetre and above, except for strands and septa.
//!
//! A new texture requires a row in `RECIPES`.

mod field;

use field::{Cells, Grid, Seed, Strands, bump, smoothstep};

use crate::volume::texture::SolidTexture;
use insonify_base::cache::cached;

/// Recipe of a texture: its grid and the function that fills it with decibels.
struct Recipe {
    name: &'static str,
    size: [usize; 3],
    spacing_mm: [f32; 3],
    decibels: fn(&Grid, Seed) -> Vec<f32>,
}

const fn recipe(
    name: &'static str,
    size: [usize; 3],
    spacing_mm: [f32; 3],
    decibels: fn(&Grid, Seed) -> Vec<f32>,
) -> Recipe {
    Recipe {
        name,
        size,
        spacing_mm,
        decibels,
    }
}

const RECIPES: &[Recipe] = &[
    recipe("liver", [64; 3], [0.7; 3], liver),
    recipe("spleen", [48; 3], [0.7; 3], spleen),
    recipe("kidney_cortex", [56; 3], [0.55; 3], kidney_cortex),
    recipe("kidney_medulla", [40; 3], [0.9; 3], kidney_medulla),
    recipe("renal_sinus", [56; 3], [0.6; 3], renal_sinus),
    recipe("pancreas", [56; 3], [0.6; 3], pancreas),
    recipe("prostate_peripheral", [56; 3], [0.5; 3], prostate_peripheral),
    recipe("prostate_central", [60; 3], [0.6; 3], prostate_central),
    recipe("lesion", [48; 3], [0.6; 3], lesion),
    recipe("muscle", [64, 128, 128], [1.5, 0.33, 0.33], muscle),
    recipe("fascia", [64, 32, 32], [0.25, 1.2, 1.2], fascia),
    recipe("skin", [48, 40, 40], [0.2, 0.6, 0.6], skin),
    recipe("soft_tissue", [60; 3], [0.6; 3], soft_tissue),
    recipe("fat", [96, 80, 80], [0.4, 0.6, 0.6], fat),
    recipe("blood", [32; 3], [0.8; 3], blood),
    recipe("bile", [24; 3], [1.5; 3], bile),
    recipe("bowel", [60; 3], [0.6; 3], bowel),
    recipe("gas", [32; 3], [1.0; 3], gas),
    recipe("gel", [48; 3], [0.6; 3], gel),
];

/// Names of the textures of [`make`].
pub fn names() -> impl Iterator<Item = &'static str> {
    RECIPES.iter().map(|recipe| recipe.name)
}

/// Generates the texture of that name; `None` if the bank has none. The same seed gives the same bytes at any thread
/// count, and different textures are independent under one seed.
pub fn make(name: &str, seed: u64) -> Option<SolidTexture> {
    let (position, recipe) = RECIPES.iter().enumerate().find(|(_, recipe)| recipe.name == name)?;
    let grid = Grid::new(recipe.size, recipe.spacing_mm);
    let length = size_of::<f32>() * recipe.size.iter().product::<usize>();
    let bytes = cached(&format!("texture {name} {seed}"), length, || {
        let mut data = (recipe.decibels)(&grid, Seed::new(seed, position as u32));
        field::to_amplitudes(&mut data);
        bytemuck::cast_slice(&data).to_vec()
    });
    let data = bytemuck::pod_collect_to_vec(&bytes);
    SolidTexture::new(recipe.size, recipe.spacing_mm.map(f64::from), data).ok()
}

// Textures of fat: lobules and septa.

/// Dark lobules, flattened across the first axis, between bright wavy septa; those that face the first axis are the
/// brightest, as mirrors to a beam from the skin.
fn fat(grid: &Grid, seed: Seed) -> Vec<f32> {
    let lobules = Cells::new(grid, seed, 0, [5.6, 12.0, 12.0]);
    let sway = [2, 3, 4].map(|stream| grid.gaussian(seed, stream, [2.0, 3.2, 3.2]));
    let gate = grid.gaussian(seed, 5, [1.5, 3.0, 3.0]);
    let grain = grid.gaussian(seed, 6, [0.7; 3]);
    let wisps = grid.gaussian(seed, 7, [0.45, 2.4, 2.4]);
    grid.fill(|i, p| {
        let lobule = lobules.place([0, 1, 2].map(|axis| p[axis] + [1.0, 1.2, 1.2][axis] * sway[axis][i]));
        let facing = lobule.facing[0] * lobule.facing[0];
        let brightness = (0.2 + 0.8 * facing) * (0.35 + 0.65 * smoothstep(-1.0, 0.8, gate[i]));
        let septum = 24.0 * bump(lobule.wall_mm, 0.32) * brightness;
        2.0 * (lobule.id - 0.5) + 0.9 * grain[i] + 1.4 * wisps[i] + septum
    })
}

/// Bright fat around dark vessels and calyces.
fn renal_sinus(grid: &Grid, seed: Seed) -> Vec<f32> {
    let clumps = grid.gaussian(seed, 0, [1.6; 3]);
    let grain = grid.gaussian(seed, 1, [0.8; 3]);
    let vessels = [2, 3].map(|stream| grid.gaussian(seed, stream, [2.8; 3]));
    grid.fill(|i, _| {
        let vessel = vessels[0][i].hypot(vessels[1][i]);
        3.4 * clumps[i] + 1.5 * grain[i] - 16.0 * smoothstep(0.6, 0.4, vessel)
    })
}

// Textures of the contents of hollow organs, and of phantoms' gel.

/// Drifting haze.
fn blood(grid: &Grid, seed: Seed) -> Vec<f32> {
    let swirls = grid.gaussian(seed, 0, [1.6; 3]);
    grid.fill(|i, _| 2.0 * swirls[i])
}

/// Faint slow haze.
fn bile(grid: &Grid, seed: Seed) -> Vec<f32> {
    let haze = grid.gaussian(seed, 0, [4.0; 3]);
    grid.fill(|i, _| 2.5 * haze[i])
}

/// Patches of fluid and of solids, with bright bubbles.
fn bowel(grid: &Grid, seed: Seed) -> Vec<f32> {
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
fn gas(grid: &Grid, seed: Seed) -> Vec<f32> {
    let patches = grid.gaussian(seed, 0, [2.0; 3]);
    grid.fill(|i, _| 3.0 * patches[i])
}

/// Homogeneous, as a moulded phantom.
fn gel(grid: &Grid, seed: Seed) -> Vec<f32> {
    let grain = grid.gaussian(seed, 0, [0.6; 3]);
    grid.fill(|i, _| 0.6 * grain[i])
}

// Textures of muscle and connective tissue: strands and layers.

/// Fibres along the first axis: dark fascicles, faint intermittent walls of perimysium between them, and bright
/// strands of fibrous and fatty tissue 4 to 18 mm long.
fn muscle(grid: &Grid, seed: Seed) -> Vec<f32> {
    let streaks = grid.gaussian(seed, 0, [5.0, 0.4, 0.5]);
    let bundles = grid.gaussian(seed, 1, [9.0, 1.6, 1.6]);
    let gate = grid.gaussian(seed, 2, [4.0, 1.2, 1.2]);
    let sway = [3, 4].map(|stream| grid.gaussian(seed, stream, [8.0, 3.0, 3.0]));
    let fascicles = Cells::new(grid, seed, 5, [32.0, 4.7, 9.0]);
    let strands = Strands {
        density: 15.0,
        length_mm: [4.0, 18.0],
        thickness_mm: [0.35, 0.6],
        width_mm: [1.5, 6.0],
        peak_db: [14.0, 31.0],
        slope: 0.1,
        roll: 0.6,
    }
    .draw(grid, seed, 7);
    grid.fill(|i, [x, y, z]| {
        let fascicle = fascicles.place([x, y + 0.9 * sway[0][i], z + 0.9 * sway[1][i]]);
        let wall = 18.0 * bump(fascicle.wall_mm, 0.35) * fascicle.facing[1] * smoothstep(0.2, 1.8, gate[i]);
        3.6 * streaks[i] + 1.6 * bundles[i] + wall.max(strands[i])
    })
}

/// Thin sheets across the first axis.
fn fascia(grid: &Grid, seed: Seed) -> Vec<f32> {
    let sheets = grid.gaussian(seed, 0, [0.3, 5.0, 5.0]);
    let breaks = grid.gaussian(seed, 1, [0.8, 2.5, 2.5]);
    grid.fill(|i, _| 5.0 * sheets[i] + 1.5 * breaks[i])
}

/// Fine layers across the first axis, broken by follicles and glands.
fn skin(grid: &Grid, seed: Seed) -> Vec<f32> {
    let layers = grid.gaussian(seed, 0, [0.25, 2.5, 2.5]);
    let grain = grid.gaussian(seed, 1, [0.4, 0.6, 0.6]);
    let pits = grid.gaussian(seed, 2, [1.2, 0.7, 0.7]);
    grid.fill(|i, _| 4.5 * layers[i] + 1.2 * grain[i] - 9.0 * smoothstep(1.6, 2.4, pits[i]))
}

/// Loose connective tissue: wisps that wind in all directions over an irregular background.
fn soft_tissue(grid: &Grid, seed: Seed) -> Vec<f32> {
    let ground = grid.gaussian(seed, 0, [2.5; 3]);
    let grain = grid.gaussian(seed, 1, [0.8; 3]);
    let sheet = grid.gaussian(seed, 2, [2.6; 3]);
    let gate = grid.gaussian(seed, 3, [2.5; 3]);
    grid.fill(|i, _| 2.2 * ground[i] + 1.2 * grain[i] + 13.0 * bump(sheet[i], 0.15) * smoothstep(0.0, 1.0, gate[i]))
}

// Textures of parenchyma: nearly homogeneous, with a few decibels of mottling, distinguished by grain, tracts and
// lobules.

/// Approximate distance to the curves where two fields vanish together: a network of winding tubes.
fn tube(a: f32, b: f32) -> f32 {
    a.hypot(b)
}

/// Even grain, slow mottling, and thin portal tracts with bright walls.
fn liver(grid: &Grid, seed: Seed) -> Vec<f32> {
    let slow = grid.gaussian(seed, 0, [4.5; 3]);
    let grain = grid.gaussian(seed, 1, [0.9; 3]);
    let tracts = [2, 3].map(|stream| grid.gaussian(seed, stream, [3.2; 3]));
    grid.fill(|i, _| {
        let tract = tube(tracts[0][i], tracts[1][i]);
        0.9 * slow[i] + 1.1 * grain[i] + 13.0 * bump(tract, 0.22)
    })
}

/// Finer and more homogeneous than liver.
fn spleen(grid: &Grid, seed: Seed) -> Vec<f32> {
    let slow = grid.gaussian(seed, 0, [2.5; 3]);
    let grain = grid.gaussian(seed, 1, [0.7; 3]);
    grid.fill(|i, _| 0.5 * slow[i] + 0.8 * grain[i])
}

/// Coarser grain than liver, with small bright specks where arcuate vessels are cut.
fn kidney_cortex(grid: &Grid, seed: Seed) -> Vec<f32> {
    let slow = grid.gaussian(seed, 0, [2.2; 3]);
    let grain = grid.gaussian(seed, 1, [0.8; 3]);
    let specks = grid.gaussian(seed, 2, [0.6; 3]);
    grid.fill(|i, _| 1.0 * slow[i] + 1.3 * grain[i] + 5.0 * smoothstep(2.2, 3.2, specks[i]))
}

/// Smooth: pyramids show little but a slow variation.
fn kidney_medulla(grid: &Grid, seed: Seed) -> Vec<f32> {
    let slow = grid.gaussian(seed, 0, [3.5; 3]);
    let grain = grid.gaussian(seed, 1, [1.2; 3]);
    grid.fill(|i, _| 0.7 * slow[i] + 0.5 * grain[i])
}

/// Small lobules with bright fatty clefts.
fn pancreas(grid: &Grid, seed: Seed) -> Vec<f32> {
    let cells = Cells::new(grid, seed, 0, [4.4; 3]);
    let grain = grid.gaussian(seed, 2, [0.8; 3]);
    let sway = [3, 4, 5].map(|stream| grid.gaussian(seed, stream, [1.5; 3]));
    grid.fill(|i, p| {
        let cell = cells.place([0, 1, 2].map(|axis| p[axis] + 0.6 * sway[axis][i]));
        7.0 * (cell.id - 0.5) + 1.2 * grain[i] + 9.0 * bump(cell.wall_mm, 0.5)
    })
}

/// Fine even granules.
fn prostate_peripheral(grid: &Grid, seed: Seed) -> Vec<f32> {
    let grain = grid.gaussian(seed, 0, [0.5; 3]);
    let slow = grid.gaussian(seed, 1, [2.0; 3]);
    grid.fill(|i, _| 1.6 * grain[i] + 0.5 * slow[i])
}

/// Nodules of unequal brightness with dark rims, finely granular inside.
fn prostate_central(grid: &Grid, seed: Seed) -> Vec<f32> {
    let cells = Cells::new(grid, seed, 0, [7.0; 3]);
    let grain = grid.gaussian(seed, 2, [0.6; 3]);
    let sway = [3, 4, 5].map(|stream| grid.gaussian(seed, stream, [2.0; 3]));
    grid.fill(|i, p| {
        let cell = cells.place([0, 1, 2].map(|axis| p[axis] + 0.9 * sway[axis][i]));
        11.0 * (cell.id - 0.5) + 1.4 * grain[i] - 9.0 * bump(cell.wall_mm, 0.8)
    })
}

/// Patchy, with darker spots of necrosis.
fn lesion(grid: &Grid, seed: Seed) -> Vec<f32> {
    let patches = grid.gaussian(seed, 0, [1.8; 3]);
    let grain = grid.gaussian(seed, 1, [0.7; 3]);
    grid.fill(|i, _| 3.0 * patches[i] + 1.5 * grain[i] - 9.0 * smoothstep(1.2, 2.0, patches[i]))
}

#[cfg(test)]
mod tests;
