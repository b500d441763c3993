//! Speckle: fully developed, anchored in the tissue.
//!
//! Space is filled with a cubic lattice of scatterers in the tissue's *reference* state, each a complex random number
//! from a hash of its lattice point. A sample interpolates the eight around its reference position, weighted by its echo
//! amplitude; the point spread of the probe then acts in the beam frame as a separable convolution: across the plane
//! (sub-planes of the same sample), along the beam, and across scanlines with a width that follows the focus. The
//! envelope is the modulus. Sums of independent complex numbers make the amplitude Rayleigh distributed (mean over
//! standard deviation 1.91; Wagner et al., IEEE Trans. Sonics Ultrason. 30(3), 1983), and since the lattice lies in the
//! reference state the pattern moves with the tissue. It is the speckle model that paper 1 stands in for by noise.
//!
//! Kernels are scaled so that the mean power of an echo is the square of its amplitude.

use std::sync::LazyLock;

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod elevation;

use elevation::Elevation;

use super::lateral::{FWHM_PER_SIGMA, LateralKernel, MAX_REACH, gaussian};
use super::pass::{Access::*, Band, ParamBlock, Pass, Resource::*, View, groups};
use super::{Effect, OutOfRange, Verdict, within};
use crate::random::{pcg_mix, pcg_step, seed_words, seeded};
use crate::real::{Numbers, Real};
use crate::simd::{Kernel, vectorised};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use crate::tracking::probe::BeamGrid;

/// Fully developed speckle. Lengths are full widths at half maximum of the autocorrelation of the echo intensity: what
/// one measures on a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Speckle {
    /// Along the beam, mm (0.05 to 10).
    pub axial_mm: f64,
    /// Across scanlines at the focus, mm (0.05 to 20).
    pub lateral_mm: f64,
    /// Out of the plane, mm (0.05 to 20). More than 4 times the shortest of the three lengths comes out as 4 times.
    pub elevational_mm: f64,
    /// Depth of the lateral focus, mm (0 to 1000); none is half the imaging depth.
    pub focus_mm: Option<f64>,
    /// Distance from the focus at which the lateral length has grown by sqrt 2, mm (1 to 10000): the Rayleigh length of a
    /// Gaussian beam.
    pub focal_zone_mm: f64,
}

impl Default for Speckle {
    fn default() -> Self {
        Self {
            axial_mm: 0.8,
            lateral_mm: 1.5,
            elevational_mm: 1.8,
            focus_mm: None,
            focal_zone_mm: 50.0,
        }
    }
}

impl Speckle {
    /// Checks the ranges.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        within("speckle.axial_mm", self.axial_mm, 0.05..=10.0)?;
        within("speckle.lateral_mm", self.lateral_mm, 0.05..=20.0)?;
        within("speckle.elevational_mm", self.elevational_mm, 0.05..=20.0)?;
        within("speckle.focus_mm", self.focus_mm.unwrap_or(0.0), 0.0..=1000.0)?;
        within("speckle.focal_zone_mm", self.focal_zone_mm, 1.0..=10_000.0)
    }

    fn lateral_at(&self, depth_mm: f64, imaging_depth_mm: f64) -> f64 {
        let away = (depth_mm - self.focus_mm.unwrap_or(imaging_depth_mm / 2.0)) / self.focal_zone_mm;
        self.lateral_mm * (1.0 + away * away).sqrt()
    }
}

/// What the speckle of a probe at one setting needs.
#[derive(Clone, Debug, PartialEq)]
pub struct SpeckleTables {
    /// Distance between lattice points, mm.
    pub lattice_mm: f64,
    /// Fine scanlines to each scanline.
    pub oversampling: usize,
    /// Distance between sub-planes, mm.
    pub plane_mm: f64,
    /// Weights of the sub-planes, from the most negative elevation to the most positive.
    pub planes: Vec<f64>,
    /// Weights along the beam.
    pub axial: Numbers,
    /// Per sample: factor that makes up for what the axial kernel finds nothing to weigh, near the ends of a scanline.
    pub ends: Numbers,
    /// Weights across fine scanlines.
    pub lateral: LateralKernel,
}

/// Lattice points per shortest standard deviation of the point spread: at 1.5 the linear interpolation between points
/// takes 3/8 of the spread's variance (h^2 / 6), which the kernels then leave out.
const LATTICE_PER_SIGMA: f64 = 1.5;

