//! Automatic gain: frame-by-frame equivalent of a scanner's one-touch time-gain compensation.
//!
//! The depth of the image is divided into [`BANDS`], as by the sliders of a scanner. In each band the level of tissue
//! is measured over all scanlines, and a fraction of its deviation from the usual one is removed; between the centres
//! of bands the gain is interpolated linearly. (Zones of depth and the mean of what is tissue in them: US patent
//! 5,579,768, 1996; masks of what is tissue: R. Moshavegh et al., Proc. SPIE 9419 (2015) 941904.)
//!
//! The level is a weighted mean of amplitudes: the weight is 0 below `ZERO_WEIGHT`, so that fluid and shadows do not
//! count and are not amplified, rises to 1 at `FULL_WEIGHT`, and amplitudes above [`MAX`] are clamped. A prior of
//! usual tissue replaces missing echoes, so that the gain never exceeds 12.6 dB. Weight times amplitude is a continuous
//! function of the amplitude with a slope of at most 2.5, and the divisor is never near 0: a small error of the echoes
//! causes a small one of the gain, which a percentile of a histogram does not guarantee.
//!
//! Only samples above the first bone, gas or lung of a scanline are measured: below are repeats and haze, not tissue.
//!
//! Noise is never amplified above `NOISE_GREY`.

use std::ops::Range;

use super::{MID_GREY, NOISE_GREY, Tone};
use crate::effects::pass::View;
use crate::effects::shadow::{finds_reflectors, reverberation};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::for_each;
use insonify_base::real::Real;
use insonify_base::simd::Kernel;

/// Number of bands of depth.
pub const BANDS: usize = 16;
/// Usual level of tissue after compensation, dB relative to the echo of liver: median of the bands of frames of livers,
/// kidneys and the abdomen phantom behind a body wall, which attenuates more than the average tissue that is
/// compensated for.
pub(crate) const USUAL_DB: f64 = -5.0;
/// Amplitude up to which echoes do not count, relative to usual tissue: -20 dB.
pub(crate) const ZERO_WEIGHT: f64 = 0.1;
/// Amplitude from which echoes count fully, relative to usual tissue.
pub(crate) const FULL_WEIGHT: f64 = 0.3;
/// Amplitude to which larger ones are clamped, relative to usual tissue: 24 dB.
pub const MAX: f64 = 16.0;
/// Weight of the prior of usual tissue, relative to the number of samples of the band.
pub(crate) const PRIOR: f64 = 0.03;
/// Samples in the first 1/64 of the depth do not count, because the array rings there.
const NEAR: usize = 64;

/// Parameters of automatic gain in a scene.
#[derive(Clone, Copy, Debug)]
pub struct AutoGain {
    /// Factor on the amplitude after gain that maps usual tissue to 1.
    pub scale: f64,
    /// Fraction of the deviation that is removed.
    pub share: f64,
    /// Gain at which noise is shown at `NOISE_GREY`, octaves; large if there is no noise.
    pub ceiling: f64,
}

impl AutoGain {
    /// Parameters of the scene; `None` without automatic gain.
    pub fn of(tables: &Tables) -> Option<Self> {
        let effects = &tables.settings.effects;
        let tone = effects.tone.as_ref().filter(|tone| tone.auto_gain > 0.0)?;
        let noise_db = effects.receiver.as_ref().map_or(-1000.0, |receiver| receiver.noise_db);
        Some(Self {
            scale: 10f64.powf(-(tone.gain_db + USUAL_DB) / 20.0),
            share: tone.auto_gain,
            ceiling: ((NOISE_GREY - MID_GREY) * tone.dynamic_range_db - noise_db) / Tone::DB_PER_OCTAVE,
        })
    }
}

/// First sample of each scanline that does not count, from the labels of the samples; empty where all count.
pub fn tops(tables: &Tables, labels: &[u8]) -> Vec<u32> {
    if finds_reflectors(tables) {
        reverberation::tops(tables, labels)
    } else {
        Vec::new()
    }
}

