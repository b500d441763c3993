//! Receiver: what a scanner shows where nothing echoes.
//!
//! Two things fill the dark of a real frame. Electronic noise of the receiver has the same power at every depth; the
//! time-gain compensation after it lifts it with depth. Acoustic clutter, which is reverberation in the body wall and echoes
//! caught by side lobes, is strongest near the array, is attenuated like any echo, and fades beyond that from one round
//! trip to the next (J. J. Dahl and N. M. Sheth, Ultrasound Med. Biol. 40 (2014) 714; M. A. Lediju et al., Ultrasonic
//! Imaging 30 (2008) 151, measured it in bladders). Neither is in phase with the echo, so powers add:
//! `a' = sqrt(a^2 + n^2 E)`, with `n^2` their power at the depth and `E` of mean 1.
//!
//! `E` is the power of a complex Gaussian signal, whose amplitude is Rayleigh distributed. Each part of the signal is a sum of
//! six bytes of a hash of scanline, sample, frame and seed, smoothed along the scanline with the weights 1, 2, 1 as the
//! receive filter smooths noise: all integers, so that both backends draw the same. The excess kurtosis of a part is
//! -1.2 / 6 from the sum of bytes and halves in the smoothing, to -0.1. Samples of background, where no body is, stay silent.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pass::{Access::*, Band, ParamBlock, Pass, Resource::*, View, groups};
use super::{Effect, OutOfRange, Verdict, within};
use crate::random::{hash3, pcg3d, seed_words};
use crate::real::{Numbers, Real};
use crate::simd::{Kernel, vectorised};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use crate::tracking::probe::BeamGrid;

/// Electronic noise and acoustic clutter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Receiver {
    /// Electronic noise before gain, dB relative to the echo of liver at the array (-200 to 20).
    pub noise_db: f64,
    /// Acoustic clutter at the array, dB relative to the echo of liver there (-200 to 20).
    pub clutter_db: f64,
    /// Fading of the clutter with depth beyond the attenuation of average soft tissue, dB per cm (0 to 50).
    pub clutter_decay_db_cm: f64,
}

impl Default for Receiver {
    fn default() -> Self {
        Self {
            noise_db: -70.0,
            clutter_db: -9.0,
            clutter_decay_db_cm: 2.5,
        }
    }
}

impl Receiver {
    /// Checks the ranges.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        within("receiver.noise_db", self.noise_db, -200.0..=20.0)?;
        within("receiver.clutter_db", self.clutter_db, -200.0..=20.0)?;
        within("receiver.clutter_decay_db_cm", self.clutter_decay_db_cm, 0.0..=50.0)
    }

    /// Mean power of noise and clutter at a depth, relative to the echo of liver at the array. `attenuation_db_cm` is the
    /// two-way attenuation of the clutter.
    pub fn power(&self, depth_mm: f64, attenuation_db_cm: f64) -> f64 {
        let fade_db = (attenuation_db_cm + self.clutter_decay_db_cm) * depth_mm / 10.0;
        10f64.powf(self.noise_db / 10.0) + 10f64.powf((self.clutter_db - fade_db) / 10.0)
    }

    /// Power at each sample depth, per unit of [`draw`].
    pub fn table(&self, grid: &BeamGrid, attenuation_db_cm: f64) -> Numbers {
        let power = |sample: usize| self.power(grid.sample_depth_mm(sample), attenuation_db_cm) / DRAW_MEAN;
        Numbers::new((0..grid.samples()).map(power).collect())
    }
}

/// Registration.
pub const EFFECT: Effect = Effect {
    name: "receiver",
    wanted,
    passes: |_| PASSES,
};

static PASSES: &[Pass] = &[Pass {
    name: "receiver",
    shader: concat!(
        include_str!("../../shaders/common/hash.wgsl"),
        include_str!("../../shaders/receiver.wgsl")
    ),
    entry: "main",
    bindings: &[(Label, Read), (ReceiverPower, Read), (Amplitude, Write)],
    params,
    workgroups: |tables, _| [groups(tables.samples(), 64), tables.lines() as u32, 1],
    flips: false,
    cpu: run::<f32>,
    cpu_f64: run::<f64>,
}];

fn wanted(tables: &Tables) -> Verdict {
    match &tables.settings.effects.receiver {
        Some(own) => Ok(format!(
            "the receiver has noise of {} dB and clutter of {} dB",
            own.noise_db, own.clutter_db
        )),
        None => Err("the scene names no receiver".into()),
    }
}

