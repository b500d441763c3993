//! Radio-frequency echoes of point scatterers: each adds a pulse to the scanlines that its beam reaches.

use super::Acquisition;
use insonify_base::parallel::{chunks_mut, for_each, sort_by};
use insonify_base::real::Real;

/// Lines rendered together: the pulse of a scatterer is interpolated once for all of them.
const BLOCK: usize = 16;
/// Reach of Gaussian profiles, standard deviations.
pub const REACH: f64 = 3.0;
/// Half length of a pulse, standard deviations.
const PULSE_REACH: f64 = 4.0;
/// Fractions of a sample at which the pulse is tabulated; linear between them (error 5e-6 at 8 samples a period).
pub const PHASES: usize = 128;

/// Gaussian pulse exp(-t^2 / 2 s^2) cos(2 pi f t).
#[derive(Clone, Debug)]
pub struct Pulse {
    half: usize,
    /// `PHASES + 1` rows of `2 half + 2` samples.
    table: Vec<f32>,
}

impl Pulse {
    /// Tabulates the pulse of an acquisition.
    pub(crate) fn new(acquisition: &Acquisition) -> Self {
        let Acquisition {
            frequency_mhz,
            sampling_mhz,
            ..
        } = *acquisition;
        let sigma_us = acquisition.sigma_us();
        let half = (PULSE_REACH * sigma_us * sampling_mhz).ceil() as usize;
        let value = |index: usize| {
            let (phase, sample) = (index / (2 * half + 2), index % (2 * half + 2));
            let t = (sample as f64 - half as f64 - phase as f64 / PHASES as f64) / sampling_mhz;
            ((-0.5 * (t / sigma_us).powi(2)).exp() * (std::f64::consts::TAU * frequency_mhz * t).cos()) as f32
        };
        Self {
            half,
            table: (0..(PHASES + 1) * (2 * half + 2)).map(value).collect(),
        }
    }

    /// Number of samples.
    pub(crate) fn length(&self) -> usize {
        2 * self.half + 2
    }

    /// The pulse at `PHASES + 1` fractions of a sample.
    pub(crate) fn table(&self) -> &[f32] {
        &self.table
    }

    /// Sum of the squares of the samples.
    pub(crate) fn energy(&self) -> f64 {
        self.table[..self.length()]
            .iter()
            .map(|value| f64::from(value * value))
            .sum()
    }

    /// Writes the pulse at a fraction (0 to 1) of a sample behind its middle.
    fn at<R: Real>(&self, fraction: f32, into: &mut [R]) {
        let phase = fraction * PHASES as f32;
        let low = (phase as usize).min(PHASES - 1);
        let share = R::of(f64::from(phase - low as f32));
        let rows = &self.table[low * self.length()..(low + 2) * self.length()];
        let (a, b) = rows.split_at(self.length());
        for ((out, a), b) in into.iter_mut().zip(a).zip(b) {
            let [a, b] = [*a, *b].map(|value| R::of(f64::from(value)));
            *out = a + share * (b - a);
        }
    }
}

/// A scatterer in beam space.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scatterer {
    /// Line coordinate.
    pub line: f32,
    /// Sample coordinate of its echo.
    pub sample: f64,
    /// Amplitude, with attenuation and the elevational profile.
    pub amplitude: f32,
    /// Standard deviation of the lateral profile, lines.
    pub sigma: f32,
}

impl Scatterer {
    /// First and last of `lines` lines that the beam reaches; `None` for none.
    pub(crate) fn lines(&self, lines: usize) -> Option<[usize; 2]> {
        let reach = REACH as f32 * self.sigma;
        let low = (self.line - reach).ceil().max(0.0);
        let high = (self.line + reach).floor().min((lines - 1) as f32);
        (low <= high).then_some([low as usize, high as usize])
    }
}

/// Adds the echoes of scatterers to `lines` scanlines of `samples`, line by line. The result does not depend on the
/// number of threads. In double precision it is the gold standard of both backends.
pub fn echoes<R: Real>(scatterers: &mut [Scatterer], pulse: &Pulse, lines: usize, samples: usize) -> Vec<R> {
    // Blocks of scanlines are filled by several threads; sorted by scanline, the scatterers that reach a block are one
    // run.
    sort_by(scatterers, |a, b| a.line.total_cmp(&b.line));
    let widest = scatterers.iter().map(|scatterer| scatterer.sigma).fold(0.0, f32::max) * REACH as f32;
    let mut out = vec![R::default(); lines * samples];
    for_each((0.., chunks_mut(&mut out, BLOCK * samples)), &|(block, rows)| {
        let (first, last) = (block * BLOCK, block * BLOCK + rows.len() / samples - 1);
        let from = scatterers.partition_point(|scatterer| scatterer.line < first as f32 - widest);
        let to = scatterers.partition_point(|scatterer| scatterer.line <= last as f32 + widest);
        let mut wave = vec![R::default(); pulse.length()];
        for scatterer in &scatterers[from..to] {
            let Some([low, high]) = scatterer.lines(lines) else {
                continue;
            };
            let (low, high) = (low.max(first), high.min(last));
            let start = scatterer.sample.floor();
            let begin = start - pulse.half as f64;
            if low > high || begin >= samples as f64 || begin + (pulse.length() as f64) < 0.0 {
                continue;
            }
            pulse.at((scatterer.sample - start) as f32, &mut wave);
            let skip = ((-begin).max(0.0) as usize).min(wave.len());
            let begin = begin.max(0.0) as usize;
            let wave = &wave[skip..];
            let count = wave.len().min(samples - begin);
            let [centre, sigma, amplitude] =
                [scatterer.line, scatterer.sigma, scatterer.amplitude].map(|value| R::of(f64::from(value)));
            for line in low..=high {
                let away = (R::of(line as f64) - centre) / sigma;
                let weight = amplitude * (R::of(-0.5) * away * away).exp();
                let row = (line - first) * samples + begin;
                for (out, value) in rows[row..row + count].iter_mut().zip(wave) {
                    *out += weight * *value;
                }
            }
        }
    });
    out
}
