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
const PHASES: usize = 128;

/// Steps of the centre frequency, from that of the probe down to zero, at which the pulse is tabulated: a centre is off
/// by at most a sixtieth of the probe's.
const CENTRE_STEPS: usize = 30;

/// Gaussian pulse exp(-t^2 / 2 s^2) cos(2 pi f t), and what attenuation makes of it: its centre sinks, it lengthens in
/// the same proportion and keeps its energy.
#[derive(Clone, Debug)]
pub struct Pulse {
    half: usize,
    /// For each centre `PHASES + 1` rows of `2 half + 2` samples.
    table: Vec<f32>,
}

impl Pulse {
    /// Tabulates the pulses of an acquisition from its frequency down to the `lowest` centre, over that frequency.
    pub(crate) fn new(acquisition: &Acquisition, lowest: f64) -> Self {
        let Acquisition {
            frequency_mhz,
            sampling_mhz,
            ..
        } = *acquisition;
        let sigma_us = acquisition.sigma_us();
        let steps = ((1.0 - lowest) * CENTRE_STEPS as f64).ceil() as usize;
        let centre = |step: usize| 1.0 - step as f64 / CENTRE_STEPS as f64;
        let half = (PULSE_REACH * sigma_us * sampling_mhz / centre(steps)).ceil() as usize;
        let value = |index: usize| {
            let (row, sample) = (index / (2 * half + 2), index % (2 * half + 2));
            let (centre, phase) = (centre(row / (PHASES + 1)), row % (PHASES + 1));
            let t = centre * (sample as f64 - half as f64 - phase as f64 / PHASES as f64) / sampling_mhz;
            let wave = (-0.5 * (t / sigma_us).powi(2)).exp() * (std::f64::consts::TAU * frequency_mhz * t).cos();
            (centre.sqrt() * wave) as f32
        };
        Self {
            half,
            table: (0..(steps + 1) * (PHASES + 1) * (2 * half + 2)).map(value).collect(),
        }
    }

    /// Number of samples.
    pub(crate) fn length(&self) -> usize {
        2 * self.half + 2
    }

    /// The pulses at `PHASES + 1` fractions of a sample each.
    pub(crate) fn table(&self) -> &[f32] {
        &self.table
    }

    /// Number of rows of the table.
    pub(crate) fn rows(&self) -> usize {
        self.table.len() / self.length()
    }

    /// Sum of the squares of the samples.
    pub(crate) fn energy(&self) -> f64 {
        self.table[..self.length()]
            .iter()
            .map(|value| f64::from(value * value))
            .sum()
    }

    /// Writes the pulse at a row of the table.
    fn at<R: Real>(&self, row: f32, into: &mut [R]) {
        let low = (row as usize).min(self.rows() - 2);
        let share = R::of(f64::from(row - low as f32));
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
    /// Centre frequency of its echo over that of the probe.
    pub centre: f32,
}

impl Scatterer {
    /// Row of a table of pulses with this number of rows, between two of them.
    pub(crate) fn row(&self, rows: usize) -> f32 {
        let step = ((1.0 - self.centre) * CENTRE_STEPS as f32).round() as usize;
        let first = step.min(rows / (PHASES + 1) - 1) * (PHASES + 1);
        first as f32 + (self.sample - self.sample.floor()) as f32 * PHASES as f32
    }

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
            pulse.at(scatterer.row(pulse.rows()), &mut wave);
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
