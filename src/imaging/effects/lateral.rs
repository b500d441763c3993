//! Lateral kernels: Gaussian weights across scanlines whose width depends on depth.
//!
//! Shared by the lateral point spread of `speckle`, by `blur` and by `shadow`. Widths are given in scanlines for each
//! sample depth, so that a kernel follows arcs of constant depth about the probe's virtual apex.

use insonify_base::real::{Numbers, Real};
use insonify_tracking::probe::Probe;

/// Weights across scanlines, one set per sample depth. Tap `t` applies to the scanline at offset `t - reach`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LateralKernel {
    /// Largest number of scanlines on each side.
    pub reach: usize,
    /// Rows over the sample depths: number of scanlines on each side, beyond which the weights are zero; then the
    /// weights, tap by tap.
    pub rows: Numbers,
    /// Smallest ratio of actual to requested width over all depths: below 1 where a kernel exceeds the maximum reach.
    pub least_share: f64,
    samples: usize,
}

/// Full width at half maximum of a Gaussian over its standard deviation, 2 sqrt(2 ln 2).
pub const FWHM_PER_SIGMA: f64 = 2.354_820_045_030_949_3;

/// Widest reach of a kernel to each side, in taps.
pub const MAX_REACH: usize = 64;

/// Largest standard deviation of a kernel, in taps: truncated at three of them it still has a Gaussian's shape.
pub(crate) const MAX_SIGMA: f64 = MAX_REACH as f64 / 3.0;

/// Standard deviations to each side beyond which the weights of a depth are zero, if the widest kernel reaches so far:
/// there a Gaussian is below -69 dB of its peak.
const FARTHEST: f64 = 4.0;

/// Warning about a length whose kernel would reach too far, given the share of it that comes out. The usual length on
/// the usual grid is not doubted, though it is wider than a sector at its apex.
pub(crate) fn narrowed(key: &str, is_stated: bool, share: f64, finer: &str, probe: &Probe) -> Option<String> {
    let usual = probe.shape.kind().usual();
    let is_usual = !is_stated && probe.lines <= usual.lines && probe.samples <= usual.samples;
    (share < 0.99 && !is_usual).then(|| {
        format!(
            "{key} is {:.0} % of the requested value where the grid is finest: a kernel reaches at most {MAX_REACH} {finer} to \
             each side; reduce their number under [probe]",
            100.0 * share
        )
    })
}

impl LateralKernel {
    /// Gaussians with a standard deviation of `sigma_lines(sample)` scanlines (`MAX_SIGMA` at most), truncated at
    /// three of the widest or at four of their own, whose sum is `total(sample, weights that sum to 1)`.
    pub fn gaussian(samples: usize, sigma_lines: impl Fn(usize) -> f64, total: impl Fn(usize, &[f64]) -> f64) -> Self {
        let requested = (0..samples).map(&sigma_lines).fold(0.0, f64::max);
        let widest = requested.min(MAX_SIGMA);
        let reach = (3.0 * widest).ceil() as usize;
        let weights = |sample: usize| {
            let sigma = sigma_lines(sample).min(MAX_SIGMA);
            let mut weights = gaussian(sigma, reach.min((FARTHEST * sigma).ceil() as usize));
            let factor = total(sample, &weights);
            weights.iter_mut().for_each(|weight| *weight *= factor);
            weights
        };
        let least_share = if requested > widest { widest / requested } else { 1.0 };
        Self::of(&(0..samples).map(weights).collect::<Vec<_>>(), least_share)
    }

    /// The kernel with these weights at each sample depth, an odd number of them, and this share of the requested width.
    pub(super) fn of(weights: &[Vec<f64>], least_share: f64) -> Self {
        let reach = weights.iter().map(|weights| weights.len() / 2).max().unwrap_or(0);
        let samples = weights.len();
        let mut rows = vec![0.0; (2 * reach + 2) * samples];
        for (sample, weights) in weights.iter().enumerate() {
            let near = weights.len() / 2;
            rows[sample] = near as f64;
            for (tap, weight) in weights.iter().enumerate() {
                rows[(1 + reach - near + tap) * samples + sample] = *weight;
            }
        }
        Self {
            reach,
            rows: Numbers::new(rows),
            least_share,
            samples,
        }
    }

