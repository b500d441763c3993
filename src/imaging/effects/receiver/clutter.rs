//! Acoustic clutter of a probe: sparse, coherent, shaped by the point spread.
//!
//! The density of echoes is such that the ratio of mean and standard deviation of the envelope is the measured one,
//! 1.40 +- 0.23 (B. Byram and J. Shu, IEEE Trans. Ultrason. Ferroelectr. Freq. Control 63 (2016) 1531). Multiple paths
//! widen them laterally. Layers of the wall appear repeatedly at one depth on all scanlines: bands of 3 dB, 1 mm thick.

use std::f64::consts::TAU;

use crate::effects::lateral::{FWHM_PER_SIGMA, MAX_SIGMA, gaussian};
use crate::effects::point_spread::PointSpread;
use insonify_base::parallel::{self, chunks_mut, for_each};
use insonify_base::random::{hash3, seed_words};
use insonify_tracking::probe::BeamGrid;

/// Lateral length relative to that of the point spread.
const WIDENED: f64 = 1.8;
/// Number of echoes per area of the full widths of the kernels.
const TO_A_CELL: f64 = 1.0;
/// Standard deviation of the bands, dB, and their thickness, mm.
const BANDS_DB: f64 = 3.0;
const BANDS_MM: f64 = 1.0;
/// Stream that separates these draws from others with the same seed.
const STREAM: u32 = 0x0c1a_77e2;

type Complex = [f64; 2];

/// Power at each sample, scanline by scanline, of mean `power(depth_mm)`.
pub(super) fn table(grid: &BeamGrid, spread: &PointSpread, seed: u64, power: impl Fn(f64) -> f64) -> Vec<f32> {
    let (lines, samples) = (grid.lines(), grid.samples());
    let [low, high] = seed_words(seed);
    let seed = [low, high ^ STREAM];
    let axial = kernel(spread.axial_mm / grid.sample_spacing_mm());
    let across: Vec<Vec<f64>> = (0..samples)
        .map(|sample| {
            let depth = grid.sample_depth_mm(sample);
            kernel(WIDENED * spread.lateral_at(depth) / grid.lateral_spacing_mm(depth).max(1e-6))
        })
        .collect();
    let bands = bands(grid, seed);
    let means: Vec<f64> = (0..samples)
        .map(|sample| bands[sample] * power(grid.sample_depth_mm(sample)))
        .collect();
    let share = |sample: usize| (TO_A_CELL / (width(&axial) * width(&across[sample]))).min(1.0);
    let shares: Vec<f64> = (0..samples).map(share).collect();
    // The kernel is separable: along each scanline first, where it is the same at all depths, then across, where it
    // widens with depth.
    let norms = norms(&axial, samples);
    let scanlines: Vec<Vec<Complex>> = parallel::map(0..lines, &|line| {
        let mut scanline = vec![[0.0; 2]; samples];
        let reach = axial.len() / 2;
        for (sample, share) in shares.iter().enumerate() {
            let Some([re, im]) = echo([line as i32, sample as i32], *share, seed) else {
                continue;
            };
            let reached = sample.saturating_sub(reach)..=(sample + reach).min(samples - 1);
            for (index, sum) in reached.clone().zip(&mut scanline[reached]) {
                let weight = axial[sample + reach - index];
                *sum = [sum[0] + weight * re, sum[1] + weight * im];
            }
        }
        for (sum, norm) in scanline.iter_mut().zip(&norms) {
            *sum = sum.map(|part| part / norm);
        }
        scanline
    });
    // By the distance in scanlines, 0 beyond the kernel of a depth: loops along a scanline then have no branches.
    let reach = across.iter().map(|kernel| kernel.len() / 2).max().unwrap_or(0);
    let weights: Vec<Vec<f64>> = (0..=2 * reach)
        .map(|offset| {
            let weight = |kernel: &Vec<f64>| {
                let index = (offset + kernel.len() / 2).checked_sub(reach)?;
                kernel.get(index).copied()
            };
            across.iter().map(|kernel| weight(kernel).unwrap_or(0.0)).collect()
        })
        .collect();
    let mut clutter = vec![0.0; lines * samples];
    for_each((0.., chunks_mut(&mut clutter, samples)), &|(line, clutter)| {
        let mut sums = vec![[0.0; 3]; samples];
        for other in line.saturating_sub(reach)..=(line + reach).min(lines - 1) {
            let weights = &weights[other + reach - line];
            for ((sum, weight), [re, im]) in sums.iter_mut().zip(weights).zip(&scanlines[other]) {
                *sum = [sum[0] + weight * re, sum[1] + weight * im, sum[2] + weight * weight];
            }
        }
        for ((clutter, [re, im, power]), mean) in clutter.iter_mut().zip(sums).zip(&means) {
            let [re, im] = [re, im].map(|part| part / power.sqrt());
            *clutter = (mean * (re * re + im * im)) as f32;
        }
    });
    clutter
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
fn norms(kernel: &[f64], count: usize) -> Vec<f64> {
    let reach = kernel.len() / 2;
    let norm = |index: usize| {
        let others = index.saturating_sub(reach)..=(index + reach).min(count - 1);
        let power = others.fold(0.0, |power, other| power + kernel[other + reach - index].powi(2));
        power.sqrt()
    };
    (0..count).map(norm).collect()
}

/// An echo of mean power 1 that is present with probability `share`.
fn echo([line, sample]: [i32; 2], share: f64, seed: [u32; 2]) -> Option<Complex> {
    let [drawn, phase, _] = hash3([line, sample, 0], seed).map(|word| f64::from(word) / 2f64.powi(32));
    if drawn >= share {
        return None;
    }
    let (sine, cosine) = (TAU * phase).sin_cos();
    Some([cosine, sine].map(|part| part / share.sqrt()))
}

/// Log-normal factor on the power at each sample depth, of mean 1.
fn bands(grid: &BeamGrid, seed: [u32; 2]) -> Vec<f64> {
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
        let spread = PointSpread::new(&speckle, &probe);
        let (mut mean, mut snr, mut half) = (0.0, 0.0, 0.0);
        const SEEDS: u64 = 4;
        for seed in 0..SEEDS {
            let power = table(&grid, &spread, seed, |_| 1.0);
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
