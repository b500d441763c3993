//! Acoustic clutter of a probe: coherent, shaped by the point spread.
//!
//! The density of echoes of [`SPARSE`] is such that the ratio of mean and standard deviation of the envelope is the
//! measured one, 1.40 +- 0.23 (B. Byram and J. Shu, IEEE Trans. Ultrason. Ferroelectr. Freq. Control 63 (2016) 1531).
//! Multiple paths widen them laterally. Layers of the wall appear repeatedly at one depth on all scanlines: bands of 3
//! dB, 1 mm thick.

use std::f64::consts::TAU;

use crate::effects::lateral::{BLOCK, FWHM_PER_SIGMA, LateralKernel, MAX_SIGMA, gaussian};
use crate::effects::point_spread::PointSpread;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::random::{hash3, seed_words};
use insonify_base::simd::{Kernel, array, map, vectorised};
use insonify_tracking::probe::BeamGrid;

/// Lateral length relative to that of the point spread.
const WIDENED: f64 = 1.8;
/// Number of echoes per area of the full widths of the kernels, of clutter of the body wall.
pub(crate) const SPARSE: f64 = 1.0;
/// Standard deviation of the bands, dB, and their thickness, mm.
const BANDS_DB: f64 = 3.0;
const BANDS_MM: f64 = 1.0;
/// Number of values of a drawn word.
const WORDS: f64 = 4_294_967_296.0;
/// Number of phases that echoes can have.
const PHASES: usize = 256;
/// Stream that separates these draws from others with the same seed.
const STREAM: u32 = 0x0c1a_77e2;

/// Power at each sample, scanline by scanline, of a mean by sample, with this number of echoes per cell.
pub(crate) fn table(grid: &BeamGrid, spread: &PointSpread, seed: u64, per_cell: f64, means: &[f32]) -> Vec<f32> {
    let (lines, samples) = (grid.lines(), grid.samples());
    let seed = words(seed);
    let axial = kernel(spread.axial_mm / grid.sample_spacing_mm());
    let across: Vec<Vec<f64>> = (0..samples)
        .map(|sample| {
            let depth = grid.sample_depth_mm(sample);
            kernel(WIDENED * spread.lateral_at(depth) / grid.lateral_spacing_mm(depth).max(1e-6))
        })
        .collect();
    let axial_width = width(&axial);
    let share = |across: &Vec<f64>| (per_cell / (axial_width * width(across))).min(1.0);
    let shares: Vec<f64> = across.iter().map(share).collect();
    let limits: Vec<u32> = shares.iter().map(|share| (share * WORDS).ceil() as u32).collect();
    // The kernel is separable: along each scanline first, where it is the same at all depths, then across, where it
    // widens with depth.
    let norms = norms(&axial, samples);
    let axial: Vec<f32> = axial.into_iter().map(|weight| weight as f32).collect();
    let amplitudes: Vec<f32> = shares.iter().map(|share| share.sqrt().recip() as f32).collect();
    let phases: [[f32; 2]; PHASES] = array(|phase| {
        let (sine, cosine) = (TAU * (phase as f64 / PHASES as f64)).sin_cos();
        [cosine as f32, sine as f32]
    });
    // Of each scanline its real parts, then its imaginary parts, with what reaches beyond its ends.
    let length = samples + axial.len() - 1;
    let mut scanlines = vec![0.0f32; 2 * lines * length];
    for_each((0.., chunks_mut(&mut scanlines, 2 * length)), &|(line, scanline)| {
        let (re, im) = scanline.split_at_mut(length);
        vectorised(Along {
            line,
            seed,
            axial: &axial,
            amplitudes: &amplitudes,
            phases: &phases,
            limits: &limits,
            norms: &norms,
            parts: [re, im],
        });
    });
    let across = LateralKernel::of(&across, 1.0);
    let all = [across.reach, 2 * across.reach + 1];
    let whole = (0..samples)
        .step_by(BLOCK)
        .flat_map(|start| across.squares::<f32>(all, start));
    let whole: Vec<f32> = whole.map(f32::sqrt).collect();
    let mut clutter = vec![0.0; lines * samples];
    for_each((0.., chunks_mut(&mut clutter, samples)), &|(line, clutter)| {
        vectorised(Across {
            kernel: &across,
            scanlines: &scanlines,
            reach: (length - samples) / 2,
            line_and_count: [line, lines],
            means,
            norms: &whole,
            clutter,
        });
    });
    clutter
}

