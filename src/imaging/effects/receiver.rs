//! Receiver: noise, clutter and ring-down of a scanner.
//!
//! The array rings down after transmission: a band at its face on every scanline that is in contact. Acoustic clutter,
//! which is reverberation in the body wall and echoes caught by side lobes, is sound: it is fixed in the probe's frame,
//! has the point spread of the probe, is strongest near the array, is attenuated like any echo and in addition decays
//! from one round trip to the next (`clutter`). Electronic noise has the same power at every depth; the subsequent
//! time-gain compensation amplifies it. None of them is in phase with the echo, so powers add:
//! `a' = sqrt(a^2 + c + n^2 E)`, with `c` the power of ring-down and clutter at the sample, `n^2` that of the noise and
//! `E` of mean 1. In bladders clutter was found to dominate by far, and noise to be weak (M. A. Lediju et al.,
//! Ultrasonic Imaging 30 (2008) 151).
//!
//! `E` is the power of a complex Gaussian signal, whose amplitude is Rayleigh distributed. Each part of the signal is a
//! sum of six bytes of a hash of scanline, sample, frame and seed, smoothed along the scanline with the weights 1, 2, 1
//! as the receive filter smooths noise, and over two scanlines, whose beams share elements (lag-1 correlation 0.5; 0.44
//! to 0.60 in recorded lines): all integers, so that both backends draw the same. The excess kurtosis of a part is -1.2
//! / 6 from the sum of bytes and a quarter of that after smoothing, -0.05. Background samples, outside the body, stay
//! silent.
//!
//! ```toml
//! effects.receiver = { clutter_db = 0.0 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
pub(crate) mod clutter;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use super::buffers::{AMPLITUDE, Buffer, LABEL, beam, bytes_of};
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::point_spread::PointSpread;
use super::shadow::Attenuation;
use super::{
    Effect, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::random::{hash3, pcg3d, seed_words};
use insonify_base::range::parameters;
use insonify_base::real::Real;
use insonify_base::simd::{Kernel, array, map};
use insonify_tracking::probe::BeamGrid;

parameters! {
    /// Electronic noise and acoustic clutter.
    pub struct Receiver {
        /// Electronic noise before gain, dB relative to the echo of liver at the array, independent in every frame.
        noise_db: f64 = -90.0, in -200..=20;
        /// Acoustic clutter at the array, dB relative to the echo of liver there; it moves with the probe. Default: -16
        /// where the largest step of impedance between tissues is that of fat on muscle, less where it is smaller, none
        /// in a phantom of one impedance.
        #[serde(skip_serializing_if = "Option::is_none")]
        clutter_db: Option<f64>, in -200..=20;
        /// Decay of the clutter with depth in addition to the attenuation of average soft tissue, dB per cm.
        clutter_decay_db_cm: f64 = 4.0, in 0..=50;
        /// Ring-down of the array at its face, dB relative to the echo of liver there.
        ring_down_db: f64 = 14.0, in -200..=60;
    }
}

/// Clutter at the array of a body whose wall is fat on muscle, dB: that of real frames of abdomens.
pub const CLUTTER_DB: f64 = -16.0;

/// Reflection coefficient of fat on muscle, of 1.38 and 1.70 MRayl (Szabo, Diagnostic Ultrasound Imaging, 2nd ed.,
/// 2014, appendix B).
const FAT_ON_MUSCLE: f64 = 0.104;

/// Depth over which the amplitude of the ring-down falls to 1/e, mm at 1 MHz: a constant number of periods at every
/// frequency. In real frames the band is 2 to 3 mm deep under a 5 MHz abdominal array (at most 10 dB over the tissue
/// below it) and 0.3 mm under a 14 MHz linear one.
const RING_DOWN_MM: f64 = 3.15;

impl Parameters for Receiver {}

impl Receiver {
    /// Power of the noise, relative to the echo of liver at the array.
    pub fn noise_power(&self) -> f64 {
        10f64.powf(self.noise_db / 10.0)
    }

    /// Clutter at the array between tissues with this largest reflection coefficient, dB.
    fn clutter_of_db(&self, reflection: f64) -> f64 {
        let usual = || CLUTTER_DB + 20.0 * (reflection / FAT_ON_MUSCLE).min(1.0).log10();
        self.clutter_db.unwrap_or_else(usual)
    }

    /// Mean power at a depth of clutter of `clutter_db` at the array, relative to the echo of liver there. `lost_db` is
    /// the loss of tissue down to it.
    pub fn clutter_power(&self, clutter_db: f64, depth_mm: f64, lost_db: f64) -> f64 {
        let fade_db = lost_db + self.clutter_decay_db_cm * depth_mm / 10.0;
        10f64.powf((clutter_db - fade_db) / 10.0)
    }

    /// Power of the ring-down at a depth, relative to the echo of liver at the array.
    pub fn ring_down_power(&self, depth_mm: f64, frequency_mhz: f64) -> f64 {
        10f64.powf(self.ring_down_db / 10.0) * (-2.0 * depth_mm * frequency_mhz / RING_DOWN_MM).exp()
    }

    /// Power of clutter and ring-down at each sample, scanline by scanline.
    fn clutter(&self, clutter_db: f64, key: &Key) -> Vec<f32> {
        let grid = key.grid;
        let bands = clutter::bands(grid, key.seed).into_iter().enumerate();
        let power = |(sample, band): (usize, f64)| {
            let depth_mm = grid.sample_depth_mm(sample);
            (band * self.clutter_power(clutter_db, depth_mm, key.attenuation.db_at(depth_mm))) as f32
        };
        let means: Vec<f32> = bands.map(power).collect();
        let mut table = clutter::table(grid, &key.spread, key.seed, clutter::SPARSE, &means);
        let ring_down = |sample: usize| self.ring_down_power(grid.sample_depth_mm(sample), key.frequency_mhz) as f32;
        let ring_down: Vec<f32> = (0..grid.samples()).map(ring_down).collect();
        for scanline in table.chunks_mut(grid.samples()) {
            scanline
                .iter_mut()
                .zip(&ring_down)
                .for_each(|(power, ring_down)| *power += ring_down);
        }
        table
    }
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "receiver",
    stage: Stage::Beam,
    example: "effects.receiver = { clutter_db = 0.0 }",
    wanted,
    passes: |_| PASSES.iter().collect(),
    buffers: &[&CLUTTER],
    // During the computation of the clutter.
    extra_bytes: |settings, samples| {
        if settings.effects.receiver.is_some() {
            20 * samples
        } else {
            0
        }
    },
    remove: Some(|_, settings| settings.effects.receiver = None),
    ..Effect::PLAIN
};

/// Tables of the receiver.
#[derive(Clone, Debug)]
pub struct Derived {
    /// Power of acoustic clutter and ring-down at each sample; empty without a receiver.
    pub clutter: Vec<f32>,
    /// Clutter at the array, dB.
    pub clutter_db: f64,
}

/// Largest reflection coefficient between the tissues of an anatomy, without those that occlude.
fn reflection(anatomy: &Anatomy, tissues: &TissueTable) -> f64 {
    let present = (1..anatomy.volume.labels().len()).filter(|label| anatomy.volume.holds(*label));
    let soft = present
        .map(|label| tissues.tissue(label as u8))
        .filter(|tissue| !tissue.is_occluder());
    let [low, high] = soft.fold([f64::INFINITY, 0.0f64], |[low, high], tissue| {
        [low.min(tissue.impedance_mrayl), high.max(tissue.impedance_mrayl)]
    });
    if high > low { (high - low) / (high + low) } else { 0.0 }
}

/// Settings on which the clutter depends.
#[derive(PartialEq)]
pub(crate) struct Key<'a> {
    receiver: Option<&'a Receiver>,
    tissues: &'a TissueTable,
    spread: PointSpread,
    attenuation: Attenuation,
    frequency_mhz: f64,
    seed: u64,
    grid: &'a BeamGrid,
}

