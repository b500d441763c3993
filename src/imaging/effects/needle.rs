//! Needle: echo of the shaft where it crosses the thickened scan plane (Zhu et al. 2007, section 2.3), and of seeds.
//!
//! The brightness of a sample is the fraction of the plane's thickness, by default the needle's diameter, that the
//! shaft fills there: the length of the elevational chord through the cylinder, in closed form, for every segment of a
//! bent shaft. The echo is strongest where the shaft is perpendicular to the beam and falls with a power of the sine of
//! the angle between them. Reverberation inside the shaft repeats the echo further down the beam. Grains along the
//! shaft make the line uneven, and the bevel at a needle's tip is brighter. Brachytherapy seeds are modelled as short
//! shafts.
//!
//! With speckle the echo is added to that of the scatterers before the point spread is applied; without, its modulus is
//! added to the amplitude.
//!
//! ```toml
//! needle = { tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }
//! effects.needle = {}
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;
mod segments;
mod shaft;

use super::buffers::{AMPLITUDE, Buffer, NEEDLE_MASK, RAYS, SPECULAR, columns};
use super::pass::{Band, Grid, ParamBlock, Pass, Use, Use::*, View, block, bound, reference};
use super::{
    Effect, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::random::seed_words;
use insonify_base::range::parameters;
use insonify_base::real::Real;

pub(crate) use segments::{MAX_SEGMENTS, view};
pub use segments::{Segment, left_out, segments};
pub use shaft::Shaft;

parameters! {
    /// Echo of the needle.
    pub struct NeedleEcho {
        /// Echo of a shaft in the plane and perpendicular to the beam, dB relative to liver.
        echo_db: f64 = 30.0, in -40..=80;
        /// Thickness of the scan plane for the needle, mm; without it the needle's diameter.
        thickness_mm: Option<f64>, in 0.05..=20;
        /// Exponent of the sine of the angle between shaft and beam.
        directivity: f64 = 4.0, in 0..=64;
        /// Number of repetitions of the echo below the shaft.
        reverberations: u32 = 3, in 0..=8;
        /// Distance between repetitions, mm.
        reverberation_mm: f64 = 1.6, in 0.1..=20;
        /// Loss from one repetition to the next, dB.
        reverberation_db: f64 = 9.0, in 0..=60;
        /// Diffuse fraction of the power of the echo: 0 is an even line; 0.2 has a standard deviation of 3 dB along it.
        roughness: f64 = 0.2, in 0..=1;
    }
}

impl Parameters for NeedleEcho {}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "needle",
    stage: Stage::Echoes,
    example: "needle = { tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }\neffects.needle = {}",
    wanted,
    passes: |tables| match tables.effects.speckle {
        Some(_) => vec![&BEFORE_SPECKLE],
        None => vec![&ALONE],
    },
    buffers: &[&NEEDLE],
    left_out,
    remove: Some(|_, settings| {
        settings.effects.needle = None;
        settings.has_needle = false;
    }),
    ..Effect::PLAIN
};

/// Segments of needle and seeds in the probe frame (`vec4<f32>` triples).
static NEEDLE: Buffer =
    Buffer::new(220, "Needle", size_of::<Segment<f32>>(), |_| MAX_SEGMENTS).per_frame(|tables, state, numbers| {
        numbers.clear();
        numbers.extend(segments(tables, state).flatten().flatten().map(|x| x as f32));
    });

columns! {
    /// Vectors of the needle.
    pub struct Columns {
        /// Data of `NEEDLE`.
        segments: [Segment<f64>; |_| MAX_SEGMENTS] = [[0.0; 4]; 3], NEEDLE;
    }
}

const ALONE: Pass = needle_pass(
    "main",
    const {
        &[
            (&RAYS, Read),
            (&NEEDLE, Read),
            (&NEEDLE_MASK, WriteOwn),
            (&AMPLITUDE, WriteOwn),
        ]
    },
);

const BEFORE_SPECKLE: Pass = needle_pass(
    "before_speckle",
    const {
        &[
            (&RAYS, Read),
            (&NEEDLE, Read),
            (&NEEDLE_MASK, WriteOwn),
            (&SPECULAR, WriteOwn),
        ]
    },
);

