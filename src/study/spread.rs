//! Medians and percentiles of times.

use serde::Serialize;

/// Times of a number of frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Half of the frames took at most this, ms.
    pub median_ms: f64,
    /// 95 of 100 frames took at most this, ms.
    pub p95_ms: f64,
    /// Frames a second at the median.
    pub fps: f64,
    /// Frames measured.
    pub frames: usize,
}

impl Spread {
    /// The spread of some times, ms; none of no times. Percentiles are nearest ranks.
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

/// The nearest rank of a share (0 to 1) of ascending numbers; none of none.
pub fn percentile(ascending: &[f64], share: f64) -> Option<f64> {
    let place = (share * ascending.len() as f64).ceil() as usize;
    ascending.get(place.max(1) - 1).copied()
}