/// Most sub-planes that the uniform block holds.
const MAX_PLANES: usize = 8;

/// Most fine scanlines to a scanline.
const MAX_OVERSAMPLING: usize = 4;

/// Widest axial kernel to each side, in samples.
const MAX_AXIAL_REACH: usize = 64;

/// Scanlines further apart than this many lattice distances are refined.
const COARSEST: f64 = 1.4;

impl SpeckleTables {
    /// Computes lattice, kernels and scales for a probe.
    pub fn new(speckle: &Speckle, grid: &BeamGrid) -> Self {
        let shortest = speckle.axial_mm.min(speckle.lateral_mm).min(speckle.elevational_mm) / FWHM_PER_SIGMA;
        let lattice_mm = LATTICE_PER_SIGMA * shortest;
        let correlation = |mm: f64| lattice_correlation(mm / lattice_mm);
        // What is left for a kernel once the interpolation of the lattice has had its share of the variance.
        let left = |length_mm: f64| {
            let sigma = length_mm / FWHM_PER_SIGMA;
            (sigma * sigma - lattice_mm * lattice_mm / 6.0).max(0.0).sqrt()
        };

        let elevation = Elevation::of_width(speckle.elevational_mm / lattice_mm);
        let plane_mm = elevation.apart * lattice_mm;
        let planes = unit_power(elevation.weights, |steps| correlation(steps * plane_mm));

        let sample_mm = grid.sample_spacing_mm();
        let axial_sigma = left(speckle.axial_mm) / sample_mm;
        let axial_reach = ((3.0 * axial_sigma).ceil() as usize).min(MAX_AXIAL_REACH);
        let along = |steps: f64| correlation(steps * sample_mm);
        let axial = unit_power(gaussian(axial_sigma, axial_reach), along);
        let ends = ends(&axial, grid.samples(), along);

        let widest = grid
            .lateral_spacing_mm(grid.depth_mm())
            .max(grid.lateral_spacing_mm(0.0));
        let oversampling = if grid.lines() == 1 {
            1
        } else {
            ((widest / (COARSEST * lattice_mm)).ceil() as usize).clamp(1, MAX_OVERSAMPLING)
        };
        let fine_mm =
            |sample: usize| (grid.lateral_spacing_mm(grid.sample_depth_mm(sample)) / oversampling as f64).max(1e-6);
        let sigma = |sample: usize| {
            let asked = left(speckle.lateral_at(grid.sample_depth_mm(sample), grid.depth_mm()));
            // A kernel cut short at its widest reach keeps a Gaussian's shape if its width stays below a third of it.
            (asked / fine_mm(sample)).min(MAX_REACH as f64 / 3.0)
        };
        let scale =
            |sample: usize, weights: &[f64]| 1.0 / power(weights, |steps| correlation(steps * fine_mm(sample))).sqrt();
        let lateral = LateralKernel::gaussian(grid.samples(), sigma, scale);
        Self {
            lattice_mm,
            oversampling,
            plane_mm,
            planes,
            axial: Numbers::new(axial),
            ends: Numbers::new(ends),
            lateral,
        }
    }

    /// Fine scanlines.
    pub fn fine_lines(&self, lines: usize) -> usize {
        (lines - 1) * self.oversampling + 1
    }

    fn axial_reach(&self) -> usize {
        self.axial.of::<f64>().len() / 2
    }
}

/// Correlation of the interpolated lattice at a distance in lattice steps along one of its axes, over all places in it.
///
/// With weights `1 - f` and `f` scaled to unit power everywhere it is a little wider than the cubic B-spline that the
/// unscaled ones would give. Tabulated, with an error below 1e-4.
pub fn lattice_correlation(steps: f64) -> f64 {
    const PER_STEP: usize = 128;
    static TABLE: LazyLock<Vec<f64>> = LazyLock::new(|| {
        (0..=2 * PER_STEP)
            .map(|at| averaged_correlation(at as f64 / PER_STEP as f64))
            .chain([0.0])
            .collect()
    });
    let at = steps.abs() * PER_STEP as f64;
    let (before, share) = (at as usize, at.fract());
    match TABLE.get(before..before + 2) {
        Some(values) => values[0] + share * (values[1] - values[0]),
        None => 0.0,
    }
}

