//! Tone: gain, time-gain compensation and log compression to grey levels.
//!
//! An echo of amplitude 1 (the mean power of normal liver) at gain 0 is shown at [`MID_GREY`] (0.42) of the grey scale,
//! and the dynamic range spans the scale. Automatic gain (`auto_gain`) equalises the level of tissue over depth, and an
//! S-shaped curve darkens the lower half of the scale and brightens the upper one. Without a tone the grey level is 255
//! times the amplitude.
//!
//! ```toml
//! effects.tone = { gain_db = 8.0 }
//! ```

pub mod auto_gain;
#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::buffers::{AMPLITUDE, Buffer, bytes_of, columns};
use super::pass::{
    Band, Grid, ParamBlock, Pass,
    Use::{self, *},
    View, block, bound, reference,
};
use super::shadow::{Attenuation, REFLECTORS, finds_reflectors};
use super::{
    EVERY_FRAME, Effect, OutOfRange, Parameters, Stage,
    Wanted::{self, Yes},
};
use crate::synth::SynthError;
use crate::synth::store::Store;
use crate::synth::tables::{Anatomy, Settings, Tables};
use auto_gain::{AutoGain, BANDS};
use insonify_anatomy::acoustics::TissueTable;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::range::{check, parameters, within};
use insonify_base::real::{Numbers, Real};
use insonify_tracking::probe::BeamGrid;

/// Grey level of an echo of 0 dB, as a fraction of the scale: phantom frames among real B-mode data have a mean grey
/// level of 91 to 150 of 255.
pub const MID_GREY: f64 = 0.42;

/// Largest grey level of noise under the default compensation, as a fraction of the scale.
pub(crate) const NOISE_GREY: f64 = 0.1;

/// Blend of the S-shaped curve from a straight line (0) to the cubic 3 g^2 - 2 g^3 (1): it deviates from the line by at
/// most 0.06 of the scale. In-vivo frames have a median grey of 18 to 24 and a skewness of 1.0 to 2.2; with a straight
/// line synthetic frames had 40 to 100 and 0.
const S_BEND: f64 = 0.6;

/// Curve from fraction of the dynamic range to fraction of the grey scale.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Curve {
    /// A straight line.
    Linear,
    /// An S: dark greys are darkened, bright ones brightened.
    #[default]
    S,
}

parameters! {
    /// Mapping from echo amplitude to grey level.
    pub struct Tone {
        /// Overall gain, dB.
        gain_db: f64 = 0.0, in -60..=60;
        /// Time-gain compensation, dB per cm of depth; without it, compensation matches the attenuation of average soft
        /// tissue if the scene simulates attenuation, down to where the receiver's noise would show.
        tgc_db_cm: Option<f64>, in -20..=20;
        /// Further time-gain compensation: points `[depth_mm, dB]` in ascending depth (0 to 1000, and -100 to 100),
        /// linear between, constant outside.
        tgc_points: Vec<[f64; 2]>;
        /// Fraction of the deviation of tissue from its usual level that automatic gain removes at each depth, frame by
        /// frame.
        auto_gain: f64 = 0.8, in 0..=1;
        /// Displayed dynamic range, dB.
        dynamic_range_db: f64 = 60.0, in 10..=120;
        /// Shape of the grey map.
        curve: Curve;
        /// Exponent of the grey map after the curve; below 1 it lifts the dark greys.
        gamma: f64 = 1.0, in 0.2..=5;
    }
}

impl Parameters for Tone {
    fn check_others(&self) -> Result<(), OutOfRange> {
        for (index, &[depth, gain]) in self.tgc_points.iter().enumerate() {
            let key = |axis: usize| format!("tgc_points[{index}][{axis}]");
            within(&key(0), depth, 0.0..=1000.0)?;
            within(&key(1), gain, -100.0..=100.0)?;
            let before = index
                .checked_sub(1)
                .map_or(f64::NEG_INFINITY, |before| self.tgc_points[before][0]);
            let expected = format!("more than the depth before it, {before}");
            check(&key(0), depth, depth > before, expected)?;
        }
        Ok(())
    }
}

impl Tone {
    /// Decibels per factor of two in amplitude.
    pub const DB_PER_OCTAVE: f64 = 20.0 * std::f64::consts::LOG10_2;

    /// Plain log compression: no automatic gain, grey levels linear in decibels.
    pub fn linear() -> Self {
        Self {
            auto_gain: 0.0,
            curve: Curve::Linear,
            ..Self::default()
        }
    }

    /// Fraction of the grey scale at a fraction of the dynamic range.
    pub fn shown(&self, share: f64) -> f64 {
        GreyMap::new(Some(self)).bent(share.clamp(0.0, 1.0)).powf(self.gamma)
    }

