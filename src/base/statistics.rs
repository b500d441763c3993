//! Moments, correlations and percentiles of samples.

use std::hint::black_box;
use std::time::Instant;

use serde::Serialize;

/// Returns the mean; NaN for an empty slice.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the median: the middle value, or the mean of the two in the middle; `None` for an empty list.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let (low, high) = (
        values.get(values.len().saturating_sub(1) / 2)?,
        values.get(values.len() / 2)?,
    );
    Some(0.5 * (low + high))
}

/// Returns the standard deviation of a sample.
pub fn std(values: &[f64]) -> f64 {
    let middle = mean(values);
    (values.iter().map(|x| (x - middle).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)).sqrt()
}

/// Returns the skewness: the mean cube of the deviations from the mean, in standard deviations.
pub fn skewness(values: &[f64]) -> f64 {
    let (middle, spread) = (mean(values), std(values));
    values.iter().map(|x| ((x - middle) / spread).powi(3)).sum::<f64>() / values.len() as f64
}

/// Returns the correlation coefficient.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (ma, mb) = (mean(a), mean(b));
    let product: f64 = a.iter().zip(b).map(|(x, y)| (x - ma) * (y - mb)).sum();
    let squares = |v: &[f64], m: f64| v.iter().map(|x| (x - m).powi(2)).sum::<f64>();
    product / (squares(a, ma) * squares(b, mb)).sqrt()
}

/// Returns the slope of the least-squares line through points.
pub fn slope(x: &[f64], y: &[f64]) -> f64 {
    let (mx, my) = (mean(x), mean(y));
    let above: f64 = x.iter().zip(y).map(|(a, b)| (a - mx) * (b - my)).sum();
    above / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>()
}

/// Returns the full width at half maximum of a correlation, sampled at multiples of `step` from 1 at distance 0; `None`
/// if it stays above one half.
pub fn full_width(correlations: &[f64], step: f64) -> Option<f64> {
    let after = correlations.iter().position(|&c| c < 0.5)?;
    let (high, low) = (*correlations.get(after.checked_sub(1)?)?, correlations[after]);
    Some(2.0 * step * (after as f64 - 1.0 + (high - 0.5) / (high - low)))
}

/// Statistics of frame times.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Median frame time, ms.
    pub median_ms: f64,
    /// 95th percentile of the frame times, ms.
    pub p95_ms: f64,
    /// Frames per second at the median.
    pub fps: f64,
    /// Number of frames measured.
    pub frames: usize,
}

impl Spread {
    /// Runs `work` repeatedly and computes the spread of its times; `None` for no runs.
    ///
    /// # Errors
    /// The first error of `work`.
    pub fn of_runs<T, E>(runs: usize, mut work: impl FnMut() -> Result<T, E>) -> Result<Option<Self>, E> {
        let times = (0..runs).map(|_| {
            let start = Instant::now();
            black_box(work()?);
            Ok(start.elapsed().as_secs_f64() * 1e3)
        });
        Ok(Self::of(times.collect::<Result<_, _>>()?))
    }

    /// Computes the spread of times in ms; `None` for an empty list. Percentiles are nearest ranks.
    pub fn of(mut ms: Vec<f64>) -> Option<Self> {
        ms.sort_by(f64::total_cmp);
        let rank = |share: f64| percentile(&ms, share);
        let median_ms = rank(0.5)?;
        Some(Self {
            median_ms,
            p95_ms: rank(0.95)?,
            fps: 1000.0 / median_ms.max(f64::MIN_POSITIVE),
            frames: ms.len(),
        })
    }
}

/// Histogram of any number of step times in a fixed 24 KiB: bins 1/64 of an octave wide, from 0.1 ns to three hours.
/// Percentiles are accurate to 0.6 %; the longest time is exact.
#[derive(Clone, Debug)]
pub struct Times {
    counts: Vec<u64>,
    total: u64,
    max_ms: f64,
}

impl Default for Times {
    fn default() -> Self {
        Self {
            counts: vec![0; Self::CLASSES],
            total: 0,
            max_ms: 0.0,
        }
    }
}

impl Times {
    const AN_OCTAVE: f64 = 64.0;
    const MIN_MS: f64 = 1e-7;
    const CLASSES: usize = 47 * 64;

    /// Adds a time, ms.
    pub fn add(&mut self, ms: f64) {
        let class = Self::AN_OCTAVE * (ms / Self::MIN_MS).log2();
        self.counts[(class.max(0.0) as usize).min(Self::CLASSES - 1)] += 1;
        self.total += 1;
        self.max_ms = self.max_ms.max(ms);
    }

    /// Returns the time that the given share (0 to 1) of the steps does not exceed, ms; `None` without steps.
    pub fn percentile(&self, share: f64) -> Option<f64> {
        let rank = ((share * self.total as f64).ceil() as u64).max(1);
        if rank >= self.total {
            return (self.total > 0).then_some(self.max_ms);
        }
        let mut counted = 0;
        let class = self.counts.iter().position(|count| {
            counted += count;
            counted >= rank
        })?;
        Some((Self::MIN_MS * ((class as f64 + 0.5) / Self::AN_OCTAVE).exp2()).min(self.max_ms))
    }
}

/// Returns the nearest-rank percentile of ascending numbers at a share of 0 to 1; `None` for an empty slice.
pub fn percentile(ascending: &[f64], share: f64) -> Option<f64> {
    let rank = (share * ascending.len() as f64).ceil() as usize;
    ascending.get(rank.max(1) - 1).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counted_percentiles_are_those_of_the_sorted_times() {
        let mut times = Times::default();
        assert_eq!(times.percentile(0.5), None);
        let mut sorted: Vec<f64> = (0..5000).map(|i| 1e-3 * 1.003f64.powi(i * 7919 % 5000)).collect();
        sorted.iter().for_each(|&ms| times.add(ms));
        sorted.sort_by(f64::total_cmp);
        for share in [0.0, 0.5, 0.95, 0.99] {
            let [exact, counted] = [percentile(&sorted, share), times.percentile(share)].map(Option::unwrap);
            assert!((counted / exact - 1.0).abs() < 0.006, "{share}: {counted} for {exact}");
        }
        assert_eq!(times.percentile(1.0), percentile(&sorted, 1.0));
        // Zero, tiny, huge and infinite times all fall into a bin.
        [0.0, 1e-300, 1e300, f64::INFINITY]
            .into_iter()
            .for_each(|ms| times.add(ms));
        assert_eq!(times.percentile(1.0), Some(f64::INFINITY));
    }
}