fn averaged_correlation(steps: f64) -> f64 {
    const PLACES: usize = 512;
    // The two lattice points around a place, and their weights.
    let weights = |place: f64| {
        let share = place.fract();
        let norm = share.hypot(1.0 - share);
        (place.floor(), [(1.0 - share) / norm, share / norm])
    };
    let at = |place: usize| {
        let place = (place as f64 + 0.5) / PLACES as f64;
        let ((first, a), (other, b)) = (weights(place), weights(place + steps));
        match (other - first) as usize {
            0 => a[0] * b[0] + a[1] * b[1],
            1 => a[1] * b[0],
            _ => 0.0,
        }
    };
    (0..PLACES).map(at).sum::<f64>() / PLACES as f64
}

/// Mean power of a weighted sum of values of unit power with a given correlation.
fn power(weights: &[f64], correlation: impl Fn(f64) -> f64) -> f64 {
    let by_distance: Vec<f64> = (0..weights.len()).map(|steps| correlation(steps as f64)).collect();
    let row = |i: usize| -> f64 {
        weights
            .iter()
            .enumerate()
            .map(|(j, w)| w * by_distance[i.abs_diff(j)])
            .sum()
    };
    weights.iter().enumerate().map(|(i, w)| w * row(i)).sum()
}

/// What keeps the mean power of a kernel of unit power at each of `samples` along a scanline, where nothing lies beyond
/// either end.
fn ends(weights: &[f64], samples: usize, correlation: impl Fn(f64) -> f64) -> Vec<f64> {
    let reach = weights.len() / 2;
    let factor = |sample: usize| {
        let first = reach.saturating_sub(sample);
        let last = (samples - sample + reach).min(weights.len());
        if last - first == weights.len() {
            return 1.0;
        }
        1.0 / power(&weights[first..last], &correlation).sqrt()
    };
    (0..samples).map(factor).collect()
}

fn unit_power(weights: Vec<f64>, correlation: impl Fn(f64) -> f64) -> Vec<f64> {
    let scale = 1.0 / power(&weights, correlation).sqrt();
    weights.into_iter().map(|weight| weight * scale).collect()
}

/// Registration.
pub const EFFECT: Effect = Effect {
    name: "speckle",
    wanted,
    passes: |_| PASSES,
};

const SHADER: &str = concat!(
    include_str!("../../shaders/common/hash.wgsl"),
    include_str!("../../shaders/speckle.wgsl")
);

static PASSES: &[Pass] = &[
    Pass {
        name: "speckle_scatter",
        shader: SHADER,
        entry: "scatter_pass",
        bindings: &[(Position, Read), (Amplitude, Read), (Scatter, Write)],
        params,
        workgroups: |tables, _| [groups(tables.samples(), 64), fine_lines(tables) as u32, 1],
        flips: false,
        cpu: scatter::<f32>,
        cpu_f64: scatter::<f64>,
    },
    Pass {
        name: "speckle_axial",
        shader: SHADER,
        entry: "axial_pass",
        bindings: &[(Scatter, Read), (AxialKernel, Read), (ScatterAxial, Write)],
        params,
        workgroups: |tables, _| [groups(tables.samples(), 64), fine_lines(tables) as u32, 1],
        flips: false,
        cpu: axial::<f32>,
        cpu_f64: axial::<f64>,
    },
    Pass {
        name: "speckle_lateral",
        shader: SHADER,
        entry: "lateral_pass",
        bindings: &[(ScatterAxial, Read), (LateralKernel, Read), (Amplitude, Write)],
        params,
        workgroups: |tables, _| [groups(tables.samples(), 64), tables.lines() as u32, 1],
        flips: false,
        cpu: lateral::<f32>,
        cpu_f64: lateral::<f64>,
    },
];

fn fine_lines(tables: &Tables) -> usize {
    tables
        .speckle
        .as_ref()
        .map_or(1, |speckle| speckle.fine_lines(tables.lines()))
}

fn wanted(tables: &Tables) -> Verdict {
    match (&tables.settings.effects.speckle, &tables.speckle) {
        (Some(own), Some(derived)) => Ok(format!(
            "speckle of {} by {} by {} mm: lattice {:.2} mm, {} sub-planes, {} fine scanlines to one",
            own.axial_mm,
            own.lateral_mm,
            own.elevational_mm,
            derived.lattice_mm,
            derived.planes.len(),
            derived.oversampling
        )),
        _ => Err("the scene names no speckle".into()),
    }
}

