//! Texture: echo amplitude of a tissue's solid texture (Zhu et al. 2007, section 2.1), by trilinear interpolation.
//!
//! Texture coordinates are the reference position, rotated and scaled for the tissue, so that textures move with the
//! tissue; like all positions in passes they are relative to the local origin ([`crate::synth::LocalOrigin`]). A
//! texture multiplies the tissue's mean echo; its own mean square is 1.
//!
//! ```toml
//! effects.texture = {}
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;

use std::collections::BTreeMap;
use std::sync::Arc;

use super::buffers::{AMPLITUDE, Buffer, LABEL, LABEL_ROWS, POSITION, bytes_of};
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, EffectTables, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::{Tissue, TissueTable, bank};
use insonify_anatomy::volume::VolumeError;
use insonify_anatomy::volume::texture::{Atlas, AtlasEntry, Placement, SolidTexture};
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::range::parameters;
use insonify_base::real::Real;
use insonify_tracking::probe::BeamGrid;

parameters! {
    /// Solid textures.
    pub struct Texture {
        /// Scale of each texture's deviation from its mean; 1 leaves it unchanged.
        strength: f64 = 1.0, in 0..=2;
    }
}

impl Parameters for Texture {}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "texture",
    stage: Stage::Tissue,
    example: "effects.texture = {}",
    wanted,
    passes: |_| PASSES.iter().collect(),
    buffers: &[&TEXTURE_ENTRIES, &TEXTURE_ATLAS],
    label_row: Some(|anatomy, derived, label, row| {
        if derived.texture.is_some() {
            row.texture = entry_of(anatomy, label as u8);
        }
    }),
    remove: Some(|_, settings| settings.effects.texture = None),
    ..Effect::PLAIN
};

/// Solid textures of the tissues.
pub(crate) type Derived = Option<Atlas>;

/// Settings on which the atlas depends.
#[derive(PartialEq)]
pub(crate) struct Key<'a> {
    is_on: bool,
    seed: u64,
    /// Tissues of the labels, and directions of textures that are not those of tissues.
    of_label: (&'a [u8], Option<[f64; 3]>, &'a BTreeMap<u8, [f64; 3]>),
    /// Per tissue: its name, and that, scale and direction of its texture.
    textures: Vec<(&'a str, Option<&'a str>, f64, Option<[f64; 3]>)>,
}

/// Takes the seed of the built-in textures, which is the lower half of the scene's, whether there is the effect, and
/// which tissue has which texture.
pub(crate) fn key<'a>(tissues: &'a TissueTable, settings: &Settings, _: &BeamGrid) -> Key<'a> {
    let placed = |tissue: &'a Tissue| {
        let texture = tissue.texture.as_deref();
        (&*tissue.name, texture, tissue.texture_scale, tissue.texture_direction)
    };
    Key {
        is_on: settings.effects.texture.is_some(),
        seed: settings.seed & u64::from(u32::MAX),
        of_label: (&tissues.of_label, tissues.inwards, &tissues.along),
        textures: tissues.tissues.iter().map(placed).collect(),
    }
}

/// Packs the textures.
pub(crate) fn derive(anatomy: &Anatomy, key: &Key) -> Result<Derived, SynthError> {
    Ok(if key.is_on { atlas(anatomy, key.seed)? } else { None })
}

/// Placement of the solid textures in the atlas.
static TEXTURE_ENTRIES: Buffer = Buffer::new(100, "TextureEntries", size_of::<AtlasEntry>(), |tables| {
    entries(&tables.effects).len()
})
.derived(|_, derived| bytes_of(entries(derived)));

/// Voxels of the solid textures (`f32`).
static TEXTURE_ATLAS: Buffer = Buffer::new(110, "TextureAtlas", 4, |tables| voxels(&tables.effects).len())
    .derived(|_, derived| bytes_of(voxels(derived)));

fn entries(derived: &EffectTables) -> &[AtlasEntry] {
    derived.texture.as_ref().map_or(&[], |atlas| &atlas.entries)
}

fn voxels(derived: &EffectTables) -> &[f32] {
    derived.texture.as_ref().map_or(&[], |atlas| &atlas.data)
}