/// Echoes of a scanline, spread along it.
struct Along<'a> {
    line: usize,
    seed: [u32; 2],
    axial: &'a [f32],
    /// Amplitude of an echo at each sample, of mean power 1 with those that have none.
    amplitudes: &'a [f32],
    /// Real and imaginary part by phase.
    phases: &'a [[f32; 2]; PHASES],
    /// Largest word at each sample with which there is an echo.
    limits: &'a [u32],
    norms: &'a [f32],
    /// Real and imaginary parts, 0 before, with the reach of the kernel on either side.
    parts: [&'a mut [f32]; 2],
}

impl Kernel for Along<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let (samples, taps) = (self.norms.len(), self.axial.len());
        let [re, im] = self.parts;
        for start in (0..samples).step_by(BLOCK) {
            // All are drawn at once, in vector registers; few have an echo.
            let words: [[u32; 2]; BLOCK] = array(|i| {
                let [drawn, phase, _] = hash3([self.line as i32, (start + i) as i32, 0], self.seed);
                [drawn, phase]
            });
            let limits = &self.limits[start..samples.min(start + BLOCK)];
            // Sorted out without a branch, of which every tenth would be mispredicted.
            let (mut echoes, mut count) = ([0; BLOCK], 0);
            for (i, ([drawn, _], limit)) in words.iter().zip(limits).enumerate() {
                echoes[count] = i;
                count += usize::from(drawn <= limit);
            }
            for &i in &echoes[..count] {
                let sample = start + i;
                let echo = self.phases[(words[i][1] >> 24) as usize].map(|part| part * self.amplitudes[sample]);
                for (part, echo) in [&mut *re, &mut *im].into_iter().zip(echo) {
                    for (sum, weight) in part[sample..][..taps].iter_mut().zip(self.axial) {
                        *sum += weight * echo;
                    }
                }
            }
        }
        for part in [re, im] {
            for (sum, norm) in part[taps / 2..].iter_mut().zip(self.norms) {
                *sum /= norm;
            }
        }
    }
}

/// Power of a scanline, spread across the others.
struct Across<'a> {
    kernel: &'a LateralKernel,
    /// Real, then imaginary parts of each.
    scanlines: &'a [f32],
    /// Number of their values beyond each end.
    reach: usize,
    /// Index of the scanline, and number of scanlines.
    line_and_count: [usize; 2],
    /// Mean power at each sample.
    means: &'a [f32],
    /// Roots of the sums of squares of the weights at each sample, of a kernel that no edge truncates.
    norms: &'a [f32],
    clutter: &'a mut [f32],
}

impl Kernel for Across<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let samples = self.means.len();
        let parts = |line: usize| {
            let length = samples + 2 * self.reach;
            let part = |part: usize| &self.scanlines[(2 * line + part) * length + self.reach..][..samples];
            [part(0), part(1)]
        };
        let blocks = self.clutter.chunks_mut(BLOCK).zip(self.means.chunks(BLOCK));
        for (block, (clutter, means)) in blocks.enumerate() {
            let start = block * BLOCK;
            let [re, im] = self.kernel.sums(self.line_and_count, start, parts);
            let mut norms: [f32; BLOCK] = array(|i| self.norms[start + i]);
            if self.kernel.is_truncated(self.line_and_count, start) {
                norms = map(self.kernel.squares(self.line_and_count, start), f32::sqrt);
            }
            for i in 0..clutter.len() {
                let (re, im) = (re[i] / norms[i], im[i] / norms[i]);
                clutter[i] = means[i] * (re * re + im * im);
            }
        }
    }
}

/// Gaussian kernel of a width (full, at half maximum of its square's autocorrelation) in samples.
fn kernel(width: f64) -> Vec<f64> {
    let sigma = (width / FWHM_PER_SIGMA).min(MAX_SIGMA);
    gaussian(sigma, (3.0 * sigma).ceil() as usize)
}

/// Full width at half maximum of a kernel that sums to 1, in samples.
fn width(kernel: &[f64]) -> f64 {
    let centre = (kernel.len() / 2) as f64;
    let variance = kernel
        .iter()
        .enumerate()
        .map(|(index, weight)| weight * (index as f64 - centre).powi(2));
    (FWHM_PER_SIGMA * variance.sum::<f64>().sqrt()).max(1.0)
}

