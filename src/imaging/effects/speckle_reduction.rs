//! Speckle reduction: an edge-keeping smoother of the envelope, as scanners have, oriented by local statistics.
//!
//! Through each sample go four lines of eleven samples, half a length of speckle apart: along the beam, across it, and
//! both diagonals. A line on which the amplitude varies less than fully developed speckle, `c < C`, with `c` its
//! coefficient of variation and `C^2 = 4 / pi - 1` that of the Rayleigh distribution, lies in even tissue: its inner
//! five samples are averaged. One that varies more crosses an edge or a reflector and is left out, as in the filters of
//! J.-S. Lee (IEEE Transactions on Pattern Analysis and Machine Intelligence 2 (1980) 165) and D. T. Kuan et al. (ibid.
//! 7 (1985) 165), but smoothly: its weight is `w = 1 / (1 + (c / C)^16)`. Beside an edge the lines along it remain, and
//! on a bright point none, so that it stays as it is. With `x` the sample and `m` the means of the lines, the smooth
//! value is `y = (x + sum w m) / (1 + sum w)`, and the strength blends `x` and `y`.
//!
//! Edges of 20 dB keep their width within 5 %; edges of 6 dB, which are as faint as speckle itself, do not.
//!
//! ```toml
//! effects.speckle_reduction = { strength = 1.0 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use super::buffers::{AMPLITUDE, AMPLITUDE_NEXT, Buffer, bytes_of};
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::point_spread::{Attenuation, PointSpread};
use super::{
    Effect, Parameters, Scanner, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::range::parameters;
use insonify_base::real::Real;
use insonify_base::simd::{Kernel, array};
use insonify_tracking::probe::{BeamGrid, ProbeKind};

parameters! {
    /// Speckle reduction.
    pub struct SpeckleReduction {
        /// Share of the smooth value in the result. Default: 0.25 with `scanner = "clinical"` and a linear probe, otherwise
        /// 0.75, with which the mean over the standard deviation of grey is 1.8 times that of raw speckle in even
        /// tissue, 1.6 times in liver with its texture.
        strength: Option<f64>, in 0..=1;
        /// Length of the lines on which evenness is judged, lengths of speckle: the shortest with which edges of 20 dB
        /// keep their width.
        window_cells: f64 = 5.0, in 1..=20;
    }
}

/// Strength that makes livers as even as in real frames under curvilinear probes, and muscle and vessels under linear
/// ones.
const STRENGTH: f64 = 0.75;
const LINEAR: f64 = 0.25;

impl Parameters for SpeckleReduction {
    const USUAL: &[Scanner] = &[Scanner::Clinical];

    fn fill(&mut self, scanner: Scanner, kind: ProbeKind) {
        if (scanner, kind) == (Scanner::Clinical, ProbeKind::Linear) {
            self.strength.get_or_insert(LINEAR);
        }
    }
}

impl SpeckleReduction {
    /// Share of the smooth value in the result.
    pub fn strength(&self) -> f64 {
        self.strength.unwrap_or(STRENGTH)
    }
}

/// Samples of a line to each side, and those of them that are averaged.
pub(crate) const TAPS: usize = 5;
pub(crate) const INNER: usize = 2;

/// Samples of a line.
pub(crate) const COUNT: f64 = (2 * TAPS + 1) as f64;

/// Samples of a line that are averaged.
pub(crate) const INNER_COUNT: f64 = (2 * INNER + 1) as f64;

/// Lines through a sample: signs of the offsets across scanlines and along them.
pub(crate) const DIRECTIONS: [[isize; 2]; 4] = [[1, 0], [0, 1], [1, 1], [1, -1]];

/// Inverse of the squared coefficient of variation of fully developed speckle: the amplitude is Rayleigh distributed.
pub(crate) const EVENNESS: f64 = 1.0 / (4.0 / std::f64::consts::PI - 1.0);

/// Least square of a sum of amplitudes by which is divided.
pub(crate) const LEAST: f64 = 1e-30;

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "speckle_reduction",
    stage: Stage::Beam,
    example: "effects.speckle_reduction = { strength = 1.0 }",
    wanted,
    passes: |_| PASSES.iter().collect(),
    buffers: &[&OFFSETS],
    remove: Some(|_, settings| settings.effects.speckle_reduction = None),
    ..Effect::PLAIN
};

/// Distances of the samples of a line from its middle, in scanlines and in samples.
pub(crate) type Offsets = [[u32; TAPS]; 2];

/// Offsets at each sample depth; empty without speckle reduction.
pub(crate) type Derived = Vec<Offsets>;

/// Settings on which the offsets depend: length of the window, point spread and grid.
pub(crate) type Key<'a> = (Option<(f64, PointSpread)>, &'a BeamGrid);

/// Takes the window, the point spread, which is stated with the speckle, and the grid.
pub(crate) fn key<'a>(tissues: &'a TissueTable, settings: &'a Settings, grid: &'a BeamGrid) -> Key<'a> {
    let window = settings.effects.speckle_reduction.as_ref().map(|reduction| {
        let speckle = settings.effects.speckle.clone().unwrap_or_default();
        let attenuation = Attenuation::of(tissues, settings);
        let spread = PointSpread::new(&speckle, &settings.probe, attenuation);
        (reduction.window_cells, spread)
    });
    (window, grid)
}

