//! Interface: specular echoes where the acoustic impedance changes, strongest where the beam meets the surface squarely.
//!
//! In beam space the gradient of impedance is taken by a 3 by 3 Sobel stencil. Its axial part gives the reflection
//! coefficient `|dZ| / (Z1 + Z2)` of the step that the beam crosses; its direction gives the angle of incidence, and the
//! echo falls with a power of its cosine (Cobbold, Foundations of Biomedical Ultrasound, 2007, section 1.8, for the
//! coefficient; the power stands for the aperture of the probe). Organ capsules, the diaphragm, vessel walls and the
//! surface of bone take their bright lines from it.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pass::{Access::*, Band, ParamBlock, Pass, Resource::*, View, groups};
use super::{Effect, OutOfRange, Verdict, within};
use crate::real::Real;
use crate::simd::{Kernel, vectorised};
use crate::synth::store::Store;
use crate::synth::tables::Tables;

/// Specular echoes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Interface {
    /// Echo of a perfect mirror at a right angle, dB relative to liver (-40 to 80).
    pub mirror_db: f64,
    /// Power of the cosine of the angle of incidence (0 to 64).
    pub directivity: f64,
}

impl Default for Interface {
    fn default() -> Self {
        Self {
            mirror_db: 34.0,
            directivity: 6.0,
        }
    }
}

impl Interface {
    /// Checks the ranges.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        within("interface.mirror_db", self.mirror_db, -40.0..=80.0)?;
        within("interface.directivity", self.directivity, 0.0..=64.0)
    }
}

/// Registration.
pub const EFFECT: Effect = Effect {
    name: "interface",
    wanted,
    passes: |_| PASSES,
};

static PASSES: &[Pass] = &[Pass {
    name: "interface",
    shader: concat!(
        include_str!("../../shaders/common/label_row.wgsl"),
        include_str!("../../shaders/common/power.wgsl"),
        include_str!("../../shaders/interface.wgsl")
    ),
    entry: "main",
    bindings: &[
        (Label, Read),
        (LabelRows, Read),
        (LineSpacing, Read),
        (Amplitude, Write),
    ],
    params,
    workgroups: |tables, _| [groups(tables.samples(), 64), tables.lines() as u32, 1],
    flips: false,
    cpu: run::<f32>,
    cpu_f64: run::<f64>,
}];

fn wanted(tables: &Tables) -> Verdict {
    match &tables.settings.effects.interface {
        Some(_) => Ok("boundaries between tissues of different impedance reflect".into()),
        None => Err("the scene names no interface echoes".into()),
    }
}

/// Parameter block of `interface.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Params {
    /// Scanlines.
    pub lines: u32,
    /// Samples along a scanline.
    pub samples: u32,
    /// Distance between samples, mm.
    pub sample_mm: f32,
    /// Amplitude of a perfect mirror at a right angle.
    pub mirror: f32,
    /// Power of the cosine of the angle of incidence.
    pub directivity: f32,
    /// Padding to a multiple of 16 bytes.
    pub unused: [u32; 3],
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let own = tables.settings.effects.interface.clone().unwrap_or_default();
    ParamBlock::of(&Params {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        sample_mm: tables.sample_mm() as f32,
        mirror: 10f64.powf(own.mirror_db / 20.0) as f32,
        directivity: own.directivity as f32,
        unused: [0; 3],
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let own = tables.settings.effects.interface.clone().unwrap_or_default();
    let impedance: [T; 256] =
        std::array::from_fn(|label| T::of(tables.label_rows.get(label).map_or(0.0, |row| f64::from(row.impedance))));
    let mirror = T::of(10f64.powf(own.mirror_db / 20.0));
    let directivity = T::of(own.directivity);
    let spacing = tables.line_spacing.of::<T>();
    let sample_mm = T::of(tables.sample_mm());
    let labels = &store.label[..lines * samples];
    store.amplitude[..lines * samples]
        .par_chunks_mut(samples)
        .enumerate()
        .for_each(|(line, amplitudes)| {
            let row = |line: usize| &labels[line * samples..][..samples];
            let rows = [row(line.saturating_sub(1)), row(line), row((line + 1).min(lines - 1))];
            if samples < 3 {
                return;
            }
            for start in (1..samples - 1).step_by(BLOCK) {
                let end = (start + BLOCK).min(samples - 1);
                if vectorised(Uniform(rows.map(|row| &row[start - 1..end + 1]))) {
                    continue;
                }
                for i in start..end {
                    let labels: [[u8; 3]; 3] = rows.map(|row| [row[i - 1], row[i], row[i + 1]]);
                    if labels == [[labels[1][1]; 3]; 3] {
                        continue;
                    }
                    let z = labels.map(|row| row.map(|label| impedance[usize::from(label)]));
                    amplitudes[i] += mirror * reflection(z, sample_mm, spacing[i], directivity);
                }
            }
        });
}

/// Samples tried together for a boundary between them.
const BLOCK: usize = 32;

/// Whether all labels are the same.
struct Uniform<'a>([&'a [u8]; 3]);

impl Kernel for Uniform<'_> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let first = self.0[1][0];
        let mut differing = 0u8;
        for row in self.0 {
            for &label in row {
                differing |= label ^ first;
            }
        }
        differing == 0
    }
}

/// Reflected share at the middle of a 3 by 3 patch of impedances (scanline by sample).
#[inline(always)]
pub fn reflection<T: Real>(z: [[T; 3]; 3], sample_mm: T, line_mm: T, directivity: T) -> T {
    let (quarter, half) = (T::of(0.25), T::of(0.5));
    let smooth = |a: T, b: T, c: T| quarter * a + half * b + quarter * c;
    let near = smooth(z[0][0], z[1][0], z[2][0]);
    let far = smooth(z[0][2], z[1][2], z[2][2]);
    let axial = (far - near) / (sample_mm + sample_mm);
    let lateral = (smooth(z[2][0], z[2][1], z[2][2]) - smooth(z[0][0], z[0][1], z[0][2])) / (line_mm + line_mm);
    let steepness = (axial * axial + lateral * lateral).sqrt();
    let total = near + far;
    if axial == T::zero() || total <= T::zero() {
        return T::zero();
    }
    let cosine = axial.abs() / steepness;
    // A step between neighbouring samples shows in the stencils of both: each takes half of it.
    half * (far - near).abs() / total * cosine.powf(directivity)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_step_returns_the_reflection_coefficient() {
        let (z1, z2): (f64, f64) = (1.5, 1.7);
        let column = |i: usize| if i < 2 { z1 } else { z2 };
        // The two stencils that straddle the step.
        let patch = |first: usize| [[column(first), column(first + 1), column(first + 2)]; 3];
        let sum = reflection(patch(0), 0.3, 0.5, 4.0) + reflection(patch(1), 0.3, 0.5, 4.0);
        assert!((sum - (z2 - z1) / (z1 + z2)).abs() < 1e-12);
    }

    #[test]
    fn a_surface_along_the_beam_is_dark() {
        let patch = [[1.5; 3], [1.5; 3], [1.7; 3]];
        assert_eq!(reflection(patch, 0.3f64, 0.5, 4.0), 0.0);
        assert_eq!(reflection([[0.0f64; 3]; 3], 0.3, 0.5, 4.0), 0.0);
    }
}
