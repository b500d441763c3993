//! Discrete Fourier transforms of complex numbers in single precision.

use std::sync::Arc;

use rustfft::FftPlanner;
pub use rustfft::num_complex::Complex32;

/// Transforms of one length, forward and inverse.
pub struct Fft {
    forward: Arc<dyn rustfft::Fft<f32>>,
    inverse: Arc<dyn rustfft::Fft<f32>>,
}

impl Fft {
    /// Plans transforms of `length` numbers.
    pub fn new(length: usize) -> Self {
        let mut planner = FftPlanner::new();
        Self {
            forward: planner.plan_fft_forward(length),
            inverse: planner.plan_fft_inverse(length),
        }
    }

    /// Number of complex numbers that a transform takes.
    pub fn length(&self) -> usize {
        self.forward.len()
    }

    /// Working memory for [`forward_with`](Self::forward_with) and [`inverse_with`](Self::inverse_with).
    pub fn scratch(&self) -> Vec<Complex32> {
        let [forward, inverse] = [&self.forward, &self.inverse].map(|fft| fft.get_inplace_scratch_len());
        vec![Complex32::default(); forward.max(inverse)]
    }

    /// Replaces each run of [`length`](Self::length) numbers x by X(k) = sum over n of x(n) exp(-2 pi i k n / length).
    /// Allocates nothing.
    pub fn forward_with(&self, buffer: &mut [Complex32], scratch: &mut [Complex32]) {
        self.forward.process_with_scratch(buffer, scratch);
    }

    /// Replaces each run of [`length`](Self::length) numbers X by x(n) = sum over k of X(k) exp(2 pi i k n / length),
    /// `length` times the inverse of [`forward_with`](Self::forward_with). Allocates nothing.
    pub fn inverse_with(&self, buffer: &mut [Complex32], scratch: &mut [Complex32]) {
        self.inverse.process_with_scratch(buffer, scratch);
    }

    /// [`forward_with`](Self::forward_with) with working memory of its own.
    pub fn forward(&self, buffer: &mut [Complex32]) {
        self.forward_with(buffer, &mut self.scratch());
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn transforms_are_the_sums_that_define_them() {
        // Powers of two, products of small primes, primes.
        for length in [1, 2, 3, 8, 12, 37, 60, 128, 251] {
            let fft = Fft::new(length);
            assert_eq!(fft.length(), length);
            let value = |at: usize| Complex32::new((at as f32 * 0.7).sin(), (at * at % 7) as f32 - 3.0);
            // Two runs, transformed each by itself.
            let values: Vec<Complex32> = (0..2 * length).map(value).collect();
            let sum = |k: usize, sign: f64| {
                let run = &values[k / length * length..][..length];
                let terms = run.iter().enumerate().map(|(n, value)| {
                    let (sin, cos) = (sign * TAU * ((k % length * n) % length) as f64 / length as f64).sin_cos();
                    let [re, im] = [f64::from(value.re), f64::from(value.im)];
                    [re * cos - im * sin, re * sin + im * cos]
                });
                terms.fold([0.0; 2], |sum, term| [sum[0] + term[0], sum[1] + term[1]])
            };
            let mut scratch = fft.scratch();
            let mut forward = values.clone();
            fft.forward_with(&mut forward, &mut scratch);
            let mut inverse = values.clone();
            fft.inverse_with(&mut inverse, &mut scratch);
            for (spectrum, sign) in [(&forward, -1.0), (&inverse, 1.0)] {
                for (k, value) in spectrum.iter().enumerate() {
                    let [re, im] = sum(k, sign);
                    let off = (f64::from(value.re) - re).hypot(f64::from(value.im) - im);
                    assert!(off < 2e-6 * length as f64, "length {length}, {k}: off by {off}");
                }
            }
            let mut alone = values.clone();
            fft.forward(&mut alone);
            assert_eq!(alone, forward);
        }
    }
}
