//! Contact: conformation of the skin to the array.
//!
//! A body at rest touches a curved or straight array in a few points only; in practice both are pressed together and
//! gel fills the remaining gaps. On each scanline the gap between array and skin is found, up to a reach, and samples
//! are shifted to deeper tissue by the gap at the array and less below: `s -> s + gap (1 - s / fade)^2`, which
//! preserves the order of tissue along the beam as long as the gap is less than half the fade. Where the array is
//! pressed in, the gap is negative, and the skin gives way, unless a mesh deforms and does so itself, or the probe is
//! one for lumens. Beyond the reach there is no contact: the scanline shows the void, or begins in the body. Gaps are
//! those of the tissue at rest, smoothed over neighbouring scanlines because skin is smooth.
//!
//! ```toml
//! effects.contact = {}
//! ```

#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use glam::Vec4;
use nalgebra::Vector4;

use super::buffers::{Buffer, POSITION, RAYS, columns};
use super::common::rows;
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, Parameters, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::FrameState;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::range::parameters;
use insonify_base::real::Real;
use insonify_tracking::probe::Site;

parameters! {
    /// Contact between skin and array.
    pub struct Contact {
        /// Widest gap between array and skin that is closed by pressure, and depth to which the array is pressed in, mm.
        reach_mm: f64 = 12.0, in 0..=20;
        /// Depth at which the shift vanishes, mm.
        fade_mm: f64 = 50.0, in 50..=1000;
    }
}

impl Parameters for Contact {}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "contact",
    stage: Stage::Tissue,
    example: "effects.contact = {}",
    wanted,
    passes: |_| PASSES.iter().collect(),
    buffers: &[&GAPS],
    remove: Some(|_, settings| settings.effects.contact = None),
    ..Effect::PLAIN
};

/// Per scanline: gap between array and body, mm (`f32`).
static GAPS: Buffer = Buffer::new(10, "Gaps", 4, Tables::lines).per_frame(gaps);

columns! {
    /// Vectors of the contact.
    pub struct Columns {
        /// Data of `GAPS`, and as much again to smooth them.
        gaps: [f32; |tables| 2 * tables.lines()] = 0.0, GAPS;
    }
}

static PASSES: &[Pass] = &[Pass {
    name: "contact",
    shader: include_str!("../../../shaders/contact.wgsl"),
    entry: "main",
    bindings: &[(&RAYS, Read), (&GAPS, Read), (&POSITION, WriteOwn)],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(run),
    bound: bound!(Covered("by the bound of `geometry`")),
}];

fn wanted(tables: &Tables) -> Wanted {
    match &tables.settings.effects.contact {
        Some(contact) => Yes(format!(
            "skin within {} mm of the array lies against it",
            contact.reach_mm
        )),
        None => No("the scene names no contact".into()),
    }
}

/// Step of the search for the body, mm.
const STEP_MM: f64 = 0.25;
/// Number of bisections of the last step.
const HALVINGS: usize = 4;
/// Number of scanlines on each side over which gaps are smoothed.
const SMOOTHED: usize = 2;