/// Uniform block of `speckle.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Params {
    /// Out-of-plane direction in the world; the fourth component is unused.
    pub elevation: [f32; 4],
    /// Weights of the sub-planes.
    pub planes: [[f32; 4]; 2],
    /// Seed.
    pub seed: [u32; 2],
    /// Scanlines.
    pub lines: u32,
    /// Samples along a scanline.
    pub samples: u32,
    /// Fine scanlines to each scanline.
    pub oversampling: u32,
    /// Sub-planes.
    pub plane_count: u32,
    /// Distance between sub-planes, mm.
    pub plane_mm: f32,
    /// Lattice points per mm.
    pub per_mm: f32,
    /// Samples on each side of the axial kernel.
    pub axial_reach: u32,
    /// Fine scanlines on each side of the lateral kernel.
    pub lateral_reach: u32,
    /// Padding to a multiple of 16 bytes.
    pub unused: [u32; 2],
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let Some(own) = &tables.speckle else {
        return ParamBlock::of(&Params::zeroed());
    };
    let elevation = view.state.probe_to_world.fixed_view::<3, 1>(0, 2);
    let plane = |i: usize| own.planes.get(i).map_or(0.0, |&weight| weight as f32);
    ParamBlock::of(&Params {
        elevation: [elevation[0] as f32, elevation[1] as f32, elevation[2] as f32, 0.0],
        planes: [0, 4].map(|at| [plane(at), plane(at + 1), plane(at + 2), plane(at + 3)]),
        seed: seed_words(tables.settings.seed),
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        oversampling: own.oversampling as u32,
        plane_count: own.planes.len() as u32,
        plane_mm: own.plane_mm as f32,
        per_mm: (1.0 / own.lattice_mm) as f32,
        axial_reach: own.axial_reach() as u32,
        lateral_reach: own.lateral.reach as u32,
        unused: [0; 2],
    })
}

/// Samples worked on together, so that the inner loops run in vector registers.
const BLOCK: usize = 64;

fn scatter<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let Some(own) = &tables.speckle else { return };
    let (lines, samples) = (tables.lines(), tables.samples());
    let elevation = view.state.probe_to_world.fixed_view::<3, 1>(0, 2);
    let lattice = Lattice {
        seed: seed_words(tables.settings.seed),
        per_mm: T::of(1.0 / own.lattice_mm),
        step: [0, 1, 2].map(|axis| T::of(elevation[axis]) * T::of(own.plane_mm)),
        planes: std::array::from_fn(|plane| T::of(own.planes.get(plane).copied().unwrap_or(0.0))),
        count: own.planes.len(),
    };
    let positions = &store.position[..lines * samples];
    let amplitudes = &store.amplitude[..lines * samples];
    // A fine scanline holds its real parts, then its imaginary parts.
    store
        .scatter
        .par_chunks_mut(2 * samples)
        .enumerate()
        .for_each(|(fine, echoes)| {
            let line = fine / own.oversampling;
            let part = T::of((fine % own.oversampling) as f64 / own.oversampling as f64);
            let next = (line + 1).min(lines - 1);
            let nearest = (line
                + usize::from(2 * (fine % own.oversampling) >= own.oversampling && fine % own.oversampling > 0))
            .min(lines - 1);
            let (a, b) = (
                &positions[line * samples..][..samples],
                &positions[next * samples..][..samples],
            );
            let amplitudes = &amplitudes[nearest * samples..][..samples];
            vectorised(FineScanline {
                lattice: &lattice,
                between: [a, b],
                part,
                amplitudes,
                echoes,
            });
        });
}

/// Echoes of one fine scanline, which lies a share of the way from one scanline to the next: its real parts, then its
/// imaginary parts.
struct FineScanline<'a, T> {
    lattice: &'a Lattice<T>,
    between: [&'a [[T; 4]]; 2],
    part: T,
    amplitudes: &'a [T],
    echoes: &'a mut [T],
}

