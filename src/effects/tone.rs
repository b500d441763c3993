//! Tone: gain, time-gain compensation and log compression to grey levels.
//!
//! An echo of amplitude 1 (the mean power of normal liver) at gain 0 is shown at [`MID_GREY`] of the grey scale, and the
//! dynamic range spans the scale. Without a tone curve the grey level is 255 times the amplitude.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pass::{Access::*, Band, ParamBlock, Pass, Resource::*, View, groups};
use super::{Effect, OutOfRange, Verdict, within};
use crate::real::Real;
use crate::synth::store::Store;
use crate::synth::tables::Tables;

/// Share of the grey scale at which an echo of 0 dB is shown: the phantom frames among real B-mode data have their mean
/// grey level at 91 to 150 of 255.
pub const MID_GREY: f64 = 0.42;

/// Share of the grey scale that noise may reach by the compensation a scene does not state.
pub const NOISE_GREY: f64 = 0.1;

/// From echo amplitude to grey level.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Tone {
    /// Overall gain, dB (-60 to 60).
    pub gain_db: f64,
    /// Time-gain compensation, dB per cm of depth (-20 to 20); none matches the attenuation of average soft tissue when
    /// the scene simulates attenuation, down to where the receiver's noise would show.
    pub tgc_db_cm: Option<f64>,
    /// Further time-gain compensation: points `[depth_mm, dB]` in rising depth, linear between, flat outside.
    pub tgc_points: Vec<[f64; 2]>,
    /// Dynamic range shown, dB (10 to 120).
    pub dynamic_range_db: f64,
    /// Exponent of the grey map (0.2 to 5); below 1 it lifts the dark greys.
    pub gamma: f64,
}

impl Default for Tone {
    fn default() -> Self {
        Self {
            gain_db: 4.0,
            tgc_db_cm: None,
            tgc_points: Vec::new(),
            dynamic_range_db: 60.0,
            gamma: 1.0,
        }
    }
}

/// One-way attenuation of average soft tissue, dB/cm/MHz, that scanners compensate for (Szabo, Diagnostic Ultrasound
/// Imaging, 2nd ed., 2014, appendix B).
pub const SOFT_TISSUE_DB_CM_MHZ: f64 = 0.5;

impl Tone {
    /// Checks the ranges.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        within("tone.gain_db", self.gain_db, -60.0..=60.0)?;
        within("tone.tgc_db_cm", self.tgc_db_cm.unwrap_or(0.0), -20.0..=20.0)?;
        within("tone.dynamic_range_db", self.dynamic_range_db, 10.0..=120.0)?;
        within("tone.gamma", self.gamma, 0.2..=5.0)?;
        for (at, point) in self.tgc_points.iter().enumerate() {
            within(&format!("tone.tgc_points[{at}][0]"), point[0], 0.0..=1000.0)?;
            within(&format!("tone.tgc_points[{at}][1]"), point[1], -100.0..=100.0)?;
            if at > 0 && point[0] <= self.tgc_points[at - 1][0] {
                return Err(OutOfRange {
                    key: format!("tone.tgc_points[{at}][0]"),
                    found: point[0].to_string(),
                    expected: format!("more than the depth before it, {}", self.tgc_points[at - 1][0]),
                });
            }
        }
        Ok(())
    }

    /// Gain at a depth, dB. `attenuation_db_cm` is what the compensation matches where none is given; it then ends where noise of
    /// `noise_db` would be shown at [`NOISE_GREY`].
    pub fn gain_at_db(&self, depth_mm: f64, attenuation_db_cm: f64, noise_db: Option<f64>) -> f64 {
        let compensation = self.tgc_db_cm.map_or_else(
            || {
                let shown_db = (NOISE_GREY - MID_GREY) * self.dynamic_range_db - self.gain_db;
                let most = noise_db.map_or(f64::INFINITY, |noise_db| (shown_db - noise_db).max(0.0));
                (attenuation_db_cm * depth_mm / 10.0).min(most)
            },
            |slope| slope * depth_mm / 10.0,
        );
        self.gain_db + compensation + self.curve_db(depth_mm)
    }

    fn curve_db(&self, depth_mm: f64) -> f64 {
        let after = self.tgc_points.partition_point(|point| point[0] <= depth_mm);
        match (
            after.checked_sub(1).map(|at| self.tgc_points[at]),
            self.tgc_points.get(after),
        ) {
            (Some([d0, g0]), Some([d1, g1])) => g0 + (g1 - g0) * (depth_mm - d0) / (d1 - d0),
            (Some([_, gain]), None) => gain,
            (None, Some([_, gain])) => *gain,
            (None, None) => 0.0,
        }
    }
}

/// Registration.
pub const EFFECT: Effect = Effect {
    name: "tone",
    wanted,
    passes: |_| PASSES,
};

