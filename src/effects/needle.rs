//! Needle: the echo of the shaft where it crosses the thickened scan plane (paper 1, section 2.3).
//!
//! The brightness of a sample is the share of the plane's thickness, by default the needle's diameter, that the shaft
//! fills there: the length of the elevational chord through the cylinder, in closed form, for every segment of a bent
//! shaft. The echo is strongest where the shaft is perpendicular to the beam and falls with a power of the sine between
//! them. Reverberation inside the shaft repeats the echo further down the beam.

use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::pass::{Access::*, Band, ParamBlock, Pass, Resource::*, View, groups};
use super::{Effect, OutOfRange, Verdict, within};
use crate::real::Real;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use crate::tracking::needle::MAX_NODES;

/// Echo of the needle.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct NeedleEcho {
    /// Echo of a shaft in the plane and square to the beam, dB relative to liver (-40 to 80).
    pub echo_db: f64,
    /// Thickness of the scan plane for the needle, mm (0.05 to 20); none takes the needle's diameter.
    pub thickness_mm: Option<f64>,
    /// Power of the sine between shaft and beam (0 to 64).
    pub directivity: f64,
    /// Repetitions of the echo below the shaft (0 to 8).
    pub reverberations: u32,
    /// Distance between repetitions, mm (0.1 to 20).
    pub reverberation_mm: f64,
    /// Loss from one repetition to the next, dB (0 to 60).
    pub reverberation_db: f64,
}

impl Default for NeedleEcho {
    fn default() -> Self {
        Self {
            echo_db: 30.0,
            thickness_mm: None,
            directivity: 4.0,
            reverberations: 3,
            reverberation_mm: 1.6,
            reverberation_db: 9.0,
        }
    }
}

impl NeedleEcho {
    /// Checks the ranges.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        within("needle.echo_db", self.echo_db, -40.0..=80.0)?;
        within("needle.thickness_mm", self.thickness_mm.unwrap_or(1.0), 0.05..=20.0)?;
        within("needle.directivity", self.directivity, 0.0..=64.0)?;
        within("needle.reverberations", f64::from(self.reverberations), 0.0..=8.0)?;
        within("needle.reverberation_mm", self.reverberation_mm, 0.1..=20.0)?;
        within("needle.reverberation_db", self.reverberation_db, 0.0..=60.0)
    }
}

/// Most segments of a bent shaft.
pub const MAX_SEGMENTS: usize = MAX_NODES - 1;

/// Registration.
pub const EFFECT: Effect = Effect {
    name: "needle",
    wanted,
    passes: |_| PASSES,
};

static PASSES: &[Pass] = &[Pass {
    name: "needle",
    shader: include_str!("../../shaders/needle.wgsl"),
    entry: "main",
    bindings: &[(Rays, Read), (Needle, Read), (NeedleMask, Write), (Amplitude, Write)],
    params,
    workgroups: |tables, _| [groups(tables.samples(), 64), tables.lines() as u32, 1],
    flips: false,
    cpu: run::<f32>,
    cpu_f64: run::<f64>,
}];

/// Whether the scene has a needle and shows it.
pub fn present(tables: &Tables) -> bool {
    tables.settings.effects.needle.is_some() && tables.settings.has_needle
}

fn wanted(tables: &Tables) -> Verdict {
    match (&tables.settings.effects.needle, tables.settings.has_needle) {
        (Some(_), true) => Ok("the scene has a needle".into()),
        (Some(_), false) => Err("the scene has no needle".into()),
        (None, _) => Err("the scene names no needle echo".into()),
    }
}

/// Uniform block of `needle.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct Params {
    /// Samples along a scanline.
    pub samples: u32,
    /// Distance between samples, mm.
    pub sample_mm: f32,
    /// Segments of the shaft.
    pub segments: u32,
    /// Radius of the shaft, mm.
    pub radius_mm: f32,
    /// Thickness of the scan plane, mm.
    pub thickness_mm: f32,
    /// Amplitude of the echo.
    pub echo: f32,
    /// Power of the sine between shaft and beam.
    pub directivity: f32,
    /// Repetitions.
    pub reverberations: u32,
    /// Distance between repetitions, mm.
    pub reverberation_mm: f32,
    /// Amplitude that one repetition leaves.
    pub reverberation: f32,
    /// Padding to a multiple of 16 bytes.
    pub unused: [u32; 2],
}

