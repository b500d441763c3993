//! Haze: diffuse echoes that reach the array by other paths than the beam.
//!
//! Sound that is scattered more than once, or caught by side lobes, arrives at the time of another depth and from
//! another direction. It fills what is dark beside and below tissue (clutter of multiple paths: J. J. Dahl and N. M.
//! Sheth, Ultrasound Med. Biol. 40 (2014) 714), and fades where nothing around echoes. Its power is a share of the mean
//! power around: laterally weighted by `exp(-|x| / lateral_mm)`, along the beam by `exp(-z / axial_mm)` from what lies
//! `z` above, as longer paths arrive later, less the attenuation of average soft tissue on the way. Its pattern is
//! fully developed speckle in the probe's frame, as wide as clutter. Haze is not in phase with the echo, so powers add:
//! `a' = sqrt(a^2 + level m p)`, with `m` the mean power around and `p` the pattern, of mean 1. Background samples,
//! outside the body, stay silent.
//!
//! What occludes throws sound back and forth between itself and what lies above: where power of the beam is lost to it,
//! a share of the mean power around goes on to fill the dark behind, and falls over `behind_mm`. Sound comes by two
//! reflections. Gas throws all back, so that its shadows are dirty, and so do bubbles in the contents of the bowel; bone
//! takes up what its surface does not reflect, and its shadows are darker. What is thrown back is scattered by tissue: the
//! mean counts up to the power of liver, as the line of a surface, however bright, is the echo of one path. Needles throw
//! nothing back.
//!
//! No theory gives the usual numbers: with them the dark of frames is as grey as that of real ones, the lumens of
//! vessels under a linear probe 17 to 18 of 255 (real frames: 11 to 37), the middle of a full bladder black, shadows of
//! bone dark grey, and lung as grey as the wall under its surface, less by 4.3 dB every 45 mm.
//!
//! ```toml
//! effects.haze = { level_db = -12.0 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use std::ops::Range;

use super::buffers::{AMPLITUDE, Buffer, LABEL, LABEL_ROWS, beam, bytes_of, columns};
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::point_spread::PointSpread;
use super::receiver::clutter;
use super::shadow::Attenuation;
use super::shadow::{MAX_UNITS, exponent_per_unit};
use super::{
    Effect, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::range::parameters;
use insonify_base::real::Real;
use insonify_base::simd::Kernel;
use insonify_tracking::probe::BeamGrid;

parameters! {
    /// Diffuse echoes of other paths than the beam.
    pub struct Haze {
        /// Power relative to the mean around, dB.
        level_db: f64 = -20.0, in -200..=0;
        /// Lateral distance over which what contributes falls to 1/e, mm.
        lateral_mm: f64 = 8.0, in 0.5..=500;
        /// Distance below which what contributes has fallen to 1/e, mm.
        axial_mm: f64 = 6.0, in 0.1..=500;
        /// Power behind a perfect reflector relative to the mean around at its surface, dB.
        behind_db: f64 = -6.0, in -200..=0;
        /// Distance behind bone and gas over which that falls to 1/e, mm.
        behind_mm: f64 = 45.0, in 0.1..=500;
    }
}

impl Parameters for Haze {}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "haze",
    stage: Stage::Beam,
    example: "effects.haze = { level_db = -12.0 }",
    wanted,
    passes: |_| PASSES.iter().collect(),
    buffers: &[&PATTERN, &WEIGHTS, &GAINS],
    remove: Some(|_, settings| settings.effects.haze = None),
    ..Effect::PLAIN
};

/// Largest number of columns of which mean powers are taken; scanlines between them are interpolated.
const COLUMNS: usize = 32;
/// Echoes per cell with which the pattern is fully developed.
const PER_CELL: f64 = 8.0;
/// Separates the pattern from that of clutter with the same seed.
const STREAM: u64 = 0x5a17_e0f1 << 32;

/// Tables of the haze; empty without it.
#[derive(Clone, Debug, Default)]
pub struct Derived {
    /// Power of the pattern at each sample, scanline by scanline, of mean 1.
    pattern: Vec<f32>,
    /// Share of each scanline in the mean of each column.
    weights: Vec<f32>,
    /// Power that average soft tissue has taken by each sample.
    gains: Vec<f32>,
}

/// Largest loss that is compensated, dB: far below the noise of any receiver, in the range of single precision.
const MAX_LOSS_DB: f64 = 250.0;

/// Settings on which the tables depend.
#[derive(PartialEq)]
pub(crate) struct Key<'a> {
    haze: Option<&'a Haze>,
    spread: PointSpread,
    attenuation: Attenuation,
    seed: u64,
    grid: &'a BeamGrid,
}