/// Parameter block of `receiver.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Params {
    /// Seed.
    pub seed: [u32; 2],
    /// Samples along a scanline.
    pub samples: u32,
    /// Number of the frame.
    pub frame: u32,
}

/// Mean of [`draw`]: two parts, each of the variance of six bytes, 6 (256^2 - 1) / 12, times 1 + 4 + 1 for the smoothing.
pub const DRAW_MEAN: f64 = 2.0 * 6.0 * 32_767.5;

/// Mean of the sum of six bytes.
const SUM_MEAN: i32 = 6 * 255 / 2;

/// Keeps these draws apart from those that other effects make with the same seed.
const STREAM: u32 = 0x5ec4_e1be;

fn numbers(view: &View) -> Params {
    let [low, high] = seed_words(view.tables.settings.seed);
    Params {
        seed: [low, high ^ STREAM],
        samples: view.tables.samples() as u32,
        frame: view.state.frame as u32,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    ParamBlock::of(&numbers(view))
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let numbers = numbers(view);
    let power = tables.receiver_power.of::<T>();
    store.amplitude[..tables.lines() * samples]
        .par_chunks_mut(samples)
        .zip(store.label.par_chunks(samples))
        .enumerate()
        .for_each(|(line, (amplitudes, labels))| {
            vectorised(Scanline {
                line: line as i32,
                numbers: &numbers,
                power,
                labels,
                amplitudes,
            });
        });
}

/// Adds noise and clutter to one scanline.
struct Scanline<'a, T> {
    line: i32,
    numbers: &'a Params,
    power: &'a [T],
    labels: &'a [u8],
    amplitudes: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        const BLOCK: usize = 64;
        let rows = self.power.chunks(BLOCK).zip(self.labels.chunks(BLOCK));
        for (block, (amplitudes, (power, labels))) in self.amplitudes.chunks_mut(BLOCK).zip(rows).enumerate() {
            let first = (block * BLOCK) as i32 - 1;
            let mut parts = [[0; BLOCK + 2]; 2];
            for i in 0..amplitudes.len() + 2 {
                let own = white(self.line, first + i as i32, self.numbers);
                (parts[0][i], parts[1][i]) = (own[0], own[1]);
            }
            for i in 0..amplitudes.len() {
                let drawn = smooth_power(parts.map(|part| [part[i], part[i + 1], part[i + 2]]));
                let heard = if labels[i] == 0 { T::zero() } else { power[i] };
                let echo = amplitudes[i];
                amplitudes[i] = (echo * echo + heard * T::from_signed(drawn)).sqrt();
            }
        }
    }
}

/// Both parts of the signal before smoothing, -765 to 765 each.
#[inline(always)]
fn white(line: i32, sample: i32, numbers: &Params) -> [i32; 2] {
    let first = hash3([line, sample, numbers.frame as i32], numbers.seed);
    // The upper halves of both triples: six bytes each.
    let part = |words: [u32; 3]| {
        let sum: u32 = words.iter().map(|&word| (word >> 24) + (word >> 16 & 0xff)).sum();
        sum as i32 - SUM_MEAN
    };
    [part(first), part(pcg3d(first))]
}

/// Power of the signal from three neighbours of each of its parts.
#[inline(always)]
fn smooth_power(parts: [[i32; 3]; 2]) -> i32 {
    let [re, im] = parts.map(|[before, at, after]| before + 2 * at + after);
    re * re + im * im
}

/// Power of the signal drawn for a sample, of mean [`DRAW_MEAN`].
pub fn draw(line: usize, sample: usize, frame: u64, seed: u64) -> i32 {
    let [low, high] = seed_words(seed);
    let numbers = Params {
        seed: [low, high ^ STREAM],
        samples: 0,
        frame: frame as u32,
    };
    let near = [-1, 0, 1].map(|step| white(line as i32, sample as i32 + step, &numbers));
    smooth_power([0, 1].map(|part| near.map(|own| own[part])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_of_noise_and_clutter_add() {
        let own = Receiver {
            noise_db: -40.0,
            clutter_db: -10.0,
            clutter_decay_db_cm: 2.0,
        };
        assert!((own.power(0.0, 3.0) - (1e-4 + 1e-1)).abs() < 1e-12);
        // 30 mm at 2 + 3 dB/cm take 15 dB.
        assert!((own.power(30.0, 3.0) - (1e-4 + 10f64.powf(-2.5))).abs() < 1e-12);
        assert!((own.power(1e3, 3.0) / 1e-4 - 1.0).abs() < 1e-9);
    }
}