static PASSES: &[Pass] = &[Pass {
    name: "tone",
    shader: concat!(
        include_str!("../../shaders/common/power.wgsl"),
        include_str!("../../shaders/tone.wgsl")
    ),
    entry: "main",
    bindings: &[(Gain, Read), (Amplitude, Write)],
    params,
    workgroups: |tables, _| [groups(tables.samples(), 64), tables.lines() as u32, 1],
    flips: false,
    cpu: run::<f32>,
    cpu_f64: run::<f64>,
}];

fn wanted(tables: &Tables) -> Verdict {
    Ok(match &tables.settings.effects.tone {
        Some(tone) => format!("echoes are log-compressed to {} dB", tone.dynamic_range_db),
        None => "the scene names no tone curve: grey is 255 times the amplitude".into(),
    })
}

/// Parameter block of `tone.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Params {
    /// Samples along a scanline.
    pub samples: u32,
    /// 1 to compress, 0 to show the amplitude linearly.
    pub compress: u32,
    /// Share of the grey scale per factor of two of amplitude.
    pub per_octave: f32,
    /// Share of the grey scale at amplitude 1.
    pub middle: f32,
    /// Exponent of the grey map.
    pub gamma: f32,
    /// Padding to a multiple of 16 bytes.
    pub unused: [u32; 3],
}

struct Curve<T> {
    compress: bool,
    per_octave: T,
    middle: T,
    gamma: T,
}

impl<T: Real> Curve<T> {
    fn new(tone: Option<&Tone>) -> Self {
        let range = tone.map_or(60.0, |tone| tone.dynamic_range_db);
        Self {
            compress: tone.is_some(),
            per_octave: T::of(20.0 * 2.0f64.log10() / range),
            middle: T::of(MID_GREY),
            gamma: T::of(tone.map_or(1.0, |tone| tone.gamma)),
        }
    }

    #[inline(always)]
    fn grey(&self, amplitude: T) -> T {
        let full = T::of(255.0);
        if !self.compress {
            return (amplitude * full).max(T::zero()).min(full);
        }
        // Below the smallest amplitude worth a logarithm everything is black.
        let share = self.middle + self.per_octave * amplitude.max(T::of(SMALLEST)).log2();
        let share = share.max(T::zero()).min(T::one());
        full * if self.gamma == T::one() {
            share
        } else {
            share.powf(self.gamma)
        }
    }
}

/// Amplitudes below this are black at any setting: -200 dB.
const SMALLEST: f64 = 1e-10;

fn params(view: &View, _: Band) -> ParamBlock {
    let curve = Curve::<f32>::new(view.tables.settings.effects.tone.as_ref());
    ParamBlock::of(&Params {
        samples: view.tables.samples() as u32,
        compress: u32::from(curve.compress),
        per_octave: curve.per_octave,
        middle: curve.middle,
        gamma: curve.gamma,
        unused: [0; 3],
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let curve = Curve::<T>::new(tables.settings.effects.tone.as_ref());
    let gain = tables.gain.of::<T>();
    store.amplitude[..tables.lines() * samples]
        .par_chunks_mut(samples)
        .for_each(|amplitudes| {
            for (amplitude, &gain) in amplitudes.iter_mut().zip(gain) {
                *amplitude = curve.grey(*amplitude * gain);
            }
        });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_ramp() {
        let curve = Curve::<f64>::new(Some(&Tone {
            dynamic_range_db: 50.0,
            ..Tone::default()
        }));
        for db in [-20.0, -10.0, 0.0, 5.0] {
            let grey = curve.grey(10f64.powf(db / 20.0));
            assert!(
                (grey - 255.0 * (MID_GREY + db / 50.0)).abs() < 1e-9,
                "{db} dB -> {grey}"
            );
        }
        assert_eq!(curve.grey(0.0), 0.0);
        assert_eq!(curve.grey(1e9), 255.0);
        assert_eq!(Curve::<f64>::new(None).grey(0.5), 127.5);
    }

    #[test]
    fn compensation_is_linear_between_points() {
        let tone = Tone {
            gain_db: 1.0,
            tgc_db_cm: Some(2.0),
            tgc_points: vec![[10.0, 0.0], [30.0, 4.0]],
            ..Tone::default()
        };
        assert_eq!(tone.gain_at_db(0.0, 9.0, Some(-70.0)), 1.0);
        assert_eq!(tone.gain_at_db(20.0, 9.0, None), 1.0 + 4.0 + 2.0);
        assert_eq!(tone.gain_at_db(50.0, 9.0, Some(-10.0)), 1.0 + 10.0 + 4.0);
    }

    #[test]
    fn compensation_ends_where_noise_would_show() {
        let tone = Tone::default();
        let noise = |depth: f64| {
            let shown = -60.0 + tone.gain_at_db(depth, 9.0, Some(-60.0));
            MID_GREY + shown / tone.dynamic_range_db
        };
        assert!((tone.gain_at_db(20.0, 9.0, Some(-60.0)) - 22.0).abs() < 1e-12);
        assert!(
            [60.0, 200.0]
                .iter()
                .all(|depth| (noise(*depth) - NOISE_GREY).abs() < 1e-12)
        );
        assert_eq!(tone.gain_at_db(100.0, 9.0, None), 94.0);
    }
}