/// Takes parameters, the point spread, attenuation, seed and grid.
pub(crate) fn key<'a>(tissues: &'a TissueTable, settings: &'a Settings, grid: &'a BeamGrid) -> Key<'a> {
    let speckle = settings.effects.speckle.clone().unwrap_or_default();
    Key {
        haze: settings.effects.haze.as_ref(),
        spread: PointSpread::new(&speckle, &settings.probe, Attenuation::of(tissues, settings)),
        attenuation: Attenuation::average(settings),
        seed: settings.seed,
        grid,
    }
}

/// Draws the pattern, and weighs the scanlines.
pub(crate) fn derive(_: &Anatomy, key: &Key) -> Result<Derived, SynthError> {
    let Some(haze) = key.haze else {
        return Ok(Derived::default());
    };
    let (grid, lines) = (key.grid, key.grid.lines());
    let spacing_mm = grid.lateral_spacing_mm(grid.sample_depth_mm(grid.samples() / 2));
    let columns = columns_of(lines);
    let weights = (0..columns).flat_map(|column| {
        let middle = (column as f64 + 0.5) * lines as f64 / columns as f64 - 0.5;
        let weight = move |line: usize| (-(line as f64 - middle).abs() * spacing_mm / haze.lateral_mm).exp();
        let sum: f64 = (0..lines).map(weight).sum();
        (0..lines).map(move |line| (weight(line) / sum) as f32)
    });
    let loss_db = |sample: usize| key.attenuation.db_at(grid.sample_depth_mm(sample)).min(MAX_LOSS_DB);
    Ok(Derived {
        gains: (0..grid.samples())
            .map(|sample| 10f64.powf(loss_db(sample) / 10.0) as f32)
            .collect(),
        pattern: clutter::table(
            grid,
            &key.spread,
            key.seed ^ STREAM,
            PER_CELL,
            &vec![1.0; grid.samples()],
        ),
        weights: weights.collect(),
    })
}

fn columns_of(lines: usize) -> usize {
    lines.min(COLUMNS)
}

/// Per sample: power of the pattern (`f32`).
static PATTERN: Buffer = Buffer::new(281, "HazePattern", 4, beam).derived(|_, derived| bytes_of(&derived.haze.pattern));
/// Per column and scanline: its share in the mean (`f32`).
static WEIGHTS: Buffer = Buffer::new(282, "HazeWeights", 4, |tables| tables.effects.haze.weights.len())
    .derived(|_, derived| bytes_of(&derived.haze.weights));
/// Per sample of depth: power that average soft tissue has taken (`f32`).
static GAINS: Buffer = Buffer::new(283, "HazeGains", 4, |tables| tables.effects.haze.gains.len())
    .derived(|_, derived| bytes_of(&derived.haze.gains));
/// Per sample: share of the power of the beam that occluding tissue throws back there (`f32`).
static REFLECTORS: Buffer = Buffer::new(280, "HazeReflectors", 4, beam);
/// Per column and sample: mean power around, with what occluding tissue throws back (`f32`).
static MEANS: Buffer = Buffer::new(284, "HazeMeans", 4, means_of_beam);

fn means_of_beam(tables: &Tables) -> usize {
    columns_of(tables.lines()) * tables.samples()
}

columns! {
    /// Vectors of the haze.
    pub struct Columns<T> {
        /// Data of `MEANS`.
        means: [T; means_of_beam] = T::zero(), MEANS;
        /// Data of `REFLECTORS`, where it is not 0.
        reflectors: [T; beam] = T::zero(), REFLECTORS;
        /// Per scanline: samples of which `reflectors` holds data.
        reflecting: [Range<usize>; Tables::lines] = 0..0, REFLECTORS;
        /// Per column and sample: share of the power of the beam that occluding tissue throws back there.
        reflected: [T; means_of_beam] = T::zero(), REFLECTORS;
    }
}

const SHADER: &str = include_str!("../../../shaders/haze.wgsl");

static PASSES: &[Pass] = &[
    Pass {
        name: "haze_reflectors",
        shader: SHADER,
        entry: "reflectors",
        bindings: &[(&LABEL, Read), (&LABEL_ROWS, Read), (&REFLECTORS, WriteLine)],
        params,
        grid: Grid::Scanlines,
        flips: false,
        cpu: reference!(reflectors),
        bound: bound!(Covered("by the bound of `haze`")),
    },
    Pass {
        name: "haze_means",
        shader: SHADER,
        entry: "means_around",
        bindings: &[
            (&AMPLITUDE, Read),
            (&WEIGHTS, Read),
            (&GAINS, Read),
            (&MEANS, Write),
            (&REFLECTORS, Read),
        ],
        params,
        grid: Grid::Workgroups(|tables| [columns_of(tables.lines()) as u32, 1]),
        flips: false,
        cpu: reference!(means),
        bound: bound!(Covered("by the bound of `haze`")),
    },
    Pass {
        name: "haze",
        shader: SHADER,
        entry: "main",
        bindings: &[
            (&LABEL, ReadOwn),
            (&PATTERN, Read),
            (&MEANS, Read),
            (&AMPLITUDE, WriteOwn),
        ],
        params,
        grid: Grid::Samples,
        flips: false,
        cpu: reference!(run),
        bound: bound!(By(bound::carry)),
    },
];