const fn needle_pass(entry: &'static str, bindings: &'static [(&'static Buffer, Use)]) -> Pass {
    Pass {
        name: "needle",
        shader: include_str!("../../../shaders/needle.wgsl"),
        entry,
        bindings,
        params,
        grid: Grid::Samples,
        flips: false,
        cpu: reference!(run),
        bound: bound!(By(bound::carry)),
    }
}

/// Correlation length of the grains along a shaft, mm.
pub(crate) const GRAIN_MM: f64 = 2.0;
/// Length of the brighter part of a needle from its tip, mm: that of a bevel.
pub const BEVEL_MM: f64 = 3.0;
/// Amplitude factor of the bevel: 6 dB.
pub const BEVEL: f64 = 2.0;

/// Whether the scene has a needle or seeds and shows them.
pub fn present(tables: &Tables) -> bool {
    tables.settings.effects.needle.is_some() && tables.settings.has_needle
}

fn wanted(tables: &Tables) -> Wanted {
    match (&tables.settings.effects.needle, tables.settings.has_needle) {
        (Some(_), true) => Yes("the scene has a needle or seeds".into()),
        (Some(_), false) => No("the scene has neither needle nor seeds".into()),
        (None, _) => No("the scene names no needle echo".into()),
    }
}

block! {
    /// Parameter block of `needle.wgsl`.
    pub(crate) struct NeedleParams {
        /// Samples along a scanline.
        pub(crate) samples: u32,
        /// Distance between samples, mm.
        pub(crate) sample_mm: f32,
        /// Number of segments of needle and seeds.
        pub(crate) segments: u32,
        /// Inverse width of the beam used for shadows, 1/mm.
        pub(crate) beams_per_mm: f32,
        /// Amplitude of the echo.
        pub(crate) echo: f32,
        /// Exponent of the sine of the angle between shaft and beam.
        pub(crate) directivity: f32,
        /// Number of repetitions.
        pub(crate) reverberations: u32,
        /// Distance between repetitions, mm.
        pub(crate) reverberation_mm: f32,
        /// Amplitude factor per repetition.
        pub(crate) reverberation: f32,
        /// Amplitude of the constant part.
        pub(crate) steady: f32,
        /// Amplitude of the diffuse part.
        pub(crate) diffuse: f32,
        /// 1 if surfaces have already written their echoes.
        pub(crate) after_surfaces: u32,
        /// Seed of the grains.
        pub(crate) seed: [u32; 2],
        /// Padding to a multiple of 16 bytes.
        pub(crate) unused: [u32; 2],
    }
}

/// Beam width below which any needle shades the beam fully, mm; also used for a single scanline, which has no
/// width.
const MIN_BEAM_MM: f64 = 1e-3;

fn numbers(view: &View) -> NeedleParams {
    let tables = view.tables;
    let needle = tables.settings.effects.needle.clone().unwrap_or_default();
    let shadow = &tables.settings.effects.shadow;
    NeedleParams {
        samples: tables.samples() as u32,
        sample_mm: tables.sample_mm() as f32,
        segments: segments(tables, view.state).count() as u32,
        beams_per_mm: shadow
            .as_ref()
            .map_or(0.0, |shadow| shadow.needle_beam_mm().max(MIN_BEAM_MM).recip()) as f32,
        echo: 10f64.powf(needle.echo_db / 20.0) as f32,
        directivity: needle.directivity as f32,
        reverberations: needle.reverberations,
        reverberation_mm: needle.reverberation_mm as f32,
        reverberation: 10f64.powf(-needle.reverberation_db / 20.0) as f32,
        steady: (1.0 - needle.roughness).sqrt() as f32,
        diffuse: needle.roughness.sqrt() as f32,
        after_surfaces: u32::from(tables.settings.effects.interface.is_some()),
        // A lattice different from that of the speckle.
        seed: seed_words(!tables.settings.seed),
        unused: [0; 2],
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    ParamBlock::of(&numbers(view))
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let numbers = numbers(view);
    store.effects.needle.segments.clear();
    store.effects.needle.segments.extend(segments(tables, view.state));
    let segments = &store.effects.needle.segments;
    let each = |ray: &[f64; 4], mask: &mut [[T; 2]], add: &mut dyn FnMut(usize, [T; 2])| {
        mask.fill([T::zero(); 2]);
        for &segment in segments {
            let shaft = Shaft::new(segment.map(|end| end.map(T::of)));
            shaft.scanline(ray.map(T::of), &numbers, mask, &mut *add);
        }
    };
    let masks = chunks_mut(&mut store.needle_mask, samples);
    if tables.effects.speckle.is_some() {
        let rows = (chunks_mut(&mut store.specular, samples), masks, &tables.rays[..]);
        for_each(rows, &|(out, mask, ray)| {
            // Surfaces have filled the row if there are any; otherwise it holds the last frame.
            if numbers.after_surfaces == 0 {
                out.fill([T::zero(); 2]);
            }
            each(ray, mask, &mut |i, [re, im]| {
                out[i][0] += re;
                out[i][1] += im;
            });
        });
    } else {
        let amplitude = &mut store.amplitude[..tables.lines() * samples];
        for_each((chunks_mut(amplitude, samples), masks, &tables.rays[..]), &|(
            out,
            mask,
            ray,
        )| {
            each(ray, mask, &mut |i, [re, im]| out[i] += (re * re + im * im).sqrt());
        });
    }
}
