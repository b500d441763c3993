//! Radio-frequency echoes of point scatterers: each adds a pulse to the scanlines that its beam reaches.

use rayon::prelude::*;

use super::Acquisition;

/// Lines rendered together: the pulse of a scatterer is interpolated once for all of them.
const BLOCK: usize = 16;
/// Reach of Gaussian profiles, standard deviations.
const REACH: f64 = 3.0;
/// Half length of a pulse, standard deviations.
const PULSE_REACH: f64 = 4.0;
/// Fractions of a sample at which the pulse is tabulated; linear between them (error 5e-6 at 8 samples a period).
const PHASES: usize = 128;

/// Gaussian pulse exp(-t^2 / 2 s^2) cos(2 pi f t).
#[derive(Clone, Debug)]
pub struct Pulse {
    half: usize,
    /// `PHASES + 1` rows of `2 half + 2` samples.
    table: Vec<f32>,
}

impl Pulse {
    /// Tabulates the pulse of an acquisition.
    pub fn new(acquisition: &Acquisition) -> Self {
        let Acquisition {
            frequency_mhz,
            sampling_mhz,
            ..
        } = *acquisition;
        let sigma_us = acquisition.sigma_us();
        let half = (PULSE_REACH * sigma_us * sampling_mhz).ceil() as usize;
        let value = |at: usize| {
            let (phase, sample) = (at / (2 * half + 2), at % (2 * half + 2));
            let t = (sample as f64 - half as f64 - phase as f64 / PHASES as f64) / sampling_mhz;
            ((-0.5 * (t / sigma_us).powi(2)).exp() * (std::f64::consts::TAU * frequency_mhz * t).cos()) as f32
        };
        Self {
            half,
            table: (0..(PHASES + 1) * (2 * half + 2)).map(value).collect(),
        }
    }

    fn length(&self) -> usize {
        2 * self.half + 2
    }

    /// Sum of the squares of the samples.
    pub fn energy(&self) -> f64 {
        self.table[..self.length()]
            .iter()
            .map(|value| f64::from(value * value))
            .sum()
    }

    /// Writes the pulse at a fraction (0 to 1) of a sample behind its middle.
    fn at(&self, fraction: f32, into: &mut [f32]) {
        let phase = fraction * PHASES as f32;
        let low = (phase as usize).min(PHASES - 1);
        let share = phase - low as f32;
        let rows = &self.table[low * self.length()..(low + 2) * self.length()];
        let (a, b) = rows.split_at(self.length());
        for ((out, a), b) in into.iter_mut().zip(a).zip(b) {
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

/// Adds the echoes of scatterers to `lines` scanlines of `samples`, line by line. The result does not depend on the number of threads.
pub fn echoes(scatterers: &mut [Scatterer], pulse: &Pulse, lines: usize, samples: usize) -> Vec<f32> {
    scatterers.par_sort_by(|a, b| a.line.total_cmp(&b.line));
    let widest = scatterers.iter().map(|it| it.sigma).fold(0.0, f32::max) * REACH as f32;
    let mut out = vec![0.0_f32; lines * samples];
    out.par_chunks_mut(BLOCK * samples)
        .enumerate()
        .for_each(|(block, rows)| {
            let first = (block * BLOCK) as f32;
            let last = first + (rows.len() / samples - 1) as f32;
            let from = scatterers.partition_point(|it| it.line < first - widest);
            let to = scatterers.partition_point(|it| it.line <= last + widest);
            let mut wave = vec![0.0_f32; pulse.length()];
            for it in &scatterers[from..to] {
                let reach = REACH as f32 * it.sigma;
                let (low, high) = ((it.line - reach).max(first).ceil(), (it.line + reach).min(last).floor());
                let start = it.sample.floor();
                let begin = start - pulse.half as f64;
                if low > high || begin >= samples as f64 || begin + (pulse.length() as f64) < 0.0 {
                    continue;
                }
                pulse.at((it.sample - start) as f32, &mut wave);
                let skip = (-begin).max(0.0) as usize;
                let begin = begin.max(0.0) as usize;
                let wave = &wave[skip..];
                let count = wave.len().min(samples - begin);
                for line in low as usize..=high as usize {
                    let away = (line as f32 - it.line) / it.sigma;
                    let weight = it.amplitude * (-0.5 * away * away).exp();
                    let row = (line - block * BLOCK) * samples + begin;
                    for (out, value) in rows[row..row + count].iter_mut().zip(wave) {
                        *out += weight * value;
                    }
                }
            }
        });
    out
}
