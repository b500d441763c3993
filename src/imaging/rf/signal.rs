//! Envelopes and band-limited upsampling of lines.

use std::f64::consts::PI;

use crate::rf::fft::{Complex32, Fft};
use insonify_base::parallel::{chunks, chunks_mut, for_each_init};
use insonify_base::simd::{Kernel, vectorised};

/// Transforms of lines of one length.
pub struct Lines {
    samples: usize,
    /// Transform of the next power of two of samples.
    fft: Fft,
}

impl Lines {
    /// Plans transforms of lines of `samples`.
    pub fn new(samples: usize) -> Self {
        Self {
            samples,
            fft: Fft::new(samples.next_power_of_two()),
        }
    }

    /// Envelopes: magnitudes of the analytic signals, in which the negative half of the spectrum is removed (the
    /// Hilbert transform by S. L. Marple, IEEE Transactions on Signal Processing 47, 1999).
    pub fn envelope(&self, lines: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; lines.len()];
        let length = self.fft.length();
        let buffers = || (vec![Complex32::default(); length], self.fft.scratch());
        let rows = (chunks_mut(&mut out, self.samples), chunks(lines, self.samples));
        for_each_init(rows, &buffers, &|(buffer, scratch), (out, line)| {
            buffer.fill(Complex32::default());
            buffer.iter_mut().zip(line).for_each(|(to, from)| to.re = *from);
            self.fft.forward_with(buffer, scratch);
            let half = length / 2;
            let scale = 1.0 / length as f32;
            buffer[0] *= scale;
            buffer[half] *= scale;
            buffer[1..half].iter_mut().for_each(|value| *value *= 2.0 * scale);
            buffer[half + 1..].fill(Complex32::default());
            self.fft.inverse_with(buffer, scratch);
            out.iter_mut().zip(&*buffer).for_each(|(to, from)| *to = from.norm());
        });
        out
    }
}

/// Half length of the interpolation kernels, samples.
const HALF: usize = 16;
/// Shape of their Kaiser window: stop band -80 dB, pass band to 0.84 of half the sampling rate.
const KAISER: f64 = 8.0;

/// Interpolation kernels at each fraction of a sample, for samples `HALF - 1` before to `HALF` behind: windowed sinc
/// functions.
fn kernels(upsampling: usize) -> Vec<[f32; 2 * HALF]> {
    let weight = |fraction: f64, tap: usize| {
        let away = fraction + (HALF - 1) as f64 - tap as f64;
        let window = bessel_i0(KAISER * (1.0 - (away / HALF as f64).powi(2)).max(0.0).sqrt()) / bessel_i0(KAISER);
        (PI * away).sin() / (PI * away) * window
    };
    let kernel = |phase: usize| {
        let weights: [f64; 2 * HALF] = std::array::from_fn(|tap| weight(phase as f64 / upsampling as f64, tap));
        // Constants stay constant.
        let sum: f64 = weights.iter().sum();
        weights.map(|weight| (weight / sum) as f32)
    };
    (1..upsampling).map(kernel).collect()
}

/// Modified Bessel function of the first kind and order 0, by its series.
fn bessel_i0(x: f64) -> f64 {
    let terms = (1..60).scan(1.0, |term, k| {
        *term *= (x / 2.0 / f64::from(k)).powi(2);
        Some(*term)
    });
    1.0 + terms.sum::<f64>()
}

/// Lines of `samples` upsampled by a factor: the samples themselves and band-limited values between them. Beyond its
/// ends a line keeps its end values.
pub fn upsampled(lines: &[f32], samples: usize, upsampling: usize) -> Vec<f32> {
    let kernels = kernels(upsampling);
    let mut out = vec![0.0; lines.len() * upsampling];
    let buffer = || vec![0.0; samples + 2 * HALF + LANES];
    let rows = (chunks_mut(&mut out, samples * upsampling), chunks(lines, samples));
    for_each_init(rows, &buffer, &|padded, (out, line)| {
        padded[..HALF - 1].fill(line[0]);
        padded[HALF - 1..HALF - 1 + samples].copy_from_slice(line);
        padded[HALF - 1 + samples..].fill(line[samples - 1]);
        vectorised(Between {
            padded,
            kernels: &kernels,
            out,
        });
    });
    out
}

/// Samples interpolated together.
const LANES: usize = 32;

struct Between<'a> {
    padded: &'a [f32],
    kernels: &'a [[f32; 2 * HALF]],
    out: &'a mut [f32],
}

impl Kernel for Between<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let upsampling = self.kernels.len() + 1;
        for (block, out) in self.out.chunks_mut(LANES * upsampling).enumerate() {
            let from = &self.padded[block * LANES..];
            let count = out.len() / upsampling;
            for sample in 0..count {
                out[sample * upsampling] = from[HALF - 1 + sample];
            }
            for (phase, kernel) in self.kernels.iter().enumerate() {
                let mut sums = [0.0_f32; LANES];
                for (values, weight) in from.windows(LANES).zip(kernel) {
                    for lane in 0..LANES {
                        sums[lane] += values[lane] * weight;
                    }
                }
                for sample in 0..count {
                    out[sample * upsampling + phase + 1] = sums[sample];
                }
            }
        }
    }
}