    /// Gain at a depth, dB. `lost_db` is the loss down to it that the default compensation matches; it then ends where
    /// noise of `noise_db` would be shown at `NOISE_GREY`.
    pub fn gain_at_db(&self, depth_mm: f64, lost_db: f64, noise_db: Option<f64>) -> f64 {
        let compensation = self.tgc_db_cm.map_or_else(
            || {
                let shown_db = (NOISE_GREY - MID_GREY) * self.dynamic_range_db - self.gain_db;
                let limit = noise_db.map_or(f64::INFINITY, |noise_db| (shown_db - noise_db).max(0.0));
                lost_db.min(limit)
            },
            |slope| slope * depth_mm / 10.0,
        );
        self.gain_db + compensation + self.curve_db(depth_mm)
    }

    /// Blend of the S-shaped curve, 0 to 1.
    pub fn bend(&self) -> f64 {
        match self.curve {
            Curve::Linear => 0.0,
            Curve::S => S_BEND,
        }
    }

    fn curve_db(&self, depth_mm: f64) -> f64 {
        let after = self.tgc_points.partition_point(|point| point[0] <= depth_mm);
        match (
            after.checked_sub(1).map(|index| self.tgc_points[index]),
            self.tgc_points.get(after),
        ) {
            (Some([d0, g0]), Some([d1, g1])) => g0 + (g1 - g0) * (depth_mm - d0) / (d1 - d0),
            (Some([_, gain]), None) => gain,
            (None, Some([_, gain])) => *gain,
            (None, None) => 0.0,
        }
    }
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "tone",
    stage: Stage::Display,
    example: "effects.tone = { gain_db = 8.0 }",
    wanted,
    passes: |tables| {
        if AutoGain::of(tables).is_none() {
            vec![&BY_HAND]
        } else if finds_reflectors(tables) {
            vec![&GAINS_ABOVE, &AUTOMATIC]
        } else {
            vec![&GAINS, &AUTOMATIC]
        }
    },
    buffers: &[&GAIN, &AUTO_GAIN],
    remove: Some(|_, settings| settings.effects.tone = None),
    needed_by: |tables, _| tables.settings.effects.tone.is_none().then_some(EVERY_FRAME),
    ..Effect::PLAIN
};

/// Tables of the tone.
#[derive(Clone, Debug)]
pub struct Derived {
    /// Linear gain at each sample depth.
    pub gain: Numbers,
}

/// Settings on which the gain depends.
#[derive(PartialEq)]
pub(crate) struct Key<'a> {
    tone: Option<&'a Tone>,
    attenuation: Attenuation,
    noise_db: Option<f64>,
    grid: &'a BeamGrid,
}

/// Takes parameters, the attenuation to compensate for, noise and grid.
pub(crate) fn key<'a>(_: &TissueTable, settings: &'a Settings, grid: &'a BeamGrid) -> Key<'a> {
    let receiver = settings.effects.receiver.as_ref();
    Key {
        tone: settings.effects.tone.as_ref(),
        attenuation: Attenuation::average(settings),
        noise_db: receiver.map(|receiver| receiver.noise_db),
        grid,
    }
}

/// Computes the gain.
pub(crate) fn derive(_: &Anatomy, key: &Key) -> Result<Derived, SynthError> {
    let &Key {
        tone,
        attenuation,
        noise_db,
        grid,
    } = key;
    let gain = |sample: usize| match tone {
        Some(tone) => {
            let depth_mm = grid.sample_depth_mm(sample);
            10f64.powf(tone.gain_at_db(depth_mm, attenuation.db_at(depth_mm), noise_db) / 20.0)
        }
        None => 1.0,
    };
    let gain = Numbers::new((0..grid.samples()).map(gain).collect());
    Ok(Derived { gain })
}

/// Per sample depth: linear gain (`f32`).
static GAIN: Buffer =
    Buffer::new(290, "Gain", 4, Tables::samples).derived(|_, derived| bytes_of(derived.tone.gain.of::<f32>()));

/// Per band of depth: automatic gain, octaves (`f32`).
static AUTO_GAIN: Buffer = Buffer::new(300, "AutoGain", 4, |_| BANDS);

columns! {
    /// Vectors of the tone.
    pub struct Columns<T> {
        /// Data of `AUTO_GAIN`, interpolated from the bands to each sample depth.
        auto_gain: [T; Tables::samples] = T::zero(), AUTO_GAIN;
    }
}

const BY_HAND: Pass = pass("tone", "by_hand", const { &[(&GAIN, Read), (&AMPLITUDE, WriteOwn)] });