/// Takes parameters, tissues, the point spread, which is stated with the speckle, attenuation, frequency, seed and
/// grid.
pub(crate) fn key<'a>(tissues: &'a TissueTable, settings: &'a Settings, grid: &'a BeamGrid) -> Key<'a> {
    let speckle = settings.effects.speckle.clone().unwrap_or_default();
    Key {
        receiver: settings.effects.receiver.as_ref(),
        tissues,
        spread: PointSpread::new(&speckle, &settings.probe, Attenuation::of(tissues, settings)),
        attenuation: Attenuation::average(settings),
        frequency_mhz: settings.probe.frequency_mhz,
        seed: settings.seed,
        grid,
    }
}

/// Computes the clutter.
pub(crate) fn derive(anatomy: &Anatomy, key: &Key) -> Result<Derived, SynthError> {
    let (clutter, clutter_db) = key.receiver.map_or((Vec::new(), 0.0), |receiver| {
        let clutter_db = receiver.clutter_of_db(reflection(anatomy, key.tissues));
        (receiver.clutter(clutter_db, key), clutter_db)
    });
    Ok(Derived { clutter, clutter_db })
}

/// Per sample: power of acoustic clutter and ring-down (`f32`).
static CLUTTER: Buffer = Buffer::new(280, "Clutter", 4, beam).derived(|_, derived| bytes_of(&derived.receiver.clutter));