/// Range of the samples of a band that count.
pub fn range(band: usize, samples: usize) -> Range<usize> {
    let end = (band + 1) * samples / BANDS;
    (band * samples / BANDS).max(samples / NEAR).min(end)..end
}

/// Sample at the centre of a band.
pub fn middle(band: usize, samples: usize) -> usize {
    ((2 * band + 1) * samples / (2 * BANDS)).min(samples - 1)
}

/// Automatic gain of each band, octaves. `amplitude` is that of the echoes before gain, scanline by scanline; those from
/// the samples `tops` on do not count.
pub fn gains<T: Real>(parameters: &AutoGain, gain: &[T], amplitude: &[T], tops: &[u32]) -> [T; BANDS] {
    let samples = gain.len();
    let mut octaves = [T::zero(); BANDS];
    for_each((0.., &mut octaves[..]), &|(band, octaves)| {
        let range = range(band, samples);
        let count = (amplitude.len() / samples * range.len()) as f64;
        let prior = T::of(PRIOR) * T::of(count + 1.0);
        let [weight, value] = T::vectorised(Sums {
            amplitude,
            tops,
            gain,
            range,
            scale: T::of(parameters.scale),
        });
        let level = (value + prior) / (weight + prior);
        let room = (T::of(parameters.ceiling) - gain[middle(band, samples)].log2()).max(T::zero());
        *octaves = (-T::of(parameters.share) * level.log2()).min(room);
    });
    octaves
}

/// Automatic gain at a sample, octaves: interpolated between the centres of the bands.
pub fn at<T: Real>(octaves: &[T; BANDS], sample: usize, samples: usize) -> T {
    let half = T::of(0.5);
    let position =
        (T::from_signed(sample as i32) + half) * (T::of(BANDS as f64) / T::from_signed(samples as i32)) - half;
    let position = position.max(T::zero()).min(T::of((BANDS - 1) as f64));
    let band = (position.truncate() as usize).min(BANDS - 2);
    octaves[band] + (position - T::from_signed(band as i32)) * (octaves[band + 1] - octaves[band])
}

/// Number of samples processed together.
const BLOCK: usize = 64;

/// Sum of the weights of a band, and of weights times amplitudes.
struct Sums<'a, T> {
    amplitude: &'a [T],
    /// First samples of the scanlines that do not count; none if empty.
    tops: &'a [u32],
    gain: &'a [T],
    range: Range<usize>,
    scale: T,
}

impl<T: Real> Kernel for Sums<'_, T> {
    type Output = [T; 2];

    #[inline(always)]
    fn run(self) -> [T; 2] {
        let (zero, largest) = (T::of(ZERO_WEIGHT), T::of(MAX));
        let rise = T::of(1.0 / (FULL_WEIGHT - ZERO_WEIGHT));
        let mut sums = [T::zero(); 2];
        for start in self.range.clone().step_by(BLOCK) {
            let block = start..(start + BLOCK).min(self.range.end);
            let gain = &self.gain[block.clone()];
            let mut columns = [[T::zero(); BLOCK]; 2];
            for (number, line) in self.amplitude.chunks_exact(self.gain.len()).enumerate() {
                let top = self.tops.get(number).map_or(block.end, |top| *top as usize);
                let line = &line[block.start..top.clamp(block.start, block.end)];
                for i in 0..line.len() {
                    let echo = line[i] * gain[i] * self.scale;
                    let weight = ((echo - zero) * rise).max(T::zero()).min(T::one());
                    columns[0][i] += weight;
                    columns[1][i] += weight * echo.min(largest);
                }
            }
            for (sum, column) in sums.iter_mut().zip(&columns) {
                *sum = column.iter().fold(*sum, |sum, &x| sum + x);
            }
        }
        sums
    }
}

