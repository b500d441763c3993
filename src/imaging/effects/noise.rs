//! Noise: additive zero-mean Gaussian per pixel and frame, on grey levels after scan conversion (Zhu et al. 2007,
//! section 2.4).
//!
//! A normal deviate is the sum of twelve bytes of a hash of pixel, frame and seed, shifted and scaled: integers until
//! the last step, so that both backends draw the same noise. The sum of twelve uniform numbers deviates from a Gaussian
//! only beyond three standard deviations (excess kurtosis -0.1).
//!
//! ```toml
//! effects.noise = { std_grey = 7.0 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use super::buffers::{IMAGE, SCAN_MAP};
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, Parameters, Scanner, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::random::{hash3, pcg3d, seed_words};
use insonify_base::range::parameters;
use insonify_base::real::Real;
use insonify_base::simd::{Kernel, map};

parameters! {
    /// Additive noise.
    pub struct Noise {
        /// Standard deviation, grey levels.
        std_grey: f64 = 6.0, in 0..=128;
    }
}

impl Parameters for Noise {
    const USUAL: &[Scanner] = &[];
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "noise",
    stage: Stage::Display,
    example: "effects.noise = { std_grey = 7.0 }",
    wanted,
    passes: |_| PASSES.iter().collect(),
    remove: Some(|_, settings| settings.effects.noise = None),
    ..Effect::PLAIN
};

static PASSES: &[Pass] = &[Pass {
    name: "noise",
    shader: include_str!("../../../shaders/noise.wgsl"),
    entry: "main",
    bindings: &[(&SCAN_MAP, Read), (&IMAGE, WriteOwn)],
    params,
    grid: Grid::Pixels,
    flips: false,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(tables: &Tables) -> Wanted {
    match &tables.settings.effects.noise {
        Some(noise) => Yes(format!(
            "grey levels carry noise of standard deviation {}",
            noise.std_grey
        )),
        None => No("the scene names no additive noise".into()),
    }
}

block! {
    /// Parameter block of `noise.wgsl`.
    struct NoiseParams {
        /// Seed.
        seed: [u32; 2],
        /// Pixels in a row.
        width: u32,
        /// First row of the band.
        first_row: u32,
        /// Frame number.
        frame: u32,
        /// Grey levels per unit of the summed bytes.
        scale: f32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 2],
    }
}

/// Standard deviation of the sum of twelve uniform bytes: sqrt(12 (256^2 - 1) / 12).
const SUM_STD: f64 = 255.998_046_867_549_4;

/// Mean of the sum of twelve uniform bytes.
const SUM_MEAN: i32 = 12 * 255 / 2;

fn numbers(view: &View, first_row: u32) -> NoiseParams {
    let tables = view.tables;
    let std = tables
        .settings
        .effects
        .noise
        .as_ref()
        .map_or(0.0, |noise| noise.std_grey);
    NoiseParams {
        seed: seed_words(tables.settings.seed),
        width: tables.width() as u32,
        first_row,
        frame: view.state.frame as u32,
        scale: (std / SUM_STD) as f32,
        unused: [0; 2],
    }
}

fn params(view: &View, band: Band) -> ParamBlock {
    ParamBlock::of(&numbers(view, band.first_row))
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let width = tables.width();
    let numbers = numbers(view, 0);
    for_each(
        (
            0..,
            chunks_mut(&mut store.image, width),
            chunks(&tables.scan_map, width),
        ),
        &|(row, pixels, map)| {
            T::vectorised(Add {
                pixels,
                map,
                row: row as i32,
                numbers: &numbers,
            });
        },
    );
}

/// Adds noise to the pixels of one row that lie in the sector.
struct Add<'a, T> {
    pixels: &'a mut [T],
    map: &'a [[f32; 2]],
    row: i32,
    numbers: &'a NoiseParams,
}

impl<T: Real> Kernel for Add<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let scale = T::of(f64::from(self.numbers.scale));
        for (column, (pixel, beam_position)) in self.pixels.iter_mut().zip(self.map).enumerate() {
            let deviate = deviate(column as i32, self.row, self.numbers.frame, self.numbers.seed);
            let noisy = (*pixel + T::from_signed(deviate) * scale)
                .max(T::zero())
                .min(T::of(255.0));
            *pixel = if beam_position[0] < 0.0 { *pixel } else { noisy };
        }
    }
}

/// Zero-mean sum of twelve bytes, -1530 to 1530.
#[inline(always)]
pub(crate) fn deviate(column: i32, row: i32, frame: u32, seed: [u32; 2]) -> i32 {
    let first = hash3([column, row, frame as i32], seed);
    let second = pcg3d(first);
    // The upper halves of both triples: twelve bytes.
    let pair = |word: u32| (word >> 24) + (word >> 16 & 0xff);
    let ([a, b, c], [d, e, f]) = (map(first, pair), map(second, pair));
    (a + b + c + d + e + f) as i32 - SUM_MEAN
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviates_are_white_and_normal() {
        let (width, height) = (256, 256);
        let draw = |x: i32, y: i32, frame: u32| f64::from(deviate(x, y, frame, [3, 4])) / SUM_STD;
        let n = f64::from(width * height);
        let (mut sum, mut square, mut fourth, mut right, mut below, mut later) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for y in 0..height {
            for x in 0..width {
                let a = draw(x, y, 7);
                sum += a;
                square += a * a;
                fourth += a.powi(4);
                right += a * draw(x + 1, y, 7);
                below += a * draw(x, y + 1, 7);
                later += a * draw(x, y, 8);
            }
        }
        let four_sigma = 4.0 / n.sqrt();
        assert!((sum / n).abs() < four_sigma);
        assert!((square / n - 1.0).abs() < four_sigma * 2f64.sqrt());
        assert!((fourth / n - 2.9).abs() < 0.12, "kurtosis {}", fourth / n);
        for (name, correlation) in [("right", right), ("below", below), ("later", later)] {
            assert!((correlation / n).abs() < four_sigma, "{name}: {}", correlation / n);
        }
    }
}