impl<T: Real> Kernel for FineScanline<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            lattice,
            between: [a, b],
            part,
            amplitudes,
            echoes,
        } = self;
        let samples = amplitudes.len();
        let (re, im) = echoes.split_at_mut(samples);
        for start in (0..samples).step_by(BLOCK) {
            let end = (start + BLOCK).min(samples);
            let mut at = [[T::zero(); BLOCK]; 3];
            for axis in 0..3 {
                for i in start..end {
                    at[axis][i - start] = a[i][axis] + part * (b[i][axis] - a[i][axis]);
                }
            }
            lattice.block(&at, &amplitudes[start..end], &mut re[start..end], &mut im[start..end]);
        }
    }
}

/// The scatterers, seen across the plane.
pub struct Lattice<T> {
    /// Seed.
    pub seed: [u32; 2],
    /// Lattice points per mm.
    pub per_mm: T,
    /// From one sub-plane to the next, mm.
    pub step: [T; 3],
    /// Weights of the sub-planes.
    pub planes: [T; MAX_PLANES],
    /// Sub-planes.
    pub count: usize,
}

impl<T: Real> Lattice<T> {
    /// Complex echoes at up to [`BLOCK`] positions.
    #[inline(always)]
    fn block(&self, at: &[[T; BLOCK]; 3], amplitudes: &[T], re: &mut [T], im: &mut [T]) {
        let (mut sum_re, mut sum_im) = ([T::zero(); BLOCK], [T::zero(); BLOCK]);
        let middle = T::of((self.count - 1) as f64 / 2.0);
        for plane in 0..self.count {
            let offset = self.step.map(|step| step * (T::of(plane as f64) - middle));
            let mut p = [[T::zero(); BLOCK]; 3];
            for axis in 0..3 {
                for i in 0..BLOCK {
                    p[axis][i] = (at[axis][i] + offset[axis]) * self.per_mm;
                }
            }
            let (a, b) = scatterers(&p, self.seed);
            for i in 0..BLOCK {
                sum_re[i] += self.planes[plane] * a[i];
                sum_im[i] += self.planes[plane] * b[i];
            }
        }
        for i in 0..amplitudes.len() {
            re[i] = amplitudes[i] * sum_re[i];
            im[i] = amplitudes[i] * sum_im[i];
        }
    }
}

/// Complex values of unit mean power at positions in lattice units: the eight scatterers around each, linearly weighted, over
/// the root of the sum of the squared weights. Corner by corner, so that the inner loops run in vector registers.
#[inline(always)]
fn scatterers<T: Real>(p: &[[T; BLOCK]; 3], seed: [u32; 2]) -> ([T; BLOCK], [T; BLOCK]) {
    let mut side = [[[T::zero(); BLOCK]; 2]; 3];
    let mut step = [[[0u32; BLOCK]; 2]; 3];
    let mut scale = [T::of(UNIFORM_TO_UNIT * UNIFORM_TO_UNIT); BLOCK];
    for axis in 0..3 {
        for i in 0..BLOCK {
            let base = floor(p[axis][i]);
            let f = p[axis][i] - T::from_signed(base);
            let g = T::one() - f;
            side[axis][0][i] = g;
            side[axis][1][i] = f;
            step[axis][0][i] = pcg_step(seeded(axis, base, seed));
            step[axis][1][i] = pcg_step(seeded(axis, base.wrapping_add(1), seed));
            scale[i] /= f * f + g * g;
        }
    }
    let (mut re, mut im) = ([T::zero(); BLOCK], [T::zero(); BLOCK]);
    for corner in 0..8 {
        let [x, y, z] = [corner & 1, corner >> 1 & 1, corner >> 2];
        for i in 0..BLOCK {
            let words = pcg_mix([step[0][x][i], step[1][y][i], step[2][z][i]]);
            let weight = side[0][x][i] * side[1][y][i] * side[2][z][i];
            re[i] += weight * centred(words[0]);
            im[i] += weight * centred(words[1]);
        }
    }
    for i in 0..BLOCK {
        let scale = scale[i].sqrt();
        re[i] *= scale;
        im[i] *= scale;
    }
    (re, im)
}

/// Two uniform numbers of width 65,536 as the parts of a complex number of unit power: sqrt(12 / 2) / 65,536.
const UNIFORM_TO_UNIT: f64 = 2.449_489_742_783_178 / 65_536.0;

