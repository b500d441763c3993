//! Echoes of a uniform random medium that moves in a known way, on which estimators of motion are tested.

use std::f64::consts::TAU;

use super::Acquisition;
use super::echoes::{Pulse, Scatterer, echoes};
use insonify_base::parallel::{self, for_each};
use insonify_base::random::{hash3, unit};

/// Standard deviation of the elevational profile, mm.
const ELEVATIONAL_MM: f64 = 0.535;
/// Standard deviation of the lateral profile, lines.
const LATERAL: f64 = 3.0;
/// Distance between lines, mm: 256 lines over the 38 mm of an L12-5.
pub const PITCH_MM: f64 = 0.1484;
/// Lines beyond the array, on either side, whose scatterers are kept.
const ASIDE: f64 = 12.0;

/// A medium of ten scatterers in a resolution cell of 0.23 x 1.05 x 1.26 mm, seen by a linear array.
#[derive(Clone, Copy, Debug)]
pub struct Medium {
    /// Receiver and pulse.
    pub acquisition: Acquisition,
    /// Number of lines.
    pub lines: usize,
    /// Number of samples of a line.
    pub samples: usize,
    /// Reach of the medium before the array, mm: tissue that comes into the image when the medium moves away.
    pub before_mm: f64,
}

fn random(item: i32, stream: i32) -> f64 {
    f64::from(unit(hash3([item, stream, 31], [8, 9])[0]))
}

fn normal(item: i32, stream: i32) -> f64 {
    (-2.0 * (1.0 - random(item, stream)).ln()).sqrt() * (TAU * random(item, stream + 1000)).cos()
}

impl Medium {
    /// Medium under 5 MHz, sampled at 40 MHz, with noise 30 dB below its echoes.
    pub fn new(lines: usize, samples: usize) -> Self {
        Self {
            acquisition: Acquisition {
                snr_db: 30.0,
                ..Acquisition::new(5.0)
            },
            lines,
            samples,
            before_mm: 1.0,
        }
    }

    /// Scatterers of the medium displaced (mm away from the array, and towards the marked side) by a function of depth.
    pub fn scatterers(&self, moved: impl Fn(f64) -> [f64; 2] + Sync) -> Vec<Scatterer> {
        self.displaced(|z, _| moved(z))
    }

    /// Scatterers displaced by a function of depth and of the distance from the first line, mm.
    fn displaced(&self, moved: impl Fn(f64, f64) -> [f64; 2] + Sync) -> Vec<Scatterer> {
        let sample_mm = self.acquisition.sample_mm();
        let length_mm = self.samples as f64 * sample_mm + self.before_mm + 1.0;
        let lines = self.lines as f64 + 2.0 * ASIDE;
        let count = (33.0 * length_mm * 3.2 * lines * PITCH_MM) as usize;
        let scatterer = |item: usize| {
            let item = item as i32;
            let z = random(item, 1) * length_mm - self.before_mm;
            let line = random(item, 2) * lines - ASIDE;
            let beyond = (random(item, 3) - 0.5) * 3.2 / ELEVATIONAL_MM;
            let [axial, lateral] = moved(z, line * PITCH_MM);
            Scatterer {
                line: (line + lateral / PITCH_MM) as f32,
                sample: (z + axial) / sample_mm,
                amplitude: (normal(item, 4).signum() * (-0.5 * beyond * beyond).exp()) as f32,
                sigma: LATERAL as f32,
                centre: 1.0,
            }
        };
        parallel::map(0..count, &scatterer)
    }

    /// Echoes of beads in the image plane, at places beyond the array and from the first line (mm), without noise.
    pub fn beads(&self, places_mm: &[[f64; 2]], amplitude: f32) -> Vec<f32> {
        let bead = |[z, x]: &[f64; 2]| Scatterer {
            line: (x / PITCH_MM) as f32,
            sample: z / self.acquisition.sample_mm(),
            amplitude,
            sigma: LATERAL as f32,
            centre: 1.0,
        };
        let mut beads: Vec<Scatterer> = places_mm.iter().map(bead).collect();
        echoes(
            &mut beads,
            &Pulse::new(&self.acquisition, 1.0),
            self.lines,
            self.samples,
        )
    }

    /// Echoes of the medium displaced by a function of depth, with the noise of a number.
    pub fn frame(&self, noise: i32, moved: impl Fn(f64) -> [f64; 2] + Sync) -> Vec<f32> {
        self.frame_in_plane(noise, |z, _| moved(z))
    }

    /// Echoes of the medium displaced by a function of depth and of the distance from the first line, mm, with the
    /// noise of a number.
    pub fn frame_in_plane(&self, noise: i32, moved: impl Fn(f64, f64) -> [f64; 2] + Sync) -> Vec<f32> {
        let mut scatterers = self.displaced(moved);
        let mut samples: Vec<f32> = echoes(
            &mut scatterers,
            &Pulse::new(&self.acquisition, 1.0),
            self.lines,
            self.samples,
        );
        let rms = (samples.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>() / samples.len() as f64).sqrt();
        let level = rms * 10_f64.powf(-self.acquisition.snr_db / 20.0);
        for_each((0.., &mut samples[..]), &|(index, value)| {
            *value += (level * normal(index as i32, 50 + noise)) as f32
        });
        samples
    }
}
