//! Warp: mapping of current sample positions to the reference state of the tissue (Zhu et al. 2007, section 2.2).
//!
//! All later look-ups, of labels, textures and scatterers, use the reference state.
//!
//! | location of a sample | position after the map | flag (`w`) |
//! |---|---|---|
//! | the deformed mesh | the reference position of the same tissue | [`MAPPED`] (0), or [`FOLDED`] (2) in a fold |
//! | the reference mesh only | unchanged: its tissue has moved away | [`BACKGROUND`] (1) |
//! | neither | unchanged | [`OUTSIDE`] (3) |
//!
//! The elements in the slab of the frame ([`crate::synth::slab`]) are rasterised: each tests the samples of its
//! scanlines between those where its barycentric coordinates change sign, and of the elements that hold a sample the
//! lowest is taken. The answer for a sample is that of a search of all elements; it depends on no other sample and on
//! no other frame. A sample in an inverted element is in a fold.
//!
//! ```toml
//! deform.field = { kind = "indentation", centre_mm = [-52.3, -20.2, -25.1], direction = [-20.3, 59.4, -18.0], depth_mm = 12.0, radius_mm = 18.0 }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;

use std::ops::Range;

use super::buffers::{ELEMENT, ELEMENT_MAPS, HITS, POSITION};
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::{
    Effect, Stage,
    Wanted::{self, No, Yes},
};
use crate::synth::slab::Slab;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::Real;
use insonify_mesh::NO_ELEMENT;
use insonify_mesh::element::{self, Frame};

/// Flag of a sample in the deformed mesh; its position is now a reference position.
pub const MAPPED: u32 = 0;
/// Flag of a sample whose tissue has moved away: it is background.
pub const BACKGROUND: u32 = 1;
/// Flag of a sample where the mesh is folded: its reference position is one of several valid ones.
pub const FOLDED: u32 = 2;
/// Flag of a sample outside the mesh in both states; reference and world are the same there.
pub const OUTSIDE: u32 = 3;

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "warp",
    stage: Stage::Tissue,
    example: r#"deform.field = { kind = "indentation", centre_mm = [-52.3, -20.2, -25.1], direction = [-20.3, 59.4, -18.0], depth_mm = 12.0, radius_mm = 18.0 }"#,
    wanted,
    passes: |_| PASSES.iter().collect(),
    remove: Some(|anatomy, _| anatomy.mesh = None),
    needed_by: |_, _| Some("the mesh"),
    ..Effect::PLAIN
};

const SHADER: &str = include_str!("../../../shaders/warp.wgsl");

/// Workgroups that share the elements among them.
const GROUPS: u32 = 4096;

static PASSES: &[Pass] = &[
    Pass {
        name: "warp_raster",
        shader: SHADER,
        entry: "raster",
        bindings: &[(&POSITION, Read), (&ELEMENT_MAPS, Read), (&HITS, Write)],
        params,
        grid: Grid::Shared(GROUPS),
        flips: false,
        cpu: reference!(sort),
        bound: bound!(Covered("by the bound of `warp`")),
    },
    Pass {
        name: "warp",
        shader: SHADER,
        entry: "main",
        bindings: &[
            (&POSITION, WriteOwn),
            (&ELEMENT_MAPS, Read),
            (&HITS, ReadOwn),
            (&ELEMENT, WriteOwn),
        ],
        params,
        grid: Grid::Samples,
        flips: false,
        cpu: reference!(map),
        bound: bound!(By(bound::carry)),
    },
];

fn wanted(tables: &Tables) -> Wanted {
    match &tables.anatomy.mesh {
        Some(mesh) => Yes(format!(
            "a mesh of {} nodes and {} tetrahedra deforms the tissue",
            mesh.nodes().len(),
            mesh.elements().len()
        )),
        None => No("no tissue model deforms: world and reference state are the same".into()),
    }
}

