//! Bank of solid textures: structure larger than speckle, generated from a name and a seed.
//!
//! Each texture is a field of decibels on a periodic grid, built from smoothed hashed noise (`field`), cells (`cells`)
//! and strands (`strands`). Lattice coordinates wrap before they are hashed, so the period is exact. Speckle is not part
//! of a texture: correlation lengths are about a millimetre and above, except for strands and septa.
//!
//! A new texture requires a row in `RECIPES`.

mod adipose;
mod cells;
mod contents;
mod fibrous;
mod field;
mod organs;
mod strands;

use crate::volume::texture::SolidTexture;
use field::{Grid, Seed};

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
    recipe("liver", [64; 3], [0.7; 3], organs::liver),
    recipe("spleen", [48; 3], [0.7; 3], organs::spleen),
    recipe("kidney_cortex", [56; 3], [0.55; 3], organs::kidney_cortex),
    recipe("kidney_medulla", [40; 3], [0.9; 3], organs::kidney_medulla),
    recipe("renal_sinus", [56; 3], [0.6; 3], adipose::renal_sinus),
    recipe("pancreas", [56; 3], [0.6; 3], organs::pancreas),
    recipe("prostate_peripheral", [56; 3], [0.5; 3], organs::prostate_peripheral),
    recipe("prostate_central", [60; 3], [0.6; 3], organs::prostate_central),
    recipe("lesion", [48; 3], [0.6; 3], organs::lesion),
    recipe("muscle", [64, 128, 128], [1.5, 0.33, 0.33], fibrous::muscle),
    recipe("fascia", [64, 32, 32], [0.25, 1.2, 1.2], fibrous::fascia),
    recipe("skin", [48, 40, 40], [0.2, 0.6, 0.6], fibrous::skin),
    recipe("soft_tissue", [60; 3], [0.6; 3], fibrous::soft_tissue),
    recipe("fat", [96, 80, 80], [0.4, 0.6, 0.6], adipose::fat),
    recipe("blood", [32; 3], [0.8; 3], contents::blood),
    recipe("bile", [24; 3], [1.5; 3], contents::bile),
    recipe("bowel", [60; 3], [0.6; 3], contents::bowel),
    recipe("gas", [32; 3], [1.0; 3], contents::gas),
    recipe("gel", [48; 3], [0.6; 3], contents::gel),
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
    let mut data = (recipe.decibels)(&grid, Seed::new(seed, position as u32));
    field::to_amplitudes(&mut data);
    SolidTexture::new(recipe.size, recipe.spacing_mm.map(f64::from), data).ok()
}

#[cfg(test)]
mod tests;