/// Gap on each scanline, mm, negative where the array is pressed into the body; 0 without skin in reach.
pub fn gaps(tables: &Tables, state: &FrameState, gaps: &mut Vec<f32>) {
    let reach = tables
        .settings
        .effects
        .contact
        .as_ref()
        .map_or(0.0, |contact| contact.reach_mm);
    // A mesh gives way by itself; probes for lumens have skin on all sides.
    let may_press = tables.mesh.is_none() && tables.settings.probe.shape.kind().site() == Site::Skin;
    let lines = tables.lines();
    let to_index = tables.volume.world_to_index() * state.probe_to_world;
    let gap = |line: usize| {
        let [x, y, dx, dy] = tables.rays[line];
        let (start, along) = (
            to_index * Vector4::new(x, y, 0.0, 1.0),
            to_index * Vector4::new(dx, dy, 0.0, 0.0),
        );
        // `None` beyond the volume.
        let is_body = |s: f64| {
            let index = [0, 1, 2].map(|axis| start[axis] + s * along[axis]);
            tables.volume.label_at_index(index).map(|label| label > 0)
        };
        let is_inside = is_body(0.0) == Some(true);
        if is_inside && !may_press {
            return 0.0;
        }
        let towards = if is_inside { -STEP_MM } else { STEP_MM };
        let is_past = |s: f64| (is_body(s) == Some(true)) != is_inside;
        let steps = (reach / STEP_MM) as usize;
        let Some(first) = (1..=steps).find(|step| is_past(*step as f64 * towards)) else {
            return if is_inside { 0.0 } else { f64::NAN };
        };
        let mut ends = [first - 1, first].map(|step| step as f64 * towards);
        // A face that cuts the body is no skin.
        if is_body(ends[1]).is_none() {
            return 0.0;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (ends[0] + ends[1]);
            ends[usize::from(is_past(middle))] = middle;
        }
        ends[usize::from(!is_inside)]
    };
    gaps.clear();
    gaps.resize(2 * lines, 0.0);
    let (raw, smooth) = gaps.split_at_mut(lines);
    // Multiples of 1/64 mm: exact in single precision.
    raw.iter_mut()
        .enumerate()
        .for_each(|(line, raw)| *raw = gap(line) as f32);
    for (line, gap) in smooth.iter_mut().enumerate().filter(|(line, _)| !raw[*line].is_nan()) {
        let near = &raw[line.saturating_sub(SMOOTHED)..lines.min(line + SMOOTHED + 1)];
        let touching = near.iter().filter(|gap| !gap.is_nan());
        let (sum, count) = touching.fold((0.0, 0.0), |(sum, count), gap| (sum + f64::from(*gap), count + 1.0));
        // Rounded once, for all backends.
        *gap = (sum / count) as f32;
    }
    gaps.drain(..lines);
}

block! {
    /// Parameter block of `contact.wgsl`.
    struct ContactParams {
        /// First three rows of the probe-to-world transform.
        probe_to_world: [Vec4; 3],
        /// Scanlines.
        lines: u32,
        /// Samples along a scanline.
        samples: u32,
        /// Distance between samples, mm.
        sample_mm: f32,
        /// Inverse of the depth at which the shift vanishes, 1/mm.
        per_fade: f32,
    }
}

fn per_fade(tables: &Tables) -> f64 {
    let contact = tables.settings.effects.contact.clone().unwrap_or_default();
    1.0 / contact.fade_mm
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&ContactParams {
        probe_to_world: rows::<f32>(&view.state.probe_to_world).map(Vec4::from),
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        sample_mm: tables.sample_mm() as f32,
        per_fade: per_fade(tables) as f32,
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    gaps(tables, view.state, &mut store.effects.contact.gaps);
    let matrix = rows::<T>(&view.state.probe_to_world);
    let (sample_mm, per_fade) = (T::of(tables.sample_mm()), T::of(per_fade(tables)));
    let rows = (
        0..,
        chunks_mut(&mut store.position, samples),
        &store.effects.contact.gaps[..],
    );
    for_each(rows, &|(index, positions, gap)| {
        if *gap == 0.0 {
            return;
        }
        let [_, _, dx, dy] = tables.rays[index % lines].map(T::of);
        let step = matrix.map(|row| (row[0] * dx + row[1] * dy) * T::of(f64::from(*gap)));
        for (i, position) in positions.iter_mut().enumerate() {
            let s = (T::from_signed(i as i32) + T::of(0.5)) * sample_mm;
            // The square ends with slope 0, so that speckle is not stretched abruptly at the fade.
            let left = (T::one() - s * per_fade).max(T::zero());
            let share = left * left;
            for axis in 0..3 {
                position[axis] += step[axis] * share;
            }
        }
    });
}