/// Rounds the offsets to the grid, a scanline and a sample at least.
pub(crate) fn derive(_: &Anatomy, (window, grid): &Key) -> Result<Derived, SynthError> {
    let Some((window_cells, spread)) = window else {
        return Ok(Vec::new());
    };
    let at = |sample: usize| {
        let depth_mm = grid.sample_depth_mm(sample);
        let [_, axial_mm] = spread.axial_lengths(depth_mm);
        let cell = [
            spread.lateral_at(depth_mm) / grid.lateral_spacing_mm(depth_mm).max(1e-6),
            axial_mm / grid.sample_spacing_mm(),
        ];
        let step = cell.map(|cell| (cell * window_cells / (2 * TAPS) as f64).max(1.0));
        // Beyond the last scanline lies nothing.
        let farthest = [grid.lines(), grid.samples()].map(|count| count as f64);
        std::array::from_fn(|axis| {
            std::array::from_fn(|tap| ((tap + 1) as f64 * step[axis]).round().min(farthest[axis]) as u32)
        })
    };
    Ok((0..grid.samples()).map(at).collect())
}

/// Per sample depth: offsets across scanlines and along them (`u32`).
static OFFSETS: Buffer = Buffer::new(285, "SpeckleOffsets", 4, |tables| {
    2 * TAPS * tables.effects.speckle_reduction.len()
})
.derived(|_, derived| bytes_of(&derived.speckle_reduction));

static PASSES: &[Pass] = &[Pass {
    name: "speckle_reduction",
    shader: include_str!("../../../shaders/speckle_reduction.wgsl"),
    entry: "main",
    bindings: &[(&AMPLITUDE, Read), (&OFFSETS, Read), (&AMPLITUDE_NEXT, WriteOwn)],
    params,
    grid: Grid::Samples,
    flips: true,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(tables: &Tables) -> Wanted {
    match &tables.settings.effects.speckle_reduction {
        None => No("the scene names no speckle reduction".into()),
        Some(reduction) if reduction.strength() == 0.0 => No("its strength is 0".into()),
        Some(reduction) => Yes(format!(
            "speckle is smoothed by {} on lines of {} lengths that are even",
            reduction.strength(),
            reduction.window_cells
        )),
    }
}

block! {
    /// Parameter block of `speckle_reduction.wgsl`.
    struct SpeckleReductionParams {
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Share of the smooth value.
        strength: f32,
        /// Padding to a multiple of 16 bytes.
        unused: u32,
    }
}

/// Share of the smooth value in a scene.
pub(crate) fn strength(tables: &Tables) -> f64 {
    let reduction = tables.settings.effects.speckle_reduction.as_ref();
    reduction.map_or(0.0, SpeckleReduction::strength)
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&SpeckleReductionParams {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        strength: strength(tables) as f32,
        unused: 0,
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let input = &store.amplitude[..lines * samples];
    for_each(
        (0.., chunks_mut(&mut store.amplitude_next[..lines * samples], samples)),
        &|(line, output)| {
            T::vectorised(Scanline {
                offsets: &tables.effects.speckle_reduction,
                strength: T::of(strength(tables)),
                input,
                line,
                lines,
                output,
            });
        },
    );
}

/// A smoothed scanline.
struct Scanline<'a, T> {
    offsets: &'a [Offsets],
    strength: T,
    input: &'a [T],
    line: usize,
    lines: usize,
    output: &'a mut [T],
}

/// Number of samples of a scanline processed together: a few vector registers.
const LANES: usize = 16;

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut start = 0;
        // Offsets change at few depths.
        for run in self.offsets.chunk_by(|a, b| a == b) {
            for first in (start..start + run.len()).step_by(LANES) {
                let smooth = self.smooth(first, &run[0]);
                let output = &mut self.output[first..(first + LANES).min(start + run.len())];
                output.copy_from_slice(&smooth[..output.len()]);
            }
            start += run.len();
        }
    }
}

impl<T: Real> Scanline<'_, T> {
    /// Results at the samples from `first` on, with the same offsets.
    #[inline(always)]
    fn smooth(&self, first: usize, offsets: &Offsets) -> [T; LANES] {
        let middle = self.values(first, [0, 0]);
        let mut weighted = middle;
        let mut total = [T::one(); LANES];
        for [across, along] in DIRECTIONS {
            let mut sum = middle;
            let mut squares: [T; LANES] = array(|i| middle[i] * middle[i]);
            let mut inner = sum;
            for tap in 0..TAPS {
                let [lines, samples] = [across * offsets[0][tap] as isize, along * offsets[1][tap] as isize];
                for offset in [[lines, samples], [-lines, -samples]] {
                    let values = self.values(first, offset);
                    for i in 0..LANES {
                        sum[i] += values[i];
                        squares[i] += values[i] * values[i];
                    }
                }
                if tap + 1 == INNER {
                    inner = sum;
                }
            }
            for i in 0..LANES {
                let square = (sum[i] * sum[i]).max(T::of(LEAST));
                let variation = (T::of(COUNT) * squares[i] / square - T::one()) * T::of(EVENNESS);
                let power = variation * variation;
                let power = power * power;
                let weight = T::one() / (T::one() + power * power);
                total[i] += weight;
                weighted[i] += weight * (inner[i] * T::of(1.0 / INNER_COUNT));
            }
        }
        array(|i| middle[i] + self.strength * (weighted[i] / total[i] - middle[i]))
    }

    /// Samples from `first` on, at an offset in scanlines and samples; beyond the first and last of these those repeat.
    #[inline(always)]
    fn values(&self, first: usize, [lines, samples]: [isize; 2]) -> [T; LANES] {
        let line = (self.line as isize + lines).clamp(0, self.lines as isize - 1) as usize;
        let count = self.output.len();
        let scanline = &self.input[line * count..][..count];
        let first = first as isize + samples;
        match scanline.get(first as usize..).and_then(|rest| rest.first_chunk()) {
            Some(values) if first >= 0 => *values,
            _ => array(|i| scanline[(first + i as isize).clamp(0, count as isize - 1) as usize]),
        }
    }
}