/// Upper half of a word, centred on zero.
#[inline(always)]
fn centred<T: Real>(word: u32) -> T {
    T::from_signed((word >> 16) as i32 - 32_768) + T::of(0.5)
}

/// Largest integer not above `x`, for |x| below 2^31.
#[inline(always)]
fn floor<T: Real>(x: T) -> i32 {
    let cut = x.truncate();
    cut.wrapping_sub(i32::from(x < T::from_signed(cut)))
}

fn axial<T: Real>(view: &View, store: &mut Store<T>) {
    let Some(own) = &view.tables.speckle else { return };
    let samples = view.tables.samples();
    let (weights, ends) = (own.axial.of::<T>(), own.ends.of::<T>());
    let input = &store.scatter;
    store
        .scatter_axial
        .par_chunks_mut(samples)
        .enumerate()
        .for_each(|(part, output)| {
            vectorised(Along {
                input: &input[part * samples..][..samples],
                weights,
                ends,
                output,
            });
        });
}

/// Convolution along a scanline; nothing lies beyond its ends, and what is left there is raised to keep its power.
struct Along<'a, T> {
    input: &'a [T],
    weights: &'a [T],
    ends: &'a [T],
    output: &'a mut [T],
}

impl<T: Real> Kernel for Along<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            input,
            weights,
            ends,
            output,
        } = self;
        let samples = input.len();
        let reach = weights.len() / 2;
        output.fill(T::zero());
        for (tap, &weight) in weights.iter().enumerate() {
            // output[i] += weight * input[i + tap - reach]
            let (from, to) = (
                reach.saturating_sub(tap),
                (samples + reach).saturating_sub(tap).min(samples),
            );
            if from >= to {
                continue;
            }
            let source = &input[from + tap - reach..to + tap - reach];
            for (out, &value) in output[from..to].iter_mut().zip(source) {
                *out += weight * value;
            }
        }
        for (out, &factor) in output.iter_mut().zip(ends) {
            *out *= factor;
        }
    }
}

fn lateral<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let Some(own) = &tables.speckle else { return };
    let (lines, samples) = (tables.lines(), tables.samples());
    let fine_lines = own.fine_lines(lines);
    let weights = own.lateral.weights.of::<T>();
    let input = &store.scatter_axial;
    store.amplitude[..lines * samples]
        .par_chunks_mut(samples)
        .enumerate()
        .for_each(|(line, output)| {
            let centre = line * own.oversampling;
            vectorised(Envelope {
                input,
                centre,
                fine_lines,
                reach: own.lateral.reach,
                weights,
                output,
            });
        });
}

/// Modulus of the lateral convolution at one fine scanline. Where the kernel reaches past the array, what is left of it
/// keeps the power of the whole.
struct Envelope<'a, T> {
    input: &'a [T],
    centre: usize,
    fine_lines: usize,
    reach: usize,
    weights: &'a [T],
    output: &'a mut [T],
}

impl<T: Real> Kernel for Envelope<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            input,
            centre,
            fine_lines,
            reach,
            weights,
            output,
        } = self;
        let samples = output.len();
        let first = centre.saturating_sub(reach);
        let last = (centre + reach).min(fine_lines - 1);
        let whole = last - first == 2 * reach;
        for start in (0..samples).step_by(BLOCK) {
            let end = (start + BLOCK).min(samples);
            let (mut re, mut im) = ([T::zero(); BLOCK], [T::zero(); BLOCK]);
            for fine in first..=last {
                let weights = &weights[(fine + reach - centre) * samples..][start..end];
                let real = &input[2 * fine * samples..][start..end];
                let imaginary = &input[(2 * fine + 1) * samples..][start..end];
                for i in 0..end - start {
                    re[i] += weights[i] * real[i];
                    im[i] += weights[i] * imaginary[i];
                }
            }
            for i in 0..end - start {
                output[start + i] = (re[i] * re[i] + im[i] * im[i]).sqrt();
            }
            if !whole {
                for i in start..end {
                    let power = |taps: std::ops::RangeInclusive<usize>| {
                        let mut sum = T::zero();
                        for tap in taps {
                            sum += weights[tap * samples + i] * weights[tap * samples + i];
                        }
                        sum
                    };
                    output[i] *= (power(0..=2 * reach) / power(first + reach - centre..=last + reach - centre)).sqrt();
                }
            }
        }
    }
}
