//! Geometry and random numbers that several effects share; the shaders' share is in `shaders/common`.

use crate::synth::FrameState;
use crate::synth::tables::Tables;
use insonify_base::random::{pcg_mix, pcg_step, seeded};
use insonify_base::real::Real;

/// The first three rows of an affine matrix.
pub fn rows<T: Real>(matrix: &nalgebra::Matrix4<f64>) -> [[T; 4]; 3] {
    [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| T::of(matrix[(row, column)])))
}

/// Out-of-plane direction in the world.
pub(crate) fn elevation<T: Real>(state: &FrameState) -> [T; 3] {
    [0, 1, 2].map(|axis| T::of(state.probe_to_world[(axis, 2)]))
}

/// Distance between scanlines at the array and its growth per sample, in sample distances.
pub fn spacing(tables: &Tables) -> [f64; 2] {
    let grid = &tables.grid;
    let scanline_samples = |sample: usize| grid.lateral_spacing_mm(grid.sample_depth_mm(sample)) / tables.sample_mm();
    [
        scanline_samples(0),
        (scanline_samples(tables.samples() - 1) - scanline_samples(0)) / (tables.samples() - 1).max(1) as f64,
    ]
}

/// Complex values of unit mean power at positions in lattice units: the eight scatterers around each, linearly
/// weighted, over the root of the sum of the squared weights. Corner by corner, so that the inner loops run in vector
/// registers.
#[inline(always)]
pub fn scatterers<T: Real, const N: usize>(p: &[[T; N]; 3], seed: [u32; 2]) -> ([T; N], [T; N]) {
    let mut side = [[[T::zero(); N]; 2]; 3];
    let mut step = [[[0u32; N]; 2]; 3];
    let mut scale = [T::of(UNIFORM_TO_UNIT * UNIFORM_TO_UNIT); N];
    for axis in 0..3 {
        for i in 0..N {
            let below = p[axis][i].floor();
            let base = below.integer();
            let f = p[axis][i] - below;
            let g = T::one() - f;
            side[axis][0][i] = g;
            side[axis][1][i] = f;
            step[axis][0][i] = pcg_step(seeded(axis, base, seed));
            step[axis][1][i] = pcg_step(seeded(axis, base.wrapping_add(1), seed));
            scale[i] /= f * f + g * g;
        }
    }
    // The first round of the hash depends on one axis only: its six results serve all eight corners.
    let (mut re, mut im) = ([T::zero(); N], [T::zero(); N]);
    for corner in 0..8 {
        let [x, y, z] = [corner & 1, corner >> 1 & 1, corner >> 2];
        for i in 0..N {
            let words = pcg_mix([step[0][x][i], step[1][y][i], step[2][z][i]]);
            let weight = side[0][x][i] * side[1][y][i] * side[2][z][i];
            re[i] += weight * centred(words[0]);
            im[i] += weight * centred(words[1]);
        }
    }
    for i in 0..N {
        let scale = scale[i].sqrt();
        re[i] *= scale;
        im[i] *= scale;
    }
    (re, im)
}

/// Scale of two uniform numbers of width 65,536 to a complex number of unit power: sqrt(12 / 2) / 65,536.
const UNIFORM_TO_UNIT: f64 = 2.449_489_742_783_178 / 65_536.0;

/// Upper half of a word, centred on zero.
#[inline(always)]
fn centred<T: Real>(word: u32) -> T {
    T::from_signed((word >> 16) as i32 - 32_768) + T::of(0.5)
}
