//! Random fields on a periodic grid.

use rayon::prelude::*;

use crate::random::{hash3, seed_words, unit};

/// A periodic grid of voxels; the centre of voxel (0, 0, 0) lies at the origin.
pub(super) struct Grid {
    pub size: [usize; 3],
    pub spacing_mm: [f32; 3],
}

/// Seed of one texture; each of its fields uses a separate stream.
#[derive(Clone, Copy)]
pub(super) struct Seed {
    words: [u32; 2],
}

impl Seed {
    pub fn new(seed: u64, texture: u32) -> Self {
        Self {
            words: seed_words(seed),
        }
        .stream(0x8000_0000 | texture)
    }

    /// Hash words of stream `number`.
    fn stream(self, number: u32) -> Self {
        let [a, b, _] = hash3([number as i32, 0x5eed, 0], self.words);
        Self { words: [a, b] }
    }

    /// Hash function from a lattice point to three words in stream `number`.
    pub fn words(self, number: u32) -> impl Fn([i32; 3]) -> [u32; 3] + Sync {
        let words = self.stream(number).words;
        move |point| hash3(point, words)
    }
}

impl Grid {
    pub fn new(size: [usize; 3], spacing_mm: [f32; 3]) -> Self {
        Self { size, spacing_mm }
    }

    pub fn period_mm(&self) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.size[axis] as f32 * self.spacing_mm[axis])
    }

    /// Fills the grid with one value per voxel, from its linear index and its position in mm.
    pub fn fill(&self, value: impl Fn(usize, [f32; 3]) -> f32 + Sync) -> Vec<f32> {
        let mut data = vec![0.0; self.size.iter().product()];
        let (nx, ny) = (self.size[0], self.size[1]);
        data.par_chunks_mut(nx).enumerate().for_each(|(line, row)| {
            let y = (line % ny) as f32 * self.spacing_mm[1];
            let z = (line / ny) as f32 * self.spacing_mm[2];
            for (i, out) in row.iter_mut().enumerate() {
                *out = value(line * nx + i, [i as f32 * self.spacing_mm[0], y, z]);
            }
        });
        data
    }

    /// A stationary Gaussian field with mean 0 and variance 1: white noise smoothed by a Gaussian of standard deviation
    /// `sigma_mm` along each axis. Its autocorrelation is a Gaussian of standard deviation sqrt(2) `sigma_mm`.
    pub fn gaussian(&self, seed: Seed, stream: u32, sigma_mm: [f32; 3]) -> Vec<f32> {
        let words = seed.words(stream);
        let (nx, ny) = (self.size[0], self.size[1]);
        let mut data = self.fill(|at, _| {
            let point = [at % nx, at / nx % ny, at / nx / ny].map(|n| n as i32);
            words(point).iter().map(|&word| unit(word)).sum()
        });
        for (axis, sigma_mm) in sigma_mm.into_iter().enumerate() {
            data = self.smoothed(&data, axis, sigma_mm / self.spacing_mm[axis]);
        }
        standardise(&mut data);
        data
    }

    /// Convolves along `axis` with a Gaussian of `sigma` voxels, periodically.
    fn smoothed(&self, data: &[f32], axis: usize, sigma: f32) -> Vec<f32> {
        /// Number of standard deviations at which the kernel is truncated: the remainder has a thousandth of its
        /// weight.
        const REACH: f32 = 3.3;
        let reach = (REACH * sigma).ceil() as i64;
        let kernel: Vec<f32> = (-reach..=reach)
            .map(|t| (-0.5 * (t as f32 / sigma.max(1e-6)).powi(2)).exp())
            .collect();
        let [nx, ny, nz] = self.size;
        let wrap = |at: usize, step: i64, n: usize| (at as i64 + step).rem_euclid(n as i64) as usize;
        let mut out = vec![0.0f32; data.len()];
        out.par_chunks_mut(nx).enumerate().for_each(|(line, row)| {
            let (j, k) = (line % ny, line / ny);
            for (&weight, step) in kernel.iter().zip(-reach..) {
                match axis {
                    0 => {
                        let source = &data[line * nx..][..nx];
                        let start = wrap(0, step, nx);
                        let (first, last) = row.split_at_mut(nx - start);
                        add_scaled(first, &source[start..], weight);
                        add_scaled(last, &source[..start], weight);
                    }
                    1 => add_scaled(row, &data[(wrap(j, step, ny) + ny * k) * nx..][..nx], weight),
                    _ => add_scaled(row, &data[(j + ny * wrap(k, step, nz)) * nx..][..nx], weight),
                }
            }
        });
        out
    }
}

fn add_scaled(row: &mut [f32], source: &[f32], weight: f32) {
    for (out, &value) in row.iter_mut().zip(source) {
        *out += weight * value;
    }
}

/// Shifts and scales to mean 0 and variance 1; a constant becomes 0. Sums are computed in a fixed order.
fn standardise(data: &mut [f32]) {
    let count = data.len() as f64;
    let mean = data.iter().map(|&x| f64::from(x)).sum::<f64>() / count;
    let variance = data.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>() / count;
    let factor = if variance > 0.0 { 1.0 / variance.sqrt() } else { 0.0 };
    for value in data {
        *value = ((f64::from(*value) - mean) * factor) as f32;
    }
}

/// Converts decibels to amplitudes.
pub(super) fn to_amplitudes(decibels: &mut [f32]) {
    decibels
        .par_iter_mut()
        .for_each(|value| *value = 10f32.powf(*value / 20.0));
}

/// Smooth step: 0 below `low`, 1 above `high`.
pub(super) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A bump of height 1 around 0 with half-width `width` at 1/e.
pub(super) fn bump(x: f32, width: f32) -> f32 {
    (-(x / width).powi(2)).exp()
}
