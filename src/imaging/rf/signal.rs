//! Analytic signals and band-limited upsampling of lines.

use std::sync::Arc;

use rayon::prelude::*;
use rustfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

/// Transforms of lines of one length.
pub struct Lines {
    samples: usize,
    /// Length of the transform: the next power of two.
    length: usize,
    upsampling: usize,
    forward: Arc<dyn Fft<f32>>,
    inverse: Arc<dyn Fft<f32>>,
}

impl Lines {
    /// Plans transforms of lines of `samples`, upsampled by a factor.
    pub fn new(samples: usize, upsampling: usize) -> Self {
        let mut planner = FftPlanner::new();
        let length = samples.next_power_of_two();
        Self {
            samples,
            length,
            upsampling,
            forward: planner.plan_fft_forward(length),
            inverse: planner.plan_fft_inverse(length * upsampling),
        }
    }

    /// Analytic signal of each line, upsampled: the negative half of the spectrum is removed and the rest extended with zeros (the Hilbert
    /// transform by S. L. Marple, IEEE Transactions on Signal Processing 47, 1999).
    pub fn analytic(
        &self,
        lines: &[f32],
        each: impl Fn(&mut dyn Iterator<Item = Complex32>, &mut [f32]) + Sync,
    ) -> Vec<f32> {
        let mut out = vec![0.0; lines.len() * self.upsampling];
        let wide = self.samples * self.upsampling;
        out.par_chunks_mut(wide)
            .zip(lines.par_chunks(self.samples))
            .for_each_init(
                || {
                    (
                        vec![Complex32::default(); self.length * self.upsampling],
                        vec![Complex32::default(); self.length * self.upsampling],
                    )
                },
                |(buffer, scratch), (out, line)| {
                    buffer.fill(Complex32::default());
                    for (to, from) in buffer.iter_mut().zip(line) {
                        to.re = *from;
                    }
                    self.forward.process_with_scratch(&mut buffer[..self.length], scratch);
                    let half = self.length / 2;
                    let scale = 1.0 / self.length as f32;
                    buffer[0] *= scale;
                    buffer[half] *= scale;
                    buffer[1..half].iter_mut().for_each(|value| *value *= 2.0 * scale);
                    buffer[half + 1..].fill(Complex32::default());
                    self.inverse.process_with_scratch(buffer, scratch);
                    each(&mut buffer[..wide].iter().copied(), out);
                },
            );
        out
    }

    /// Upsampled lines.
    pub fn upsampled(&self, lines: &[f32]) -> Vec<f32> {
        self.analytic(lines, |from, to| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = from.re)
        })
    }

    /// Envelopes.
    pub fn envelope(&self, lines: &[f32]) -> Vec<f32> {
        self.analytic(lines, |from, to| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = from.norm())
        })
    }
}