const GAINS: Pass = gains_pass(
    "auto_gain",
    const { &[(&GAIN, Read), (&AMPLITUDE, Read), (&AUTO_GAIN, Write)] },
);

/// Gains of the bands, measured above bone, gas and lung.
const GAINS_ABOVE: Pass = gains_pass(
    "auto_gain_above",
    const {
        &[
            (&GAIN, Read),
            (&AMPLITUDE, Read),
            (&AUTO_GAIN, Write),
            (&REFLECTORS, Read),
        ]
    },
);

const fn gains_pass(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        grid: Grid::Workgroups(|_| [BANDS as u32, 1]),
        cpu: reference!(auto_gain::run),
        bound: bound!(Covered("by the bound of `tone`")),
        ..pass("tone_auto_gain", entry, bindings)
    }
}

const AUTOMATIC: Pass = pass(
    "tone",
    "automatic",
    const { &[(&GAIN, Read), (&AMPLITUDE, WriteOwn), (&AUTO_GAIN, Read)] },
);

const fn pass(name: &'static str, entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name,
        shader: include_str!("../../../shaders/tone.wgsl"),
        entry,
        bindings,
        params,
        grid: Grid::Samples,
        flips: false,
        cpu: reference!(run),
        bound: bound!(By(bound::carry)),
    }
}

fn wanted(tables: &Tables) -> Wanted {
    let Some(tone) = &tables.settings.effects.tone else {
        return Yes("without a tone curve grey is 255 times the amplitude".into());
    };
    let curve = match tone.curve {
        Curve::Linear => "",
        Curve::S => " on an S-shaped curve",
    };
    let gain = match tone.auto_gain {
        0.0 => String::new(),
        share => format!("; automatic gain removes {share} of the deviation from the usual tissue level"),
    };
    Yes(format!(
        "echoes are log-compressed to {} dB{curve}{gain}",
        tone.dynamic_range_db
    ))
}

block! {
    /// Parameter block of `tone.wgsl`.
    struct ToneParams {
        /// Samples along a scanline.
        samples: u32,
        /// Scanlines.
        lines: u32,
        /// 1 to compress, 0 to show the amplitude linearly.
        compress: u32,
        /// Fraction of the grey scale per factor of two of amplitude.
        per_octave: f32,
        /// Fraction of the grey scale at amplitude 1.
        middle: f32,
        /// Blend of the S-shaped curve, 0 to 1.
        bend: f32,
        /// Exponent of the grey map.
        gamma: f32,
        /// Amplitude factor, [`AutoGain::scale`].
        scale: f32,
        /// Corrected fraction of the deviation, [`AutoGain::share`].
        share: f32,
        /// Maximum gain, [`AutoGain::ceiling`].
        ceiling: f32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 2],
    }
}

struct GreyMap<T> {
    compress: bool,
    per_octave: T,
    middle: T,
    bend: T,
    gamma: T,
}

impl<T: Real> GreyMap<T> {
    fn new(tone: Option<&Tone>) -> Self {
        let range = tone.map_or(60.0, |tone| tone.dynamic_range_db);
        Self {
            compress: tone.is_some(),
            per_octave: T::of(Tone::DB_PER_OCTAVE / range),
            middle: T::of(MID_GREY),
            bend: T::of(tone.map_or(0.0, Tone::bend)),
            gamma: T::of(tone.map_or(1.0, |tone| tone.gamma)),
        }
    }

    /// Grey level of an amplitude after gain and a further gain in octaves.
    #[inline(always)]
    fn grey(&self, amplitude: T, octaves: T, power: impl Fn(T) -> T) -> T {
        let full = T::of(255.0);
        if !self.compress {
            return (amplitude * full).max(T::zero()).min(full);
        }
        // Below the smallest amplitude that is compressed everything is black.
        let share = self.middle + self.per_octave * (amplitude.max(T::of(SMALLEST)).log2() + octaves);
        full * power(self.bent(share.max(T::zero()).min(T::one())))
    }

    #[inline(always)]
    fn bent(&self, share: T) -> T {
        let one = T::one();
        // 3 g^2 - 2 g^3 lies g (1 - g) (1 - 2 g) below g.
        share - self.bend * (share * (one - share) * (one - (share + share)))
    }

    /// Converts a scanline to grey levels.
    #[inline(always)]
    fn show(&self, amplitudes: &mut [T], gain: &[T], automatic: &[T], power: impl Fn(T) -> T) {
        for (sample, (amplitude, &gain)) in amplitudes.iter_mut().zip(gain).enumerate() {
            let octaves = automatic.get(sample).copied().unwrap_or_default();
            *amplitude = self.grey(*amplitude * gain, octaves, &power);
        }
    }
}

