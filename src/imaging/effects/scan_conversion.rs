//! Scan conversion: bilinear interpolation from beam space to pixels, the last step as on scanners; pixels outside the
//! sector take the fill level.

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use super::buffers::{AMPLITUDE, IMAGE, SCAN_MAP};
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
    name: "scan_conversion",
    stage: Stage::Display,
    wanted,
    passes: |_| PASSES.iter().collect(),
    ..Effect::PLAIN
};

static PASSES: &[Pass] = &[Pass {
    name: "scan_conversion",
    shader: include_str!("../../../shaders/scan_conversion.wgsl"),
    entry: "main",
    bindings: &[(&AMPLITUDE, Read), (&SCAN_MAP, Read), (&IMAGE, WriteOwn)],
    params,
    grid: Grid::Pixels,
    flips: false,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(_: &Tables) -> Wanted {
    Yes("its pixels".into())
}

block! {
    /// Parameter block of `scan_conversion.wgsl`.
    struct ScanConversionParams {
        /// Pixels in a row.
        width: u32,
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Grey level outside the sector.
        fill: f32,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&ScanConversionParams {
        width: tables.width() as u32,
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        fill: f32::from(tables.settings.image.fill),
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples, width) = (tables.lines(), tables.samples(), tables.width());
    let fill = T::of(f64::from(tables.settings.image.fill));
    let beam = &store.amplitude[..lines * samples];
    for_each(
        (chunks_mut(&mut store.image, width), chunks(&tables.scan_map, width)),
        &|(row, map)| {
            for (pixel, &beam_position) in row.iter_mut().zip(map) {
                *pixel = if beam_position[0] < 0.0 {
                    fill
                } else {
                    bilinear(beam, lines, samples, beam_position)
                };
            }
        },
    );
}

/// Bilinear value at a scanline and sample coordinate, both within the grid.
#[inline(always)]
pub(crate) fn bilinear<T: Real>(beam: &[T], lines: usize, samples: usize, [line, sample]: [f32; 2]) -> T {
    let (l0, s0) = (line as usize, sample as usize);
    let (l1, s1) = ((l0 + 1).min(lines - 1), (s0 + 1).min(samples - 1));
    let (a, b) = (T::of(f64::from(line - l0 as f32)), T::of(f64::from(sample - s0 as f32)));
    let near = beam[l0 * samples + s0] + b * (beam[l0 * samples + s1] - beam[l0 * samples + s0]);
    let far = beam[l1 * samples + s0] + b * (beam[l1 * samples + s1] - beam[l1 * samples + s0]);
    near + a * (far - near)
}
