//! Thickness: averaging of echoes over parallel sub-planes, for the elevational width of the beam.
//!
//! The scatterers of different sub-planes are incoherent: power is averaged, with the weights of a Gaussian beam
//! profile. Labels, shadows and speckle are those of the central plane.
//!
//! ```toml
//! effects.thickness = { width_mm = 2.0 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use glam::Vec4;

use super::buffers::AMPLITUDE;
use super::common::plane_step;
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, OutOfRange, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::range::{check, parameters};
use insonify_base::real::Real;

parameters! {
    /// Elevational thickness of the scan plane.
    pub struct Thickness {
        /// Full width at half maximum of the beam's elevational power profile, mm.
        width_mm: f64 = 3.0, in 0.1..=20;
        /// Number of sub-planes, odd.
        planes: u32 = 5, in 3..=9;
    }
}

impl Parameters for Thickness {
    const USUAL: bool = false;

    fn check_others(&self) -> Result<(), OutOfRange> {
        let holds = self.planes % 2 == 1;
        let expected = format!("an odd number from 3 to {MAX_PLANES}");
        check("planes", f64::from(self.planes), holds, expected)
    }
}

impl Thickness {
    /// Distance between sub-planes, mm: together they span two widths, at whose ends the profile has fallen to
    /// 1/16.
    pub fn plane_mm(&self) -> f64 {
        2.0 * self.width_mm / f64::from(self.planes - 1)
    }

    /// Power weights of the sub-planes, in the order of `plane_step`; they sum to 1.
    pub fn weights(&self) -> impl Iterator<Item = f64> + use<> {
        let (plane_mm, width_mm) = (self.plane_mm(), self.width_mm);
        let planes = 0..self.planes as usize;
        let raw = move |plane| {
            let widths = f64::from(plane_step(plane)) * plane_mm / width_mm;
            (-4.0 * std::f64::consts::LN_2 * widths * widths).exp()
        };
        let sum: f64 = planes.clone().map(raw).sum();
        planes.map(move |plane| raw(plane) / sum)
    }
}

/// Maximum number of sub-planes in the parameter block.
const MAX_PLANES: usize = 9;

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "thickness",
    stage: Stage::Tissue,
    example: "effects.thickness = { width_mm = 2.0 }",
    wanted,
    passes: |_| PASSES.iter().collect(),
    remove: Some(|_, settings| settings.effects.thickness = None),
    ..Effect::PLAIN
};

static PASSES: &[Pass] = &[Pass {
    name: "thickness",
    shader: include_str!("../../../shaders/thickness.wgsl"),
    entry: "main",
    bindings: &[(&AMPLITUDE, WriteOwn)],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(tables: &Tables) -> Wanted {
    match &tables.settings.effects.thickness {
        Some(thickness) => Yes(format!(
            "the scan plane is {} mm thick: {} sub-planes",
            thickness.width_mm, thickness.planes
        )),
        None => No("the scene names no elevational thickness".into()),
    }
}

block! {
    /// Parameter block of `thickness.wgsl`.
    struct ThicknessParams {
        /// Weights of the sub-planes, four to a vector.
        weights: [Vec4; 3],
        /// Samples in a plane.
        count: u32,
        /// Sub-planes.
        planes: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Padding to a multiple of 16 bytes.
        unused: u32,
    }
}

fn weights<T: Real>(tables: &Tables) -> [T; 12] {
    let mut padded = [T::zero(); 12];
    if let Some(thickness) = &tables.settings.effects.thickness {
        for (slot, weight) in padded.iter_mut().zip(thickness.weights()) {
            *slot = T::of(weight);
        }
    }
    padded
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let w = weights::<f32>(tables);
    ParamBlock::of(&ThicknessParams {
        weights: [0, 4, 8].map(|first| Vec4::new(w[first], w[first + 1], w[first + 2], w[first + 3])),
        count: (tables.lines() * tables.samples()) as u32,
        planes: tables.planes() as u32,
        samples: tables.samples() as u32,
        unused: 0,
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let weights = weights::<T>(tables);
    let (centre, others) = store.amplitude.split_at_mut(tables.lines() * samples);
    let stride = centre.len();
    for_each((0.., chunks_mut(centre, samples)), &|(line, amplitudes)| {
        for (i, amplitude) in amplitudes.iter_mut().enumerate() {
            let mut power = weights[0] * *amplitude * *amplitude;
            for plane in 1..tables.planes() {
                let other = others[(plane - 1) * stride + line * samples + i];
                power += weights[plane] * other * other;
            }
            *amplitude = power.sqrt();
        }
    });
}