fn numbers(view: &View) -> Params {
    let tables = view.tables;
    let own = tables.settings.effects.needle.clone().unwrap_or_default();
    let diameter = view.state.needle.as_ref().map_or(1.0, |needle| needle.diameter_mm);
    Params {
        samples: tables.samples() as u32,
        sample_mm: tables.sample_mm() as f32,
        segments: view
            .state
            .needle
            .as_ref()
            .map_or(0, |needle| needle.nodes.len().saturating_sub(1).min(MAX_SEGMENTS)) as u32,
        radius_mm: (diameter / 2.0) as f32,
        thickness_mm: own.thickness_mm.unwrap_or(diameter) as f32,
        echo: 10f64.powf(own.echo_db / 20.0) as f32,
        directivity: own.directivity as f32,
        reverberations: own.reverberations,
        reverberation_mm: own.reverberation_mm as f32,
        reverberation: 10f64.powf(-own.reverberation_db / 20.0) as f32,
        unused: [0; 2],
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    ParamBlock::of(&numbers(view))
}

/// Segments of the shaft in the probe frame, each as its start and end, for the CPU and for upload.
pub fn segments(view: &View, into: &mut Vec<[[f64; 4]; 2]>) {
    into.clear();
    let (Some(needle), Some(world_to_probe)) = (&view.state.needle, view.state.probe_to_world.try_inverse()) else {
        return;
    };
    // Of a shaft with more, the part towards the tip.
    let first = needle.nodes.len().saturating_sub(MAX_SEGMENTS + 1);
    for pair in needle.nodes[first..].windows(2) {
        let [a, b] = [pair[0], pair[1]].map(|node| world_to_probe.transform_point(&node));
        into.push([[a.x, a.y, a.z, 0.0], [b.x, b.y, b.z, 0.0]]);
    }
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let samples = tables.samples();
    let numbers = numbers(view);
    segments(view, &mut store.segments);
    let segments = &store.segments;
    store.amplitude[..tables.lines() * samples]
        .par_chunks_mut(samples)
        .zip(store.needle_mask.par_chunks_mut(samples))
        .zip(&tables.rays)
        .for_each(|((amplitudes, mask), ray)| {
            mask.fill(T::zero());
            for &[start, end] in segments {
                let shaft = Shaft::new(start.map(T::of), end.map(T::of), &numbers);
                shaft.scanline(ray.map(T::of), &numbers, amplitudes, mask);
            }
        });
}

/// One straight piece of the needle in the probe frame.
pub struct Shaft<T> {
    start: [T; 3],
    axis: [T; 3],
    length: T,
    radius: T,
    half_thickness: T,
}

impl<T: Real> Shaft<T> {
    /// The cylinder from `start` to `end`, seen by a plane of the thickness in `numbers`.
    pub fn new(start: [T; 4], end: [T; 4], numbers: &Params) -> Self {
        let along = [end[0] - start[0], end[1] - start[1], end[2] - start[2]];
        let length = (along[0] * along[0] + along[1] * along[1] + along[2] * along[2]).sqrt();
        let safe = length.max(T::of(1e-9));
        let half = T::of(0.5);
        Self {
            start: [start[0], start[1], start[2]],
            axis: along.map(|x| x / safe),
            length,
            radius: T::of(f64::from(numbers.radius_mm)),
            half_thickness: half * T::of(f64::from(numbers.thickness_mm)),
        }
    }

    /// Share of the plane's thickness inside the cylinder at a point of the plane.
    #[inline(always)]
    pub fn share(&self, x: T, y: T) -> T {
        let u = self.axis;
        let q = [x - self.start[0], y - self.start[1], -self.start[2]];
        let along = q[0] * u[0] + q[1] * u[1] + q[2] * u[2];
        // Distance from the axis at elevation z: |w + z v|, with w and v the parts of q and of z's axis across the shaft.
        let w = [q[0] - along * u[0], q[1] - along * u[1], q[2] - along * u[2]];
        let a = T::one() - u[2] * u[2];
        let b = w[2];
        let c = w[0] * w[0] + w[1] * w[1] + w[2] * w[2] - self.radius * self.radius;
        let (mut low, mut high) = (-self.half_thickness, self.half_thickness);
        if a > T::of(PARALLEL) {
            let root = b * b - a * c;
            if root <= T::zero() {
                return T::zero();
            }
            let root = root.sqrt();
            low = low.max((-b - root) / a);
            high = high.min((-b + root) / a);
        } else if c > T::zero() {
            return T::zero();
        }
        if u[2].abs() > T::of(PARALLEL) {
            let (z0, z1) = (-along / u[2], (self.length - along) / u[2]);
            low = low.max(z0.min(z1));
            high = high.min(z0.max(z1));
        } else if along < T::zero() || along > self.length {
            return T::zero();
        }
        (high - low).max(T::zero()) / (self.half_thickness + self.half_thickness)
    }

    /// Adds the echo and its repetitions to a scanline, and the share to the mask.
    fn scanline(&self, ray: [T; 4], numbers: &Params, amplitudes: &mut [T], mask: &mut [T]) {
        let step = T::of(f64::from(numbers.sample_mm));
        let half = T::of(0.5);
        let cosine = ray[2] * self.axis[0] + ray[3] * self.axis[1];
        let square = (T::one() - cosine * cosine)
            .max(T::zero())
            .sqrt()
            .powf(T::of(f64::from(numbers.directivity)));
        let mut echo = T::of(f64::from(numbers.echo)) * square;
        let Some((first, last)) = self.depths(ray) else { return };
        for repetition in 0..=numbers.reverberations {
            let shift = T::of(f64::from(repetition)) * T::of(f64::from(numbers.reverberation_mm));
            let from = ((first + shift) / step - half)
                .floor()
                .max(T::zero())
                .to_usize()
                .unwrap_or(0);
            let to = ((last + shift) / step + half)
                .ceil()
                .max(T::zero())
                .to_usize()
                .unwrap_or(0)
                .min(amplitudes.len());
            for i in from..to {
                let depth = (T::of(i as f64) + half) * step - shift;
                let share = self.share(ray[0] + ray[2] * depth, ray[1] + ray[3] * depth);
                if repetition == 0 {
                    mask[i] = (mask[i] + share).min(T::one());
                }
                amplitudes[i] += echo * share;
            }
            echo *= T::of(f64::from(numbers.reverberation));
        }
    }

    /// Depths between which a ray may meet the thickened shaft: where it is nearer to the axis than the cylinder and the
    /// plane are thick together.
    fn depths(&self, ray: [T; 4]) -> Option<(T, T)> {
        let u = self.axis;
        let q = [ray[0] - self.start[0], ray[1] - self.start[1], -self.start[2]];
        let d = [ray[2], ray[3], T::zero()];
        let dot = |p: [T; 3], q: [T; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        let across = |p: [T; 3]| {
            let along = dot(p, u);
            [p[0] - along * u[0], p[1] - along * u[1], p[2] - along * u[2]]
        };
        let (w, v) = (across(q), across(d));
        let reach = self.radius + self.half_thickness;
        let (a, b, c) = (dot(v, v), dot(w, v), dot(w, w) - reach * reach);
        if a <= T::of(PARALLEL) {
            let far = self.length + dot(q, u).abs() + reach;
            return (c <= T::zero()).then_some((T::zero(), far));
        }
        let root = b * b - a * c;
        (root >= T::zero()).then(|| ((-b - root.sqrt()) / a, (-b + root.sqrt()) / a))
    }
}

/// Squared sine, or cosine, below which a shaft counts as parallel, or perpendicular, to a direction: at a needle's
/// length of 200 mm the error it makes is below 0.1 mm.
const PARALLEL: f64 = 1e-7;

#[cfg(test)]
mod tests {
    use super::*;

    fn shaft(start: [f64; 3], end: [f64; 3], radius: f32, thickness: f32) -> Shaft<f64> {
        let numbers = Params {
            radius_mm: radius,
            thickness_mm: thickness,
            ..bytemuck::Zeroable::zeroed()
        };
        Shaft::new(
            [start[0], start[1], start[2], 0.0],
            [end[0], end[1], end[2], 0.0],
            &numbers,
        )
    }

    /// Volume of the shaft inside the thickened plane, by summing shares over a fine lattice of plane points.
    fn volume(shaft: &Shaft<f64>, thickness: f64, half_width: f64) -> f64 {
        let n = 1600;
        let step = 2.0 * half_width / f64::from(n);
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n {
                let at = |k: i32| -half_width + (f64::from(k) + 0.5) * step;
                sum += shaft.share(at(i), at(j));
            }
        }
        sum * step * step * thickness
    }

    #[test]
    fn in_the_plane_the_shaft_fills_its_own_cylinder() {
        let lying = shaft([-5.0, 0.0, 0.0], [5.0, 0.0, 0.0], 0.5, 1.0);
        assert!((lying.share(0.0, 0.0) - 1.0).abs() < 1e-12);
        assert!((lying.share(0.0, 0.3) - 0.8).abs() < 1e-12);
        assert_eq!(lying.share(0.0, 0.51), 0.0);
        assert_eq!(lying.share(5.01, 0.0), 0.0);
        assert!((volume(&lying, 1.0, 6.0) / (std::f64::consts::PI * 0.25 * 10.0) - 1.0).abs() < 2e-3);
    }

    #[test]
    fn across_the_plane_it_is_a_disc() {
        let upright = shaft([0.0, 0.0, -20.0], [0.0, 0.0, 20.0], 0.5, 1.0);
        assert_eq!(upright.share(0.3, 0.3), 1.0);
        assert_eq!(upright.share(0.4, 0.4), 0.0);
        assert!((volume(&upright, 1.0, 1.0) / (std::f64::consts::PI * 0.25) - 1.0).abs() < 5e-3);
        let short = shaft([0.0, 0.0, 0.25], [0.0, 0.0, 20.0], 0.5, 1.0);
        assert!((short.share(0.0, 0.0) - 0.25).abs() < 1e-12);
    }

    #[test]
    fn obliquely_the_volume_is_the_area_over_the_sine() {
        // A long cylinder at 30 degrees to a thick plane: volume = pi r^2 t / sin(angle).
        let oblique = shaft(
            [-30.0 * 3f64.sqrt(), 0.0, -30.0],
            [30.0 * 3f64.sqrt(), 0.0, 30.0],
            0.5,
            2.0,
        );
        let expected = std::f64::consts::PI * 0.25 * 2.0 / 0.5;
        assert!((volume(&oblique, 2.0, 6.0) / expected - 1.0).abs() < 3e-3);
    }

    #[test]
    fn the_depths_tried_hold_every_echo() {
        let numbers = Params {
            radius_mm: 0.6,
            thickness_mm: 1.2,
            sample_mm: 0.25,
            samples: 400,
            echo: 1.0,
            ..Zeroable::zeroed()
        };
        for end in [
            [40.0, 60.0, 3.0],
            [-20.0, 80.0, 0.0],
            [0.0, 50.0, 0.0],
            [3.0, 20.0, 30.0],
        ] {
            let shaft = shaft([-10.0, 5.0, -1.0], end, 0.6, 1.2);
            for line in -20..20 {
                let angle = f64::from(line) * 0.05;
                let ray = [f64::from(line), 0.0, angle.sin(), angle.cos()];
                let (mut amplitudes, mut mask) = (vec![0.0; 400], vec![0.0; 400]);
                shaft.scanline(ray, &numbers, &mut amplitudes, &mut mask);
                for (i, &found) in mask.iter().enumerate() {
                    let depth = (i as f64 + 0.5) * 0.25;
                    assert_eq!(
                        found,
                        shaft.share(ray[0] + ray[2] * depth, ray[1] + ray[3] * depth),
                        "line {line} sample {i}"
                    );
                }
            }
        }
    }
}