static PASSES: &[Pass] = &[Pass {
    name: "receiver",
    shader: include_str!("../../../shaders/receiver.wgsl"),
    entry: "main",
    bindings: &[(&LABEL, ReadOwn), (&CLUTTER, Read), (&AMPLITUDE, WriteOwn)],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(tables: &Tables) -> Wanted {
    match &tables.settings.effects.receiver {
        Some(receiver) => {
            let clutter = match tables.effects.receiver.clutter_db {
                f64::NEG_INFINITY => "no clutter, as all tissues have one impedance,".to_owned(),
                clutter_db => format!("clutter of {clutter_db:.0} dB"),
            };
            Yes(format!(
                "the receiver has noise of {} dB, {clutter} and a ring-down of {} dB",
                receiver.noise_db, receiver.ring_down_db
            ))
        }
        None => No("the scene names no receiver".into()),
    }
}

block! {
    /// Parameter block of `receiver.wgsl`.
    struct ReceiverParams {
        /// Seed.
        seed: [u32; 2],
        /// Samples along a scanline.
        samples: u32,
        /// Frame number.
        frame: u32,
        /// Power of the noise, per unit of [`draw`].
        noise: f32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 3],
    }
}

/// Mean of [`draw`]: two parts, each of the variance of six bytes, 6 (256^2 - 1) / 12, times 1 + 4 + 1 for the
/// smoothing along the scanline, on two scanlines.
pub(crate) const DRAW_MEAN: f64 = 2.0 * 12.0 * 32_767.5;

/// Mean of the sum of six bytes.
const SUM_MEAN: i32 = 6 * 255 / 2;

/// Stream that separates these draws from those of other effects with the same seed.
const STREAM: u32 = 0x5ec4_e1be;

fn numbers(view: &View) -> ReceiverParams {
    let tables = view.tables;
    let [low, high] = seed_words(tables.settings.seed);
    let receiver = &tables.settings.effects.receiver;
    ReceiverParams {
        seed: [low, high ^ STREAM],
        samples: tables.samples() as u32,
        frame: view.state.frame as u32,
        noise: receiver
            .as_ref()
            .map_or(0.0, |receiver| receiver.noise_power() / DRAW_MEAN) as f32,
        unused: [0; 3],
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    ParamBlock::of(&numbers(view))
}

/// Number of scanlines processed together, which share their draws.
const LINES: usize = 8;

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let numbers = numbers(view);
    let receiver = tables.settings.effects.receiver.as_ref();
    let noise = T::of(receiver.map_or(0.0, |receiver| receiver.noise_power() / DRAW_MEAN));
    let chunk = LINES * samples;
    for_each(
        (
            0..,
            chunks_mut(&mut store.amplitude[..tables.lines() * samples], chunk),
            chunks(&store.label, chunk),
            chunks(&tables.effects.receiver.clutter, chunk),
        ),
        &|(block, amplitudes, labels, clutter)| {
            T::vectorised(Scanlines {
                first: (block * LINES) as i32,
                numbers: &numbers,
                noise,
                labels,
                clutter,
                amplitudes,
            });
        },
    );
}

/// Adds noise and clutter to a group of scanlines.
struct Scanlines<'a, T> {
    first: i32,
    numbers: &'a ReceiverParams,
    noise: T,
    labels: &'a [u8],
    clutter: &'a [f32],
    amplitudes: &'a mut [T],
}