block! {
    /// Parameter block of `warp.wgsl`.
    struct WarpParams {
        /// Number of scanlines.
        lines: u32,
        /// Number of samples along a scanline.
        samples: u32,
        /// Padding to a multiple of 16 bytes.
        unused: u32,
        /// Number of elements of the deformed state in the slab.
        deformed: u32,
        /// Number of elements of the reference state in the slab.
        reference: u32,
        /// Start of the maps of the reference elements to barycentric coordinates, in vec4.
        reference_at: u32,
        /// Start of the maps of the deformed elements to barycentric coordinates, in vec4.
        frames_at: u32,
        /// Start of the maps of the deformed elements to the reference state, in vec4.
        carries_at: u32,
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    let [reference_at, frames_at, carries_at] = view.slab.map_or([0; 3], |slab| slab.maps_at);
    let count = |elements: fn(&Slab<f32>) -> usize| view.slab.map_or(0, elements) as u32;
    ParamBlock::of(&WarpParams {
        lines: tables.lines() as u32,
        samples: tables.samples() as u32,
        unused: 0,
        deformed: count(|slab| slab.deformed.elements.len()),
        reference: count(|slab| slab.reference.elements.len()),
        reference_at,
        frames_at,
        carries_at,
    })
}

/// Sorts the elements by scanline; what they hold is found together with the map.
fn sort<T: Real>(view: &View, store: &mut Store<T>) {
    if let Some(slab) = &mut store.slab {
        slab.sort_by_line(view.tables.lines());
    }
}

/// Finds the element of each sample, and moves those in the mesh to the reference state.
fn map<T: Real>(view: &View, store: &mut Store<T>) {
    let samples = view.tables.samples();
    let Some(slab) = &store.slab else { return };
    let scanlines = (
        0..,
        chunks_mut(&mut store.position, samples),
        chunks_mut(&mut store.element, samples),
    );
    for_each(scanlines, &|(line, positions, elements)| {
        rasterise(slab, line, positions, elements);
        carry(slab, positions, elements);
    });
}

/// Finds the elements of the samples of one scanline, as slots in the list of deformed elements, and sets the flags of
/// their positions.
pub(crate) fn rasterise<T: Real>(slab: &Slab<T>, line: usize, positions: &mut [[T; 4]], elements: &mut [u32]) {
    let ends = [0, positions.len() - 1].map(|sample| positions[sample].map(T::wide));
    let flag = |flag: u32| T::of(f64::from(flag));
    elements.fill(NO_ELEMENT);
    positions.iter_mut().for_each(|position| position[3] = flag(OUTSIDE));
    for &slot in slab.deformed.on_line(line) {
        let frame = &slab.deformed.frames[slot as usize];
        let inverted = element::is_inverted(frame);
        for sample in candidates(frame, ends, positions) {
            let (position, element) = (&mut positions[sample], &mut elements[sample]);
            if (*element == NO_ELEMENT || inverted) && element::holds(frame, position) {
                *element = slot.min(*element);
                if inverted {
                    position[3] = flag(FOLDED);
                } else if position[3] == flag(OUTSIDE) {
                    position[3] = flag(MAPPED);
                }
            }
        }
    }
    if !elements.contains(&NO_ELEMENT) {
        return;
    }
    for &slot in slab.reference.on_line(line) {
        let frame = &slab.reference.frames[slot as usize];
        for sample in candidates(frame, ends, positions) {
            let position = &mut positions[sample];
            if elements[sample] == NO_ELEMENT && element::holds(frame, position) {
                position[3] = flag(BACKGROUND);
            }
        }
    }
}

/// Samples of a scanline that may lie in an element.
fn candidates<T: Real>(frame: &Frame<T>, ends: [[f64; 4]; 2], positions: &[[T; 4]]) -> Range<usize> {
    let frame = frame.map(|row| row.map(T::wide));
    let offsets = ends.map(|end| [0, 1, 2].map(|axis| end[axis] - frame[0][axis]));
    let length = |v: [f64; 3]| (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    let steepest: f64 = frame[1..].iter().map(|row| length([row[0], row[1], row[2]])).sum();
    // The slack bounds the rounding of a coordinate at a point in the element; far from it, rounding is that of the
    // offset.
    let farthest = length(offsets[0]).max(length(offsets[1]));
    let allowed = 16.0 * (element::slack(&frame) + T::epsilon().wide() * steepest * farthest);
    let [first, last] = ends;
    let segment = [0, 1, 2].map(|axis| last[axis] - first[axis]);
    let per_square = (segment[0] * segment[0] + segment[1] * segment[1] + segment[2] * segment[2]).recip();
    let along = |sample: usize| {
        let position = &positions[sample];
        let dot: f64 = (0..3)
            .map(|axis| (position[axis].wide() - first[axis]) * segment[axis])
            .sum();
        dot * per_square
    };
    let coordinates = ends.map(|[x, y, z, _]| element::barycentric(&frame, [x, y, z]));
    samples_between(coordinates, allowed, positions.len(), along)
}

/// Samples of a scanline that may lie in an element, given the barycentric coordinates of the first and the last
/// sample.
///
/// Coordinates are linear along a scanline: an end whose coordinate is below `-allowed` bounds the samples. `along` is
/// the share of the way from the first sample to the last that lies behind a sample; samples are in ascending order,
/// but not evenly spaced (`contact` shifts them).
fn samples_between(ends: [[f64; 4]; 2], allowed: f64, samples: usize, along: impl Fn(usize) -> f64) -> Range<usize> {
    // Clipping by the four faces, in shares of the way, as Y.-D. Liang and B. A. Barsky (1984) clip lines.
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for corner in 0..4 {
        let [a, b] = ends.map(|end| end[corner] + allowed);
        match (a < 0.0, b < 0.0) {
            (true, true) => return 0..0,
            (true, false) => from = from.max(a / (a - b)),
            (false, true) => to = to.min(a / (a - b)),
            (false, false) => {}
        }
    }
    if from > to {
        return 0..0;
    }
    let last = samples - 1;
    // A guess as if samples were evenly spaced, then corrected: they nearly are, so that the loops take a step or two.
    let mut start = (from * last as f64) as usize;
    while start > 0 && along(start) >= from {
        start -= 1;
    }
    while start < last && along(start + 1) < from {
        start += 1;
    }
    let mut end = ((to * last as f64) as usize + 1).min(last);
    while end < last && along(end) <= to {
        end += 1;
    }
    while end > start && along(end - 1) > to {
        end -= 1;
    }
    start..end + 1
}

/// Moves the samples of a scanline that lie in the mesh to the reference state.
fn carry<T: Real>(slab: &Slab<T>, positions: &mut [[T; 4]], elements: &[u32]) {
    let deformed = &slab.deformed;
    for (position, &slot) in positions
        .iter_mut()
        .zip(elements)
        .filter(|(_, slot)| **slot != NO_ELEMENT)
    {
        let slot = slot as usize;
        let [x, y, z, flag] = *position;
        let [x, y, z] = element::carry_to_reference(&deformed.frames[slot], &deformed.carries[slot], [x, y, z]);
        *position = [x, y, z, flag];
    }
}

#[cfg(test)]
mod tests;