fn wanted(tables: &Tables) -> Wanted {
    match &tables.settings.effects.haze {
        Some(haze) => Yes(format!(
            "other paths than the beam add {} dB of what lies around",
            haze.level_db
        )),
        None => No("the scene names no haze".into()),
    }
}

block! {
    /// Parameter block of `haze.wgsl`.
    struct HazeParams {
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Columns.
        columns: u32,
        /// Power relative to the mean around.
        level: f32,
        /// Decay along the beam per sample, as log2.
        fading: f32,
        /// Share of a sample in the mean around itself.
        share: f32,
        /// Power behind a perfect reflector, relative to `level`.
        behind: f32,
        /// Its decay per sample, as log2.
        behind_fading: f32,
        /// Exponent of 2 of the power left per unit of loss.
        per_unit: f32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 3],
    }
}

/// Numbers of the settings.
struct Numbers {
    level: f64,
    fading: f64,
    behind: f64,
    behind_fading: f64,
}

impl Numbers {
    fn of(tables: &Tables) -> Self {
        let haze = tables.settings.effects.haze.clone().unwrap_or_default();
        let fading = |mm: f64| -tables.sample_mm() / mm * std::f64::consts::LOG2_E;
        Self {
            level: 10f64.powf(haze.level_db / 10.0),
            fading: fading(haze.axial_mm),
            behind: 10f64.powf((haze.behind_db - haze.level_db) / 10.0),
            behind_fading: fading(haze.behind_mm),
        }
    }

    fn share(&self) -> f64 {
        1.0 - self.fading.exp2()
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let numbers = Numbers::of(tables);
    ParamBlock::of(&HazeParams {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        columns: columns_of(tables.lines()) as u32,
        level: numbers.level as f32,
        fading: numbers.fading as f32,
        share: numbers.share() as f32,
        behind: numbers.behind as f32,
        behind_fading: numbers.behind_fading as f32,
        per_unit: exponent_per_unit() as f32,
        unused: [0; 3],
    })
}

fn reflectors<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let rows = tables.label_rows.iter().enumerate();
    let mut occludes = [false; 256];
    rows.for_each(|(label, row)| occludes[label] = row.loss > row.attenuation);
    let columns = &mut store.effects.haze;
    for_each(
        (
            chunks_mut(&mut columns.reflectors, samples),
            chunks_mut(&mut columns.reflecting, 1),
            chunks(&store.label, samples),
        ),
        &|(reflectors, reflecting, labels)| {
            let is_occluding = |label: &u8| occludes[usize::from(*label)];
            let first = labels.iter().position(is_occluding);
            reflecting[0] = first.map_or(0..0, |first| {
                first..1 + labels.iter().rposition(is_occluding).expect("at least the first")
            });
            reflectors_of(
                tables,
                &labels[reflecting[0].clone()],
                &mut reflectors[reflecting[0].clone()],
            );
        },
    );
}

/// Reflectors of a scanline.
fn reflectors_of<T: Real>(tables: &Tables, labels: &[u8], reflectors: &mut [T]) {
    let per_unit = T::of(exponent_per_unit());
    let (mut units, mut left) = (0u32, T::one());
    for (reflector, label) in reflectors.iter_mut().zip(labels) {
        let row = &tables.label_rows[usize::from(*label)];
        let occluded = row.loss - row.attenuation;
        *reflector = T::zero();
        if occluded > 0 {
            units = units.saturating_add(occluded).min(MAX_UNITS);
            let before = left;
            left = (T::of(f64::from(units)) * per_unit).exp2();
            *reflector = thrown_back::<T>(row.impedance) * (before - left);
        }
    }
}

/// Share that an occluding tissue throws back: what a surface of its impedance reflects twice if it is harder than soft
/// tissue, and takes up the rest; otherwise, as bubbles scatter, all.
#[inline(always)]
fn thrown_back<T: Real>(impedance_mrayl: f32) -> T {
    // In single precision on all backends.
    if impedance_mrayl <= SOFT_MRAYL as f32 {
        return T::one();
    }
    let (impedance, soft) = (T::of(f64::from(impedance_mrayl)), T::of(SOFT_MRAYL));
    let step = (impedance - soft) / (impedance + soft);
    let reflected = step * step;
    reflected * reflected
}