pub(super) fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let Some(parameters) = AutoGain::of(tables) else { return };
    let samples = tables.samples();
    let octaves = gains(
        &parameters,
        tables.effects.tone.gain.of::<T>(),
        &store.amplitude[..tables.lines() * samples],
        &store.effects.shadow.reflectors,
    );
    for (sample, gain) in store.effects.tone.auto_gain.iter_mut().enumerate() {
        *gain = at(&octaves, sample, samples);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const OWN: AutoGain = AutoGain {
        scale: 1.0,
        share: 0.75,
        ceiling: 100.0,
    };

    /// Gains over 8 scanlines of 160 samples whose amplitudes are a function of scanline and sample.
    fn of(parameters: &AutoGain, echo: impl Fn(usize, usize) -> f64) -> [f64; BANDS] {
        let amplitude: Vec<f64> = (0..8 * 160).map(|at| echo(at / 160, at % 160)).collect();
        gains(parameters, &[1.0; 160], &amplitude, &[])
    }

    #[test]
    fn a_share_of_the_departure_is_taken_out() {
        for level in [0.4, 1.0, 3.0, 15.0] {
            // The prior of usual tissue reduces the gain a little.
            let mean = (level + PRIOR) / (1.0 + PRIOR);
            for octaves in of(&OWN, |_, _| level) {
                assert!((octaves + 0.75 * mean.log2()).abs() < 0.01, "{level}: {octaves}");
            }
        }
        // Bands are independent, and amplitudes above 24 dB are clamped.
        let octaves = of(&OWN, |_, sample| if sample < 80 { 1.0 } else { 1e6 });
        assert!(
            octaves[7].abs() < 1e-9 && (octaves[8] + 0.75 * 16f64.log2()).abs() < 0.1,
            "{octaves:?}"
        );
    }

    #[test]
    fn fluid_shadow_and_nothing_are_left_alone() {
        for level in [0.0, 1e-6, 0.1] {
            assert_eq!(of(&OWN, |_, _| level), [0.0; BANDS]);
        }
        // Half of the scanlines in fluid: the gain is that of the tissue beside it.
        let octaves = of(&OWN, |line, _| if line < 4 { 4.0 } else { 0.05 });
        assert!(octaves.iter().all(|x| (x + 1.5).abs() < 0.1), "{octaves:?}");
    }

    /// Tissue at four times the usual level above dim repeats: bands of tissue are lowered, those below it unchanged.
    #[test]
    fn nothing_behind_an_opaque_surface_is_measured() {
        let amplitude: Vec<f64> = (0..8 * 160).map(|at| if at % 160 < 80 { 4.0 } else { 0.4 }).collect();
        let octaves = gains(&OWN, &[1.0; 160], &amplitude, &[80; 8]);
        for (band, octaves) in octaves.iter().enumerate() {
            let expected = if band < 8 { -1.5 } else { 0.0 };
            assert!((octaves - expected).abs() < 0.1, "band {band}: {octaves}");
        }
        assert!(gains(&OWN, &[1.0; 160], &amplitude, &[])[12] > 0.5);
    }

    #[test]
    fn noise_is_not_lifted() {
        let parameters = AutoGain { ceiling: 0.5, ..OWN };
        let echo = |_: usize, _: usize| 0.35;
        let free = of(&OWN, echo)[3];
        assert!(free > 1.0 && of(&parameters, echo) == [0.5; BANDS]);
        assert_eq!(of(&AutoGain { ceiling: -3.0, ..OWN }, echo), [0.0; BANDS]);
    }

    #[test]
    fn gain_runs_straight_between_the_middles() {
        let octaves: [f64; BANDS] = std::array::from_fn(|band| band as f64);
        for sample in 0..160 {
            let expected = ((sample as f64 + 0.5) / 10.0 - 0.5).clamp(0.0, 15.0);
            assert!((at(&octaves, sample, 160) - expected).abs() < 1e-12);
        }
        for samples in [1, 5, 17, 16_384] {
            let counted: usize = (0..BANDS).map(|band| range(band, samples).len()).sum();
            assert_eq!(counted, samples - samples / NEAR);
            assert!((0..BANDS).all(|band| middle(band, samples) < samples));
        }
    }
}
