//! Shadow: what the way down a scanline leaves of an echo.
//!
//! Transmittance is a running product down each scanline, kept as a running sum of losses in fixed-point decibels, so
//! that it is the same at any grouping of the samples, on the CPU and in a parallel scan. A tissue takes its two-way
//! attenuation `2 alpha f` and, if it occludes as bone and gas do, its occlusion per millimetre; the needle takes
//! `needle_db_mm` where it fills the scan plane. A sample sees the loss of everything above it and half its own, so the
//! sum converges to Beer and Lambert's law with the square of the sample distance. Shadows of bone, air and the needle
//! shaft by casting rays: paper 1, section 2.4.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pass::{Access::*, Band, ParamBlock, Pass, Resource::*, View};
use super::{Effect, OutOfRange, Verdict, within};
use crate::real::Real;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use crate::tissue::Tissue;

/// Attenuation and shadows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Shadow {
    /// Whether tissues attenuate.
    pub attenuation: bool,
    /// Whether bone, gas and the like occlude.
    pub occlusion: bool,
    /// Two-way loss in the needle, dB per mm of it along the beam (0 to 100).
    pub needle_db_mm: f64,
}

impl Default for Shadow {
    fn default() -> Self {
        Self {
            attenuation: true,
            occlusion: true,
            needle_db_mm: 8.0,
        }
    }
}

/// Fixed-point units in one decibel.
pub const UNITS_PER_DB: f64 = 1_048_576.0;

/// Most that one sample may take, dB: two of them already exceed any dynamic range, and sums of two capped losses fit.
const MOST_PER_SAMPLE_DB: f64 = 256.0;

/// Where the running sum saturates: 2^31 - 1 units, 2,048 dB.
pub const MOST_UNITS: u32 = 0x7fff_ffff;

/// An occlusion of 1 per mm is not infinite but this, dB per mm.
const FULL_OCCLUSION_DB_MM: f64 = 200.0;

impl Shadow {
    /// Checks the ranges.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        within("shadow.needle_db_mm", self.needle_db_mm, 0.0..=100.0)
    }

    /// Two-way loss in a tissue, dB/mm, at a frequency in MHz.
    pub fn db_per_mm(&self, tissue: &Tissue, frequency_mhz: f64) -> f64 {
        let attenuation = 2.0 * tissue.attenuation_db_cm_mhz * frequency_mhz / 10.0;
        let occlusion = (-20.0 * (1.0 - tissue.occlusion_per_mm).log10()).min(FULL_OCCLUSION_DB_MM);
        f64::from(u8::from(self.attenuation)) * attenuation + f64::from(u8::from(self.occlusion)) * occlusion
    }
}

/// Loss over one sample in fixed-point units.
pub fn units(db: f64) -> u32 {
    (db.clamp(0.0, MOST_PER_SAMPLE_DB) * UNITS_PER_DB).round() as u32
}

/// Registration.
pub const EFFECT: Effect = Effect {
    name: "shadow",
    wanted,
    passes: |tables| {
        if super::needle::present(tables) {
            WITH_NEEDLE
        } else {
            WITHOUT_NEEDLE
        }
    },
};

static WITHOUT_NEEDLE: &[Pass] = &[Pass {
    name: "shadow",
    shader: concat!(
        include_str!("../../shaders/common/label_row.wgsl"),
        include_str!("../../shaders/shadow.wgsl")
    ),
    entry: "tissue",
    bindings: &[(Label, Read), (LabelRows, Read), (Amplitude, Write), (Loss, Write)],
    params,
    workgroups: |tables, _| [1, tables.lines() as u32, 1],
    flips: false,
    cpu: run::<f32>,
    cpu_f64: run::<f64>,
}];

static WITH_NEEDLE: &[Pass] = &[Pass {
    name: "shadow",
    shader: concat!(
        include_str!("../../shaders/common/label_row.wgsl"),
        include_str!("../../shaders/shadow.wgsl")
    ),
    entry: "tissue_and_needle",
    bindings: &[
        (Label, Read),
        (LabelRows, Read),
        (Amplitude, Write),
        (Loss, Write),
        (NeedleMask, Read),
    ],
    params,
    workgroups: |tables, _| [1, tables.lines() as u32, 1],
    flips: false,
    cpu: run::<f32>,
    cpu_f64: run::<f64>,
}];

fn wanted(tables: &Tables) -> Verdict {
    let Some(shadow) = &tables.settings.effects.shadow else {
        return Err("the scene names no shadow".into());
    };
    let losing = tables
        .label_rows
        .iter()
        .enumerate()
        .filter(|&(index, row)| row.loss > 0 && tables.volume.holds(index))
        .count();
    let needle = super::needle::present(tables) && shadow.needle_db_mm > 0.0;
    match (losing, needle) {
        (0, false) => Err("no tissue of the volume attenuates or occludes, and there is no needle".into()),
        (0, true) => Ok("the needle shades".into()),
        (n, true) => Ok(format!("{n} labels attenuate or occlude, and the needle shades")),
        (n, false) => Ok(format!("{n} labels attenuate or occlude")),
    }
}

/// Uniform block of `shadow.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Params {
    /// Samples along a scanline.
    pub samples: u32,
    /// Loss of a sample that the needle fills, units.
    pub needle_units: f32,
    /// Base-2 exponent of the amplitude per unit of loss; negative.
    pub exponent: f32,
    /// Padding to a multiple of 16 bytes.
    pub unused: u32,
}