static PASSES: &[Pass] = &[Pass {
    name: "texture",
    shader: include_str!("../../../shaders/texture.wgsl"),
    entry: "main",
    bindings: &[
        (&POSITION, ReadOwn),
        (&LABEL, ReadOwn),
        (&LABEL_ROWS, Read),
        (&TEXTURE_ENTRIES, Read),
        (&TEXTURE_ATLAS, Read),
        (&AMPLITUDE, WriteOwn),
    ],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(tables: &Tables) -> Wanted {
    match (&tables.settings.effects.texture, &tables.effects.texture) {
        (None, _) => No("the scene names no textures".into()),
        (Some(_), None) => No("no tissue of the volume has a texture".into()),
        (Some(_), Some(atlas)) => Yes(format!(
            "tissues of the volume have {} solid textures",
            atlas.entries.len()
        )),
    }
}

block! {
    /// Parameter block of `texture.wgsl`.
    struct TextureParams {
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Scale of each texture's deviation from its mean.
        strength: f32,
        /// Padding to a multiple of 16 bytes.
        unused: u32,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&TextureParams {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        strength: strength(tables) as f32,
        unused: 0,
    })
}

fn strength(tables: &Tables) -> f64 {
    tables
        .settings
        .effects
        .texture
        .as_ref()
        .map_or(0.0, |texture| texture.strength)
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let Some(atlas) = &tables.effects.texture else { return };
    let samples = tables.samples();
    let strength = T::of(strength(tables));
    let texture: [u32; 256] = std::array::from_fn(|label| tables.label_rows.get(label).map_or(0, |row| row.texture));
    for_each(
        (
            chunks_mut(&mut store.amplitude, samples),
            chunks(&store.position, samples),
            chunks(&store.label, samples),
        ),
        &|(amplitudes, positions, labels)| {
            let mut start = 0;
            for run in labels.chunk_by(|a, b| texture[usize::from(*a)] == texture[usize::from(*b)]) {
                let end = start + run.len();
                let entry = texture[usize::from(run[0])];
                if entry > 0 {
                    atlas.apply(
                        entry as usize - 1,
                        strength,
                        &positions[start..end],
                        &mut amplitudes[start..end],
                    );
                }
                start = end;
            }
        },
    );
}

/// Packs the solid textures named by the tissues of an anatomy's labels, in the order of their first use; `None`
/// without textures. Textures of the anatomy override those of the bank, which are made from the seed.
fn atlas(anatomy: &Anatomy, seed: u64) -> Result<Option<Atlas>, VolumeError> {
    let mut by_name: BTreeMap<&str, Arc<SolidTexture>> = BTreeMap::new();
    let placed = placed(anatomy);
    for (name, _) in &placed {
        if let (false, Some(texture)) = (by_name.contains_key(name), solid(anatomy, name, seed)) {
            by_name.insert(name, texture);
        }
    }
    let pairs: Vec<(&SolidTexture, Placement)> = placed
        .into_iter()
        .filter_map(|(name, placement)| Some((&**by_name.get(name)?, placement)))
        .collect();
    if pairs.is_empty() {
        return Ok(None);
    }
    Atlas::pack(&pairs).map(Some)
}

/// Atlas entry of a label plus one; 0 for none.
pub(crate) fn entry_of(anatomy: &Anatomy, label: u8) -> u32 {
    let wanted = placement(anatomy, label);
    placed(anatomy)
        .iter()
        .position(|placed| Some(placed) == wanted.as_ref())
        .map_or(0, |index| index as u32 + 1)
}

/// Names and placements of the available textures of the volume's labels, each once.
fn placed(anatomy: &Anatomy) -> Vec<(&str, Placement)> {
    let mut all = Vec::new();
    for label in 0..anatomy.volume.labels().len() {
        let one = placement(anatomy, label as u8);
        all.extend(one.filter(|one| !all.contains(one)));
    }
    all
}

/// Name and placement of the texture of a label; `None` without one.
fn placement(anatomy: &Anatomy, label: u8) -> Option<(&str, Placement)> {
    let tissue = anatomy.tissues.tissue(label);
    let name = tissue.texture.as_deref()?;
    let is_known = anatomy.textures.contains_key(name) || bank::names().any(|built_in| built_in == name);
    let placement = Placement {
        rotation: anatomy.tissues.texture_rotation(label),
        scale: tissue.texture_scale,
    };
    is_known.then_some((name, placement))
}

fn solid(anatomy: &Anatomy, name: &str, seed: u64) -> Option<Arc<SolidTexture>> {
    anatomy
        .textures
        .get(name)
        .cloned()
        .or_else(|| bank::make(name, seed).map(Arc::new))
}
