//! Lateral kernels: Gaussian weights across scanlines whose width depends on depth.
//!
//! Shared by the lateral point spread of `speckle`, by `blur` and by `shadow`. Widths are given in scanlines for each sample depth, so
//! that a kernel follows arcs of constant depth about the probe's virtual apex.

use crate::base::real::{Numbers, Real};

/// Weights across scanlines, one set per sample depth. Tap `t` applies to the scanline at offset `t - reach`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LateralKernel {
    /// Number of scanlines on each side.
    pub reach: usize,
    /// Weights, tap by tap, each a row over the sample depths.
    pub weights: Numbers,
    /// Smallest ratio of actual to requested width over all depths: below 1 where a kernel exceeds the maximum reach.
    pub least_share: f64,
    samples: usize,
}

/// Full width at half maximum of a Gaussian over its standard deviation, 2 sqrt(2 ln 2).
pub const FWHM_PER_SIGMA: f64 = 2.354_820_045_030_949_3;

/// Widest reach of a kernel to each side, in taps.
pub const MAX_REACH: usize = 64;

/// Largest standard deviation of a kernel, in taps: truncated at three of them it still has a Gaussian's shape.
pub const MAX_SIGMA: f64 = MAX_REACH as f64 / 3.0;

/// Warning about a length whose kernel would reach too far, given the share of it that comes out.
pub fn narrowed(key: &str, share: f64, finer: &str) -> Option<String> {
    (share < 0.99).then(|| {
        format!(
            "{key} comes out at {:.0} % of what is asked where the grid is finest: a kernel reaches {MAX_REACH} {finer} to \
             each side; fewer of them in the probe reach further",
            100.0 * share
        )
    })
}

impl LateralKernel {
    /// Gaussians with a standard deviation of `sigma_lines(sample)` scanlines ([`MAX_SIGMA`] at most), truncated at three of
    /// them, whose sum is `total(sample, weights that sum to 1)`.
    pub fn gaussian(samples: usize, sigma_lines: impl Fn(usize) -> f64, total: impl Fn(usize, &[f64]) -> f64) -> Self {
        let asked = (0..samples).map(&sigma_lines).fold(0.0, f64::max);
        let widest = asked.min(MAX_SIGMA);
        let reach = (3.0 * widest).ceil() as usize;
        let mut weights = vec![0.0; (2 * reach + 1) * samples];
        for sample in 0..samples {
            let own = gaussian(sigma_lines(sample).min(MAX_SIGMA), reach);
            let factor = total(sample, &own);
            for (tap, weight) in own.into_iter().enumerate() {
                weights[tap * samples + sample] = weight * factor;
            }
        }
        Self {
            reach,
            weights: Numbers::new(weights),
            least_share: if asked > widest { widest / asked } else { 1.0 },
            samples,
        }
    }

    /// Weights at one depth, from the scanline `reach` to the left to that `reach` to the right.
    pub fn at(&self, sample: usize) -> impl Iterator<Item = f64> + '_ {
        (0..=2 * self.reach).map(move |tap| self.weights.of::<f64>()[tap * self.samples + sample])
    }
}

/// Maximum number of samples per call of the lateral mean: fits in registers and the first cache.
pub const BLOCK: usize = 64;

impl LateralKernel {
    /// Weighted mean across the scanlines around `line`, at the samples from `start` on, as many as `output` has (at most
    /// [`BLOCK`]). `field` is stored scanline by scanline. If the kernel is truncated at the first or last of `lines`
    /// scanlines, the weights are renormalised.
    #[inline(always)]
    pub(super) fn mean<T: Real>(&self, field: &[T], [line, lines]: [usize; 2], start: usize, output: &mut [T]) {
        let (samples, reach) = (self.samples, self.reach);
        let weights = self.weights.of::<T>();
        let first = line.saturating_sub(reach);
        let last = (line + reach).min(lines - 1);
        let whole = last - first == 2 * reach;
        let (mut sum, mut norm) = ([T::zero(); BLOCK], [T::zero(); BLOCK]);
        for other in first..=last {
            let tap = other + reach - line;
            let values = &field[other * samples + start..][..output.len()];
            let weights = &weights[tap * samples + start..][..output.len()];
            for i in 0..output.len() {
                sum[i] += weights[i] * values[i];
            }
            if !whole {
                for i in 0..output.len() {
                    norm[i] += weights[i];
                }
            }
        }
        for i in 0..output.len() {
            output[i] = if whole { sum[i] } else { sum[i] / norm[i] };
        }
    }
}

/// A sampled Gaussian of `2 * reach + 1` taps that sums to 1; a single spike for a vanishing width.
pub fn gaussian(sigma: f64, reach: usize) -> Vec<f64> {
    let centre = reach as f64;
    let raw: Vec<f64> = (0..=2 * reach)
        .map(|tap| {
            let away = tap as f64 - centre;
            if sigma < 1e-3 {
                f64::from(u8::from(away == 0.0))
            } else {
                (-away * away / (2.0 * sigma * sigma)).exp()
            }
        })
        .collect();
    let sum: f64 = raw.iter().sum();
    raw.into_iter().map(|weight| weight / sum).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_reaches_too_far_is_a_narrower_gaussian_and_says_so() {
        let kernel = LateralKernel::gaussian(2, |sample| [10.0, 4.0 * MAX_SIGMA][sample], |_, _| 1.0);
        assert_eq!((kernel.reach, kernel.least_share), (MAX_REACH, 0.25));
        let widest: Vec<f64> = kernel.at(1).collect();
        assert!(widest[0] < 0.02 * widest[MAX_REACH], "the ends fade: {widest:?}");
        assert_eq!(LateralKernel::gaussian(1, |_| 10.0, |_, _| 1.0).least_share, 1.0);
    }

    #[test]
    fn kernels_sum_to_one_and_have_the_width_asked() {
        let kernel = LateralKernel::gaussian(4, |sample| sample as f64, |_, _| 1.0);
        assert_eq!(kernel.reach, 9);
        for sample in 0..4 {
            let sum: f64 = kernel.at(sample).sum();
            let variance: f64 = kernel
                .at(sample)
                .enumerate()
                .map(|(tap, w)| w * (tap as f64 - 9.0).powi(2))
                .sum();
            assert!((sum - 1.0).abs() < 1e-12);
            assert!((variance.sqrt() - sample as f64).abs() < 0.05, "{sample}: {variance}");
        }
    }
}