/// Impedance of soft tissue, MRayl: that of muscle, above those of others (F. A. Duck, Physical Properties of Tissue,
/// 1990, section 4.5).
const SOFT_MRAYL: f64 = 1.7;

fn means<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let amplitudes = &store.amplitude[..lines * samples];
    let Columns {
        means,
        reflectors,
        reflecting,
        reflected,
    } = &mut store.effects.haze;
    for_each(
        (
            chunks_mut(means, samples),
            chunks_mut(reflected, samples),
            chunks(&tables.effects.haze.weights, lines),
        ),
        &|(means, reflected, weights)| {
            T::vectorised(Column {
                numbers: Numbers::of(tables),
                weights,
                gains: &tables.effects.haze.gains,
                amplitudes,
                reflectors,
                reflecting,
                reflected,
                means,
            });
        },
    );
}

/// Mean power around the samples of a column.
struct Column<'a, T> {
    numbers: Numbers,
    weights: &'a [f32],
    gains: &'a [f32],
    amplitudes: &'a [T],
    reflectors: &'a [T],
    reflecting: &'a [Range<usize>],
    reflected: &'a mut [T],
    means: &'a mut [T],
}

impl<T: Real> Kernel for Column<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.means.fill(T::zero());
        for (amplitudes, weight) in self.amplitudes.chunks(self.means.len()).zip(self.weights) {
            let weight = T::of(f64::from(*weight));
            for (mean, amplitude) in self.means.iter_mut().zip(amplitudes) {
                *mean += weight * (*amplitude * *amplitude);
            }
        }
        let numbers = &self.numbers;
        let (left, share) = (T::of(numbers.fading.exp2()), T::of(numbers.share()));
        let (behind, behind_left) = (T::of(numbers.behind), T::of(numbers.behind_fading.exp2()));
        self.reflected.fill(T::zero());
        let reflectors = self.reflectors.chunks(self.gains.len()).zip(self.reflecting);
        for ((reflectors, reflecting), weight) in reflectors.zip(self.weights) {
            let weight = T::of(f64::from(*weight));
            let reflectors = &reflectors[reflecting.clone()];
            for (reflected, reflector) in self.reflected[reflecting.clone()].iter_mut().zip(reflectors) {
                *reflected += weight * *reflector;
            }
        }
        let (mut above, mut reverberant) = (T::zero(), T::zero());
        for ((mean, reflected), gain) in self.means.iter_mut().zip(&*self.reflected).zip(self.gains) {
            let gain = T::of(f64::from(*gain));
            above = above * left + *mean * share * gain;
            reverberant = reverberant * behind_left + *reflected * above.min(T::one());
            *mean = (above + behind * reverberant) / gain;
        }
    }
}

/// Columns beside a scanline, and the share of the second.
#[inline(always)]
fn beside<T: Real>(line: usize, lines: usize) -> ([usize; 2], T) {
    let columns = columns_of(lines);
    let position = (T::of(line as f64) + T::of(0.5)) * T::of(columns as f64) / T::of(lines as f64) - T::of(0.5);
    let first = position.truncate().clamp(0, columns as i32 - 1);
    let after = (position - T::from_signed(first)).max(T::zero()).min(T::one());
    ([first as usize, (first as usize + 1).min(columns - 1)], after)
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let means = &store.effects.haze.means;
    let level = T::of(Numbers::of(tables).level);
    for_each(
        (
            0..,
            chunks_mut(&mut store.amplitude[..lines * samples], samples),
            chunks(&store.label, samples),
            chunks(&tables.effects.haze.pattern, samples),
        ),
        &|(line, amplitudes, labels, pattern)| {
            let (columns, after) = beside(line, lines);
            T::vectorised(Scanline {
                labels,
                pattern,
                means: columns.map(|column| &means[column * samples..][..samples]),
                shares: [level * (T::one() - after), level * after],
                amplitudes,
            });
        },
    );
}

/// Adds haze to a scanline.
struct Scanline<'a, T> {
    labels: &'a [u8],
    pattern: &'a [f32],
    /// Means of the columns beside it.
    means: [&'a [T]; 2],
    /// Power of the haze by those of the means.
    shares: [T; 2],
    amplitudes: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let means = self.means[0].iter().zip(self.means[1]);
        let samples = self.amplitudes.iter_mut().zip(self.labels).zip(self.pattern).zip(means);
        for (((amplitude, label), pattern), (first, second)) in samples {
            let haze = T::of(f64::from(*pattern)) * (self.shares[0] * *first + self.shares[1] * *second);
            let sum = *amplitude * *amplitude + if *label == 0 { T::zero() } else { haze };
            *amplitude = sum.sqrt();
        }
    }
}
