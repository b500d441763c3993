//! Scan conversion: bilinear interpolation from beam space to pixels, the last step as on scanners; pixels outside the
//! sector take the fill level.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;

use super::buffers::{AMPLITUDE, IMAGE, SCAN_MAP};
use super::pass::{Access::*, Band, ParamBlock, Pass, View, groups};
use super::{Effect, Stage, Verdict};
use crate::base::real::Real;
use crate::base::simd::{Kernel, vectorised};
use crate::imaging::synth::store::Store;
use crate::imaging::synth::tables::Tables;

/// Registry entry.
pub const EFFECT: Effect = Effect {
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
    bindings: &[(&AMPLITUDE, Read), (&SCAN_MAP, Read), (&IMAGE, Write)],
    params,
    workgroups: |tables, band| [groups(tables.width(), 64), band.rows, 1],
    flips: false,
    cpu: run::<f32>,
    cpu_f64: run::<f64>,
}];

fn wanted(_: &Tables) -> Verdict {
    Ok("every frame becomes pixels".into())
}

/// Parameter block of `scan_conversion.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Params {
    /// Pixels in a row.
    pub width: u32,
    /// Scanlines.
    pub lines: u32,
    /// Samples along a scanline.
    pub samples: u32,
    /// Grey level outside the sector.
    pub fill: f32,
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&Params {
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
    store
        .image
        .par_chunks_mut(width)
        .zip(tables.scan_map.par_chunks(width))
        .for_each(|(row, map)| {
            vectorised(Row {
                beam,
                lines,
                samples,
                map,
                fill,
                row,
            });
        });
}

/// A row of pixels.
struct Row<'a, T> {
    beam: &'a [T],
    lines: usize,
    samples: usize,
    map: &'a [[f32; 2]],
    fill: T,
    row: &'a mut [T],
}

/// Number of pixels whose places are computed together.
const BLOCK: usize = 64;

impl<T: Real> Kernel for Row<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (pixels, map) in self.row.chunks_mut(BLOCK).zip(self.map.chunks(BLOCK)) {
            let values = bilinear::<T, BLOCK>(self.beam, self.lines, self.samples, map);
            for ((pixel, value), at) in pixels.iter_mut().zip(values).zip(map) {
                *pixel = if at[0] < 0.0 { self.fill } else { value };
            }
        }
    }
}

/// Bilinear values at scanline and sample coordinates; those outside the grid give an arbitrary value.
#[inline(always)]
pub fn bilinear<T: Real, const N: usize>(beam: &[T], lines: usize, samples: usize, map: &[[f32; 2]]) -> [T; N] {
    let mut first = [[0u32; N]; 2];
    let mut next = [[0u32; N]; 2];
    let mut share = [[0.0f32; N]; 2];
    for (axis, (count, pitch)) in [(lines, samples), (samples, 1)].into_iter().enumerate() {
        let last = count as i32 - 1;
        for (i, at) in map.iter().take(N).enumerate() {
            let floor = at[axis].trunc();
            let low = floor.integer().clamp(0, last);
            share[axis][i] = at[axis] - floor;
            first[axis][i] = (low * pitch as i32) as u32;
            next[axis][i] = ((low + 1).min(last) * pitch as i32) as u32;
        }
    }
    let mut corners = [[T::zero(); N]; 4];
    for i in 0..map.len().min(N) {
        for (corner, value) in corners.iter_mut().enumerate() {
            let line = if corner < 2 { first[0][i] } else { next[0][i] };
            let sample = if corner % 2 == 0 { first[1][i] } else { next[1][i] };
            value[i] = beam[(line + sample) as usize];
        }
    }
    let mut values = [T::zero(); N];
    for i in 0..N {
        let (a, b) = (T::of(f64::from(share[0][i])), T::of(f64::from(share[1][i])));
        let near = corners[0][i] + b * (corners[1][i] - corners[0][i]);
        let far = corners[2][i] + b * (corners[3][i] - corners[2][i]);
        values[i] = near + a * (far - near);
    }
    values
}