/// Number of samples of a scanline processed together.
const BLOCK: usize = 64;

impl<T: Real> Kernel for Scanlines<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let samples = self.numbers.samples as usize;
        for start in (0..samples).step_by(BLOCK) {
            let length = BLOCK.min(samples - start);
            let mut before = smoothed(self.first, start as i32, length, self.numbers);
            for (line, amplitudes) in self.amplitudes.chunks_mut(samples).enumerate() {
                let after = smoothed(self.first + line as i32 + 1, start as i32, length, self.numbers);
                let index = line * samples + start;
                let labels = &self.labels[index..index + length];
                let clutter = &self.clutter[index..index + length];
                let amplitudes = &mut amplitudes[start..start + length];
                for i in 0..length {
                    let drawn = power(map([0, 1], |part: usize| before[part][i] + after[part][i]));
                    let heard = T::of(f64::from(clutter[i])) + self.noise * T::from_signed(drawn);
                    let echo = amplitudes[i];
                    let sum = echo * echo + if labels[i] == 0 { T::zero() } else { heard };
                    amplitudes[i] = sum.sqrt();
                }
                before = after;
            }
        }
    }
}

/// Both parts of the signal at samples of a scanline, smoothed along it.
#[inline(always)]
fn smoothed(line: i32, start: i32, length: usize, numbers: &ReceiverParams) -> [[i32; BLOCK]; 2] {
    let mut parts = [[0; BLOCK + 2]; 2];
    for i in 0..length + 2 {
        [parts[0][i], parts[1][i]] = white(line, start - 1 + i as i32, numbers);
    }
    map(parts, |part| array(|i| part[i] + 2 * part[i + 1] + part[i + 2]))
}

/// Both parts of the signal before smoothing, -765 to 765 each.
#[inline(always)]
fn white(line: i32, sample: i32, numbers: &ReceiverParams) -> [i32; 2] {
    let first = hash3([line, sample, numbers.frame as i32], numbers.seed);
    // The upper halves of both triples: six bytes each.
    let part = |words: [u32; 3]| {
        let [a, b, c] = map(words, |word| (word >> 24) + (word >> 16 & 0xff));
        (a + b + c) as i32 - SUM_MEAN
    };
    [part(first), part(pcg3d(first))]
}

#[inline(always)]
fn power([re, im]: [i32; 2]) -> i32 {
    re * re + im * im
}

/// Power of the noise drawn for a sample, of mean `DRAW_MEAN`.
pub fn draw(line: usize, sample: usize, frame: u64, seed: u64) -> i32 {
    let [low, high] = seed_words(seed);
    let numbers = ReceiverParams {
        seed: [low, high ^ STREAM],
        frame: frame as u32,
        ..bytemuck::Zeroable::zeroed()
    };
    let rows = [0, 1].map(|step| smoothed(line as i32 + step, sample as i32, 1, &numbers));
    power([0, 1].map(|part| rows[0][part][0] + rows[1][part][0]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clutter_fades() {
        let receiver = Receiver {
            noise_db: -40.0,
            clutter_decay_db_cm: 2.0,
            clutter_db: None,
            ring_down_db: 14.0,
        };
        assert!((receiver.noise_power() - 1e-4).abs() < 1e-12);
        assert!((receiver.clutter_power(-10.0, 0.0, 0.0) - 1e-1).abs() < 1e-12);
        // 0.9 mm at 3.5 MHz take 8.7 dB.
        assert!((receiver.ring_down_power(0.9, 3.5) - 10f64.powf(1.4) * (-2.0f64).exp()).abs() < 1e-9);
        // 30 mm at 2 + 3 dB/cm take 15 dB.
        assert!((receiver.clutter_power(-10.0, 30.0, 9.0) - 10f64.powf(-2.5)).abs() < 1e-12);
        // A tenth of the reflection, and none.
        let of = |reflection: f64| receiver.clutter_of_db(reflection);
        assert!((of(0.5) - CLUTTER_DB).abs() < 1e-12 && (of(0.0104) - CLUTTER_DB + 20.0).abs() < 1e-9);
        assert_eq!(receiver.clutter_power(of(0.0), 10.0, 0.0), 0.0);
    }
}
