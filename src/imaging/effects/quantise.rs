//! Quantisation: grey levels to bytes, rounded to nearest.

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;

use super::buffers::{IMAGE, PIXELS};
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, Stage,
    Wanted::{self, Yes},
};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::real::Real;

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "quantise",
    stage: Stage::Display,
    wanted,
    passes: |_| PASSES.iter().collect(),
    ..Effect::PLAIN
};

static PASSES: &[Pass] = &[Pass {
    name: "quantise",
    shader: include_str!("../../../shaders/quantise.wgsl"),
    entry: "main",
    bindings: &[(&IMAGE, ReadLine), (&PIXELS, WriteLine)],
    params,
    grid: Grid::Words,
    flips: false,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(_: &Tables) -> Wanted {
    Yes("its bytes".into())
}

block! {
    /// Parameter block of `quantise.wgsl`.
    struct QuantiseParams {
        /// Pixels in a row.
        width: u32,
        /// Number of words of four pixels in a row, padded.
        words_per_row: u32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 2],
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    ParamBlock::of(&QuantiseParams {
        width: view.tables.width() as u32,
        words_per_row: view.tables.words_per_row() as u32,
        unused: [0; 2],
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let width = view.tables.width();
    let half = T::of(0.5);
    for_each(
        (chunks_mut(&mut store.pixels, width), chunks(&store.image, width)),
        &|(bytes, row)| {
            for (byte, &grey) in bytes.iter_mut().zip(row) {
                *byte = (grey + half).max(T::zero()).min(T::of(255.0)).to_u8().unwrap_or(0);
            }
        },
    );
}