    /// Weights at one depth, from the scanline `reach` to the left to that `reach` to the right.
    pub fn at(&self, sample: usize) -> impl Iterator<Item = f64> + '_ {
        (1..=2 * self.reach + 1).map(move |row| self.rows.of::<f64>()[row * self.samples + sample])
    }
}

/// Number of samples of a scanline that are summed together: their sums fit in vector registers.
pub const BLOCK: usize = 64;

impl LateralKernel {
    /// Weighted sums of `N` fields across the scanlines around the one of index `line` among `lines`, at the [`BLOCK`]
    /// samples from `start` on, as far as the scanline reaches. `scanline` gives each field's scanline of a number.
    #[inline(always)]
    pub(super) fn sums<'a, T: Real, const N: usize>(
        &self,
        [line, lines]: [usize; 2],
        start: usize,
        scanline: impl Fn(usize) -> [&'a [T]; N],
    ) -> [[T; BLOCK]; N] {
        let mut sums = [[T::zero(); BLOCK]; N];
        let across = self.across([line, lines], start);
        // With a fixed length the sums stay in registers.
        if start + BLOCK <= self.samples {
            for other in across {
                let weights = block(self.row(other + self.reach - line, start));
                let values = scanline(other);
                for field in 0..N {
                    add(&mut sums[field], weights, block(&values[field][start..]));
                }
            }
        } else {
            for other in across {
                let weights = self.row(other + self.reach - line, start);
                let values = scanline(other);
                for field in 0..N {
                    add(&mut sums[field], weights, &values[field][start..]);
                }
            }
        }
        sums
    }

    /// Weighted mean across the scanlines around one (its index, and the number of scanlines), at the samples from
    /// `start` on, as many as `output` has (at most [`BLOCK`]). `field` is stored scanline by scanline. If the kernel
    /// is truncated at the first or last scanline, the weights are renormalised.
    #[inline(always)]
    pub(super) fn mean<T: Real>(&self, field: &[T], line_and_count: [usize; 2], start: usize, output: &mut [T]) {
        let samples = self.samples;
        let [sum] = self.sums(line_and_count, start, |other| [&field[other * samples..][..samples]]);
        output.copy_from_slice(&sum[..output.len()]);
        if self.is_truncated(line_and_count, start) {
            let mut norm = [T::zero(); BLOCK];
            for other in self.across(line_and_count, start) {
                for (norm, weight) in norm
                    .iter_mut()
                    .zip(self.row(other + self.reach - line_and_count[0], start))
                {
                    *norm += *weight;
                }
            }
            for (mean, norm) in output.iter_mut().zip(norm) {
                *mean /= norm;
            }
        }
    }

    /// Sums of the squares of those weights of [`sums`](Self::sums) that fall on a scanline.
    #[inline(always)]
    pub(super) fn squares<T: Real>(&self, [line, lines]: [usize; 2], start: usize) -> [T; BLOCK] {
        let mut sums = [T::zero(); BLOCK];
        for other in self.across([line, lines], start) {
            for (sum, weight) in sums.iter_mut().zip(self.row::<T>(other + self.reach - line, start)) {
                *sum += *weight * *weight;
            }
        }
        sums
    }

    /// Returns whether the kernel reaches beyond the first or last scanline at a block of samples.
    #[inline(always)]
    pub(super) fn is_truncated(&self, line_and_count: [usize; 2], start: usize) -> bool {
        self.across(line_and_count, start).count() < 2 * self.widest(start) + 1
    }

