//! Geometry: world position of each sample of each scanline, relative to the local origin,
//! which is that of the world unless the volume lies far from it ([`crate::synth::LocalOrigin`]).
//!
//! Rays are computed once in double precision from the probe's shape; a frame only applies the probe's pose.

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;

use glam::Vec4;

use super::buffers::{POSITION, RAYS};
use super::common::rows;
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, Stage,
    Wanted::{self, Yes},
};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::Real;
use insonify_base::simd::map;

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "geometry",
    stage: Stage::Tissue,
    wanted,
    passes: |_| PASSES.iter().collect(),
    ..Effect::PLAIN
};

static PASSES: &[Pass] = &[Pass {
    name: "geometry",
    shader: include_str!("../../../shaders/geometry.wgsl"),
    entry: "main",
    bindings: &[(&RAYS, Read), (&POSITION, WriteOwn)],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(_: &Tables) -> Wanted {
    Yes("the place of its samples".into())
}

block! {
    /// Parameter block of `geometry.wgsl`.
    struct GeometryParams {
        /// First three rows of the probe-to-world transform.
        probe_to_world: [Vec4; 3],
        /// Samples along a scanline.
        samples: u32,
        /// Distance between samples, mm.
        sample_mm: f32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 2],
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&GeometryParams {
        probe_to_world: rows::<f32>(&view.state.probe_to_world).map(Vec4::from),
        samples: tables.samples() as u32,
        sample_mm: tables.sample_mm() as f32,
        unused: [0; 2],
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let matrix = rows::<T>(&view.state.probe_to_world);
    let sample_mm = T::of(tables.sample_mm());
    for_each((0.., chunks_mut(&mut store.position, tables.samples())), &|(
        line,
        positions,
    )| {
        scanline(tables.rays[line].map(T::of), sample_mm, &matrix, positions);
    });
}

/// Positions of the samples of one scanline; the fourth component, the flag, is cleared.
#[inline(always)]
pub fn scanline<T: Real>(ray: [T; 4], sample_mm: T, matrix: &[[T; 4]; 3], positions: &mut [[T; 4]]) {
    let half = T::of(0.5);
    for (i, position) in positions.iter_mut().enumerate() {
        let s = (T::from_signed(i as i32) + half) * sample_mm;
        let (x, y) = (ray[0] + ray[2] * s, ray[1] + ray[3] * s);
        let [px, py, pz] = map(*matrix, |row| row[0] * x + row[1] * y + row[3]);
        *position = [px, py, pz, T::zero()];
    }
}
