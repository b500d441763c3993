//! Radio-frequency echoes: synthesis from point scatterers that move with the tissue, envelopes and B-mode frames, and
//! estimates of motion.

pub mod bmode;
pub mod device;
pub mod echoes;
pub mod fft;
pub mod file;
pub mod medium;
pub mod motion;
pub mod scatterers;
pub mod signal;
#[cfg(test)]
mod tests;
pub mod truth;

use serde::Serialize;

use insonify_base::range::{OutOfRange, within};

/// Speed of sound in soft tissue, m/s.
pub const SPEED_M_S: f64 = 1540.0;

/// Receiver and pulse.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Acquisition {
    /// Centre frequency, MHz (0.1 to 100).
    pub frequency_mhz: f64,
    /// Fractional bandwidth of the two-way pulse, full width at half maximum of its spectrum (0.05 to 2).
    pub bandwidth: f64,
    /// Sampling rate, MHz (more than twice the highest frequency of the pulse, at most 1000).
    pub sampling_mhz: f64,
    /// Ratio of the echoes of normal liver at the focus, without attenuation, to the electronic noise, dB (0 to 200).
    pub snr_db: f64,
    /// Scatterers per resolution cell (1 to 100); from some ten on, speckle is fully developed.
    pub per_cell: f64,
}

impl Acquisition {
    /// Pulse and receiver of R. Zahiri-Azar and S. E. Salcudean (2006) at a centre frequency: 8 samples a period, 60 %
    /// bandwidth.
    pub fn new(frequency_mhz: f64) -> Self {
        Self {
            frequency_mhz,
            bandwidth: 0.6,
            sampling_mhz: 8.0 * frequency_mhz,
            snr_db: 40.0,
            per_cell: 10.0,
        }
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`OutOfRange`].
    pub fn validate(&self) -> Result<(), OutOfRange> {
        within("frequency_mhz", self.frequency_mhz, 0.1..=100.0)?;
        within("bandwidth", self.bandwidth, 0.05..=2.0)?;
        let nyquist = 2.0 * self.frequency_mhz * (1.0 + self.bandwidth / 2.0);
        within("sampling_mhz", self.sampling_mhz, nyquist..=1000.0)?;
        within("snr_db", self.snr_db, 0.0..=200.0)?;
        within("per_cell", self.per_cell, 1.0..=100.0)
    }

    /// Distance between samples along a line, mm.
    pub fn sample_mm(&self) -> f64 {
        SPEED_M_S * 1e-3 / (2.0 * self.sampling_mhz)
    }

    /// Standard deviation of the envelope of the pulse, us.
    pub fn sigma_us(&self) -> f64 {
        // Half maximum of the spectrum exp(-(2 pi f s)^2 / 2) at half of the bandwidth.
        (2.0 * std::f64::consts::LN_2).sqrt() / (std::f64::consts::PI * self.bandwidth * self.frequency_mhz)
    }
}