    /// Scanlines that a block of samples needs.
    #[inline(always)]
    fn across(&self, [line, lines]: [usize; 2], start: usize) -> std::ops::RangeInclusive<usize> {
        let reach = self.widest(start);
        line.saturating_sub(reach)..=(line + reach).min(lines - 1)
    }

    /// Largest reach of a block of samples.
    #[inline(always)]
    fn widest(&self, start: usize) -> usize {
        let reaches = self.rows.of::<f32>()[start..self.samples].iter().take(BLOCK);
        reaches.fold(0.0f32, |widest, &reach| widest.max(reach)) as usize
    }

    /// Weights of a tap at the samples from `start` on.
    #[inline(always)]
    fn row<T: Real>(&self, tap: usize, start: usize) -> &[T] {
        &self.rows.of::<T>()[(1 + tap) * self.samples..][..self.samples][start..]
    }
}

/// Adds the products of weights and values.
#[inline(always)]
fn add<T: Real>(sums: &mut [T; BLOCK], weights: &[T], values: &[T]) {
    for i in 0..BLOCK.min(weights.len()).min(values.len()) {
        sums[i] += weights[i] * values[i];
    }
}

/// The first [`BLOCK`] numbers of a row that has as many.
#[inline(always)]
fn block<T>(row: &[T]) -> &[T; BLOCK] {
    row.first_chunk().expect("a full block")
}

/// A sampled Gaussian of `2 * reach + 1` taps that sums to 1; a single spike for a vanishing width.
pub fn gaussian(sigma: f64, reach: usize) -> Vec<f64> {
    let half: Vec<f64> = (0..=reach)
        .map(|away| {
            if sigma < 1e-3 {
                f64::from(u8::from(away == 0))
            } else {
                let away = away as f64;
                (-away * away / (2.0 * sigma * sigma)).exp()
            }
        })
        .collect();
    let raw: Vec<f64> = (0..=2 * reach).map(|tap| half[tap.abs_diff(reach)]).collect();
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

    /// Weighted sum with the weights of every tap, one by one.
    fn every_tap(kernel: &LateralKernel, field: &[f64], [line, lines]: [usize; 2], sample: usize) -> [f64; 2] {
        let samples = field.len() / lines;
        kernel
            .at(sample)
            .enumerate()
            .fold([0.0; 2], |[sum, norm], (tap, weight)| {
                match (line + tap).checked_sub(kernel.reach).filter(|&other| other < lines) {
                    Some(other) => [sum + weight * field[other * samples + sample], norm + weight],
                    None => [sum, norm],
                }
            })
    }

    #[test]
    fn blocks_sum_as_all_taps_do_whatever_their_depths_reach() {
        // Two complete blocks and a rest; the first depth is the widest, the next not spread at all.
        let (lines, samples) = (23, 2 * BLOCK + 5);
        let field: Vec<f64> = (0..lines * samples).map(|at| ((at * 7919) % 101) as f64).collect();
        let sigma = |sample: usize| 3.0 / (1.0 + sample as f64 / 9.0) * f64::from(sample != 1);
        let kernel = LateralKernel::gaussian(samples, sigma, |_, _| 1.0);
        assert_eq!(
            [0, 1, 18, 130].map(|sample| kernel.rows.of::<f64>()[sample]),
            [9.0, 0.0, 4.0, 1.0]
        );
        for line in [0, 4, 11, 22] {
            for start in (0..samples).step_by(BLOCK) {
                let count = BLOCK.min(samples - start);
                let [sums] = kernel.sums([line, lines], start, |other| [&field[other * samples..][..samples]]);
                let mut means = vec![0.0; count];
                kernel.mean(&field, [line, lines], start, &mut means);
                for i in 0..count {
                    let [sum, norm] = every_tap(&kernel, &field, [line, lines], start + i);
                    assert!(
                        (sums[i] - sum).abs() < 1e-11 && (means[i] - sum / norm).abs() < 1e-11,
                        "{line} {start} {i}"
                    );
                }
            }
        }
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