/// Divisors with which a convolution of `count` independent values of unit power has unit power, at the ends, too.
fn norms(kernel: &[f64], count: usize) -> Vec<f32> {
    let reach = kernel.len() / 2;
    let norm = |index: usize| {
        let others = index.saturating_sub(reach)..=(index + reach).min(count - 1);
        let power = others.fold(0.0, |power, other| power + kernel[other + reach - index].powi(2));
        power.sqrt() as f32
    };
    (0..count).map(norm).collect()
}

fn words(seed: u64) -> [u32; 2] {
    let [low, high] = seed_words(seed);
    [low, high ^ STREAM]
}

/// Log-normal factor on the power at each sample depth, of mean 1.
pub(super) fn bands(grid: &BeamGrid, seed: u64) -> Vec<f64> {
    let seed = words(seed);
    let kernel = kernel(BANDS_MM / grid.sample_spacing_mm());
    let reach = (kernel.len() / 2) as i32;
    let norm = kernel.iter().map(|weight| weight * weight).sum::<f64>().sqrt();
    // The sum of the 12 halves of six words is normal to within a percent of a standard deviation.
    let normal = |sample: i32| {
        let words = [1, 2].map(|plane| hash3([0, sample, plane], seed)).concat();
        let halves = words.iter().flat_map(|word| [word >> 16, word & 0xffff]);
        halves.map(|half| f64::from(half) / 65_536.0).sum::<f64>() - 6.0
    };
    let sigma = BANDS_DB / 10.0 * std::f64::consts::LN_10;
    (0..grid.samples() as i32)
        .map(|sample| {
            let taps = kernel.iter().zip(sample - reach..);
            let drawn = taps.map(|(weight, sample)| weight * normal(sample)).sum::<f64>() / norm;
            (sigma * drawn - 0.5 * sigma * sigma).exp()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::point_spread::Attenuation;
    use crate::effects::speckle::Speckle;
    use insonify_tracking::probe::{Linear, Probe};

    /// Mean 1, few echoes per cell, with the expected width: 1.8 times the lateral length of the point spread.
    #[test]
    fn clutter_is_sparse_and_as_wide_as_sound() {
        let probe = Probe::new(Linear { width_mm: 120.0 }, 60.0).unwrap();
        let grid = BeamGrid::new(&probe).unwrap();
        let speckle = Speckle {
            axial_mm: Some(0.8),
            lateral_mm: Some(1.5),
            focal_zone_mm: Some(10_000.0),
            ..Speckle::default()
        };
        let spread = PointSpread::new(&speckle, &probe, Attenuation::default());
        let means =
            |grid: &BeamGrid, seed| -> Vec<f32> { bands(grid, seed).into_iter().map(|band| band as f32).collect() };
        let (mut mean, mut snr, mut half) = (0.0, 0.0, 0.0);
        const SEEDS: u64 = 4;
        for seed in 0..SEEDS {
            let power = table(&grid, &spread, seed, SPARSE, &means(&grid, seed));
            mean += power.iter().map(|&power| f64::from(power)).sum::<f64>() / power.len() as f64;
            // At single depths, without the bands.
            for sample in (0..grid.samples()).step_by(8) {
                let row: Vec<f64> = (0..grid.lines())
                    .map(|line| f64::from(power[line * grid.samples() + sample]))
                    .collect();
                let n = row.len() as f64;
                let average = row.iter().sum::<f64>() / n;
                let envelope = row.iter().map(|power| power.sqrt()).sum::<f64>() / n;
                snr += envelope / (average - envelope * envelope).sqrt();
                let at = |lag: usize| {
                    let pairs = row.iter().zip(&row[lag..]);
                    pairs.map(|(a, b)| (a - average) * (b - average)).sum::<f64>() / (n - lag as f64)
                };
                // 1.8 x 1.5 mm at lines 0.47 mm apart: half maximum at 2.9 lines.
                half += (at(3) + 0.1 * (at(2) - at(3))) / at(0);
            }
        }
        let rows = (SEEDS * (grid.samples() as u64).div_ceil(8)) as f64;
        let (mean, snr, half) = (mean / SEEDS as f64, snr / rows, half / rows);
        assert!((mean - 1.0).abs() < 0.1, "{mean}");
        assert!((1.17..1.63).contains(&snr), "{snr}, measured 1.40 +- 0.23");
        assert!((0.4..0.6).contains(&half), "{half}");
    }
}
