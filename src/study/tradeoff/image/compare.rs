//! Timed rendering of a picture, and its comparison with a standard.

use std::time::{Duration, Instant};

use crate::base::report::statistics::{Spread, percentile};
use crate::imaging::synth::{FrameState, SynthError, Synthesizer};

/// Minimum number of timed frames, after one untimed frame.
const LEAST: usize = 3;
/// Maximum number of timed frames.
const MOST: usize = 200;

/// Rendered picture with its times.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub pixels: Vec<u8>,
    pub time: Option<Spread>,
    pub memory_mb: f64,
}

/// Renders a frame repeatedly until `patience` is spent.
pub fn picture(synth: &mut Synthesizer, state: &FrameState, patience: Duration) -> Result<Picture, SynthError> {
    let pixels = synth.render(state)?.pixels.clone();
    let (start, mut times) = (Instant::now(), Vec::with_capacity(MOST));
    while times.len() < LEAST || (times.len() < MOST && start.elapsed() < patience) {
        let before = Instant::now();
        synth.render(state)?;
        times.push(before.elapsed().as_secs_f64() * 1e3);
    }
    Ok(Picture {
        pixels,
        time: Spread::of(times),
        memory_mb: synth.memory_bytes() as f64 * 1e-6,
    })
}

/// Difference of a picture from its standard, in grey levels, over the pixels inside the sector.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Apart {
    pub rms: f64,
    pub p99: f64,
    /// Mean difference, positive if the picture is brighter.
    pub bias: f64,
}

impl Apart {
    pub fn of(standard: &[u8], found: &[u8], inside: &[bool]) -> Self {
        let pairs = standard.iter().zip(found).zip(inside).filter(|(_, inside)| **inside);
        let off: Vec<f64> = pairs.map(|((a, b), _)| f64::from(*b) - f64::from(*a)).collect();
        let n = off.len().max(1) as f64;
        let mut sizes: Vec<f64> = off.iter().map(|x| x.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        Self {
            rms: (off.iter().map(|x| x * x).sum::<f64>() / n).sqrt(),
            p99: percentile(&sizes, 0.99).unwrap_or(0.0),
            bias: off.iter().sum::<f64>() / n,
        }
    }

    /// Describes an offset, which a valid approximation does not have: a mean difference above one grey level plus half the root mean
    /// square.
    pub fn offset(&self) -> Option<String> {
        (self.bias.abs() > 1.0 + 0.5 * self.rms).then(|| {
            format!(
                "{:+.1} grey levels on the whole: an offset, no approximation",
                self.bias
            )
        })
    }

    /// Describes an offset (see [`Apart::offset`]), or a refinement whose error exceeds that of the coarser level by more than a tenth and
    /// rounding.
    pub fn flag(&self, coarser: Option<&Apart>) -> Option<String> {
        let worse = coarser.filter(|coarser| self.rms > 1.1 * coarser.rms + 0.3);
        self.offset().or_else(|| {
            worse.map(|coarser| {
                format!(
                    "RMS {:.2}, above {:.2} of the coarser level before it",
                    self.rms, coarser.rms
                )
            })
        })
    }
}

/// Returns a mask of the pixels inside the sector.
pub fn inside(synth: &Synthesizer) -> Vec<bool> {
    synth.tables().scan_map.iter().map(|at| at[0] >= 0.0).collect()
}

/// Returns the values of [`super::PICTURE`].
pub fn values(picture: &Picture, apart: Option<&Apart>) -> Vec<Option<f64>> {
    vec![
        picture.time.map(|time| time.median_ms),
        picture.time.map(|time| time.p95_ms),
        Some(picture.memory_mb),
        apart.map(|apart| apart.rms),
        apart.map(|apart| apart.p99),
        apart.map(|apart| apart.bias),
    ]
}