fn params(view: &View, _: Band) -> ParamBlock {
    ParamBlock::of(&Params {
        samples: view.tables.samples() as u32,
        needle_units: needle_units(view.tables),
        exponent: exponent_per_unit() as f32,
        unused: 0,
    })
}

/// log2 of the amplitude that one unit of loss leaves.
pub fn exponent_per_unit() -> f64 {
    -(10.0f64.log2()) / 20.0 / UNITS_PER_DB
}

fn needle_units(tables: &Tables) -> f32 {
    let db_mm = tables
        .settings
        .effects
        .shadow
        .as_ref()
        .map_or(0.0, |shadow| shadow.needle_db_mm);
    units(db_mm * tables.sample_mm()) as f32
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let loss: [u32; 256] = std::array::from_fn(|label| tables.label_rows.get(label).map_or(0, |row| row.loss));
    let needle = super::needle::present(tables).then_some(T::of(f64::from(needle_units(tables))));
    let mask = &store.needle_mask;
    store.amplitude[..lines * samples]
        .par_chunks_mut(samples)
        .zip(store.label.par_chunks(samples))
        .zip(store.loss.par_chunks_mut(samples))
        .enumerate()
        .for_each(|(line, ((amplitudes, labels), down_to))| {
            let own = |i: usize| {
                let tissue = loss[usize::from(labels[i])];
                match needle {
                    Some(units) => tissue + (mask[line * samples + i] * units).to_u32().unwrap_or(0),
                    None => tissue,
                }
            };
            accumulate(own, down_to);
            for (amplitude, &loss) in amplitudes.iter_mut().zip(down_to.iter()) {
                *amplitude *= transmittance(loss);
            }
        });
}

/// Loss down to the middle of each sample, from each sample's own loss.
#[inline(always)]
pub fn accumulate(own: impl Fn(usize) -> u32, down_to: &mut [u32]) {
    let mut above = 0u32;
    for (i, slot) in down_to.iter_mut().enumerate() {
        let own = own(i);
        *slot = (above + own / 2).min(MOST_UNITS);
        above = (above + own).min(MOST_UNITS);
    }
}

/// What a loss leaves of an amplitude.
#[inline(always)]
pub fn transmittance<T: Real>(units: u32) -> T {
    (T::of(f64::from(units)) * T::of(exponent_per_unit())).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_follow_beer_and_lambert() {
        // 30 mm at 1 dB/mm, then 20 mm at 0.25 dB/mm, sampled ever finer; the last sample's middle lies half a step short.
        for samples in [50usize, 500, 5000] {
            let step = 50.0 / samples as f64;
            let mut down_to = vec![0; samples];
            let own = |i: usize| {
                units(if (i as f64) * step < 30.0 - 1e-9 {
                    step
                } else {
                    0.25 * step
                })
            };
            accumulate(own, &mut down_to);
            let expected = 30.0 + 0.25 * (20.0 - step / 2.0);
            let found = f64::from(down_to[samples - 1]) / UNITS_PER_DB;
            assert!(
                (found - expected).abs() < 1e-4 * expected,
                "{samples}: {found} dB, not {expected}"
            );
            let amplitude: f64 = transmittance(down_to[samples - 1]);
            assert!((amplitude / 10f64.powf(-expected / 20.0) - 1.0).abs() < 1e-3);
        }
    }

    #[test]
    fn an_opaque_run_saturates_and_stays_dark() {
        let mut down_to = vec![0; 8192];
        accumulate(|_| units(1e9), &mut down_to);
        assert!(down_to.is_sorted());
        assert_eq!(down_to[8191], MOST_UNITS);
        assert_eq!(transmittance::<f32>(down_to[8191]), 0.0);
    }

    #[test]
    fn what_the_voxels_hold_decides_not_what_a_file_counted() {
        use std::sync::Arc;

        use nalgebra::Matrix4;

        use crate::effects::Effects;
        use crate::synth::tables::{Anatomy, ImageSize, Settings};
        use crate::tissue::{Preset, TissueTable};
        use crate::tracking::probe::{Probe, ProbeShape};
        use crate::volume::LabelVolume;

        let verdict = |voxels: Vec<u8>, counted: u64| {
            let label = |value, name: &str| crate::volume::Label {
                value,
                name: Some(name.into()),
                voxels: counted,
            };
            let labels = vec![label(0, "background"), label(1, "bone")];
            let (tissues, _) = TissueTable::resolve(&labels, &[], Preset::Auto).expect("two known tissues");
            let volume = LabelVolume::new([2, 1, 1], voxels, labels, Matrix4::identity()).expect("two voxels");
            let anatomy = Anatomy {
                volume: Arc::new(volume),
                tissues: Arc::new(tissues),
                textures: Default::default(),
                mesh: None,
            };
            let settings = Settings {
                seed: 0,
                probe: Probe::new(ProbeShape::Linear { width_mm: 40.0 }, 40.0).expect("a probe"),
                image: ImageSize {
                    width: 8,
                    height: 8,
                    margin: 0.0,
                    fill: 0,
                },
                effects: Effects::usual(),
                has_needle: false,
            };
            wanted(&Tables::new(anatomy, settings).expect("tables"))
        };
        assert_eq!(verdict(vec![0, 1], 0), Ok("1 labels attenuate or occlude".into()));
        assert!(verdict(vec![0, 0], 1).is_err());
    }
}