/// Amplitudes below this are black at any setting: -200 dB.
const SMALLEST: f64 = 1e-10;

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let map = GreyMap::<f32>::new(tables.settings.effects.tone.as_ref());
    let automatic = AutoGain::of(tables);
    let automatic = |pick: fn(&AutoGain) -> f64| automatic.as_ref().map_or(0.0, pick) as f32;
    ParamBlock::of(&ToneParams {
        samples: tables.samples() as u32,
        lines: tables.lines() as u32,
        compress: u32::from(map.compress),
        per_octave: map.per_octave,
        middle: map.middle,
        bend: map.bend,
        gamma: map.gamma,
        scale: automatic(|gain| gain.scale),
        share: automatic(|gain| gain.share),
        ceiling: automatic(|gain| gain.ceiling),
        unused: [0; 2],
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let map = GreyMap::<T>::new(tables.settings.effects.tone.as_ref());
    let gain = tables.effects.tone.gain.of::<T>();
    let automatic = &store.effects.tone.auto_gain;
    let scanlines = chunks_mut(&mut store.amplitude[..tables.lines() * samples], samples);
    // Two loops: a single one would compute the power for every sample, needed or not.
    if map.gamma == T::one() {
        for_each(scanlines, &|line| map.show(line, gain, automatic, |share| share));
    } else {
        for_each(scanlines, &|line| {
            map.show(line, gain, automatic, |share| share.powf(map.gamma))
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_ramp() {
        let map = GreyMap::<f64>::new(Some(&Tone {
            dynamic_range_db: 50.0,
            ..Tone::linear()
        }));
        for db in [-20.0, -10.0, 0.0, 5.0] {
            let grey = map.grey(10f64.powf(db / 20.0), 0.0, |share| share);
            assert!(
                (grey - 255.0 * (MID_GREY + db / 50.0)).abs() < 1e-9,
                "{db} dB -> {grey}"
            );
        }
        assert_eq!(map.grey(0.0, 0.0, |share| share), 0.0);
        assert_eq!(map.grey(1e9, 0.0, |share| share), 255.0);
        assert_eq!(GreyMap::<f64>::new(None).grey(0.5, 0.0, |share| share), 127.5);
    }

    /// Point symmetry of the curve about the middle; an octave of gain is an octave of amplitude.
    #[test]
    fn the_s_is_odd_about_the_middle_and_gain_moves_along_it() {
        let tone = Tone::default();
        for share in [0.0, 0.1, 0.25, 0.4, 0.5] {
            let [low, high] = [share, 1.0 - share].map(|share| tone.shown(share));
            assert!(
                (low + high - 1.0).abs() < 1e-12 && low <= share,
                "{share}: {low}, {high}"
            );
        }
        assert!((0.25 - tone.shown(0.25) - 0.05625).abs() < 1e-12);
        let map = GreyMap::<f64>::new(Some(&tone));
        assert!((map.grey(0.25, 1.0, |share| share) - map.grey(0.5, 0.0, |share| share)).abs() < 1e-9);
        assert!(
            (map.grey(0.5, 0.0, |share| share) / 255.0 - tone.shown(MID_GREY - Tone::DB_PER_OCTAVE / 60.0)).abs()
                < 1e-12
        );
    }

    #[test]
    fn compensation_is_linear_between_points() {
        let tone = Tone {
            gain_db: 1.0,
            tgc_db_cm: Some(2.0),
            tgc_points: vec![[10.0, 0.0], [30.0, 4.0]],
            ..Tone::default()
        };
        assert_eq!(tone.gain_at_db(0.0, 0.0, Some(-70.0)), 1.0);
        assert_eq!(tone.gain_at_db(20.0, 18.0, None), 1.0 + 4.0 + 2.0);
        assert_eq!(tone.gain_at_db(50.0, 45.0, Some(-10.0)), 1.0 + 10.0 + 4.0);
    }

    #[test]
    fn compensation_ends_where_noise_would_show() {
        let tone = Tone {
            gain_db: 4.0,
            ..Tone::default()
        };
        let noise = |depth: f64| {
            let shown = -60.0 + tone.gain_at_db(depth, 0.9 * depth, Some(-60.0));
            MID_GREY + shown / tone.dynamic_range_db
        };
        assert!((tone.gain_at_db(20.0, 18.0, Some(-60.0)) - 22.0).abs() < 1e-12);
        assert!(
            [60.0, 200.0]
                .iter()
                .all(|depth| (noise(*depth) - NOISE_GREY).abs() < 1e-12)
        );
        assert_eq!(tone.gain_at_db(100.0, 90.0, None), 94.0);
    }
}
