//! Reverberation: repeated echoes between the first bone, gas or lung of a scanline and the face of the array.
//!
//! An echo from depth z appears again at z + d, z + 2 d, ..., where d is the depth of the reflector: the A-lines of
//! lung, one under the other to the end of the image, and the haze of tissue above it in the shadow of gas. Each repeat
//! loses what average soft tissue takes over the path to the reflector and back, as compensation makes up for, so that
//! from order to order the same is lost in a frame whatever the wall is made of: each is multiplied by
//! [`Shadow::reverberation`], by the reflection coefficient of the reflector (0.99 for gas, 0.8 for lung, 0.6 for bone)
//! and, for a reflector tilted by theta, by cos^4 theta (the law of [`interface`](crate::effects::interface)) and cos^4 2
//! theta (the angle at which it returns to the array). Bone is convex towards the array, as laminae and ribs are, and
//! spreads what it returns: a mirror of radius r at depth d leaves 1 / (1 + 2 d / r) of the amplitude. Powers are added, as
//! the phases over such long paths are random. Depth and tilt are those of a stretch of the surface, since the width of a
//! beam meets that; where only a share of the stretch continues the surface, that share is met, there and back. A lung's
//! A-lines: D. Lichtenstein et al., Intensive Care Med. 24 (1998) 1331.

use super::mirror::is_gas;
use super::{Shadow, penumbra};
use crate::effects::common::spacing;
use crate::effects::pass::View;
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::real::Real;

/// Half the length of the surface that an echo returns from, mm: twice the voxels of labels from CT, whose steps are no
/// tilt. On another surface lies what is more than this deeper or shallower.
const SIDE_MM: f64 = 3.0;

/// Largest number of scanlines to either side whose depths are read; where more lie on a stretch, every second, third and
/// so on is.
const MAX_READ: usize = 8;

/// Radius of curvature of bone in the plane and across it, mm: of ribs and laminae. By eye.
pub(crate) const BONE_RADIUS_MM: f64 = 10.0;

/// Presence of an opaque tissue in the volume.
pub(crate) fn occludes(tables: &Tables) -> bool {
    let opaque = penumbra::opaque_units(tables.sample_mm());
    let mut rows = tables.label_rows.iter().enumerate();
    rows.any(|(index, row)| row.loss >= opaque && tables.volume.holds(index))
}

/// Whether echoes are repeated: above an opaque tissue.
pub fn repeats(tables: &Tables) -> bool {
    share(tables) > 0.0 && occludes(tables)
}

/// First opaque sample of a scanline below non-opaque ones; the number of samples if there is none.
fn top(labels: &[u8], is_opaque: &[bool; 256]) -> u32 {
    let first = labels
        .iter()
        .position(|label| is_opaque[usize::from(*label)])
        .filter(|first| *first > 0);
    first.unwrap_or(labels.len()) as u32
}

/// First opaque samples of the scanlines, as a surface.
pub(crate) struct Surface<'a> {
    /// First opaque sample of each scanline, or the number of samples.
    pub(crate) tops: &'a [u32],
    /// Samples along a scanline.
    pub(crate) samples: usize,
    /// Scanlines to either side that are read of a stretch, and distance between them in scanlines.
    side: [usize; 2],
    /// Samples by which they may be deeper or shallower.
    rise: u32,
}

impl<'a> Surface<'a> {
    /// The surface of a scene.
    pub(crate) fn new(tables: &Tables, tops: &'a [u32]) -> Self {
        Self {
            tops,
            samples: tables.samples(),
            side: side(tables),
            rise: rise(tables),
        }
    }

    /// Whether the surface of another scanline continues that of one.
    #[inline(always)]
    fn continues(&self, line: usize, other: usize) -> bool {
        (self.tops[other] as usize) < self.samples && self.tops[other].abs_diff(self.tops[line]) <= self.rise
    }

    /// Samples from an echo to its repeat, which are the mean depth of the stretch; and what a beam as wide as that meets
    /// of the surface, there and back.
    #[inline(always)]
    pub(crate) fn stretch<T: Real>(&self, line: usize) -> (usize, T) {
        let [side, apart] = self.side;
        let side = side.min(line / apart).min((self.tops.len() - 1 - line) / apart);
        let (mut sum, mut count) = (0, 0);
        for other in (0..=2 * side).map(|read| line + read * apart - side * apart) {
            if self.continues(line, other) {
                sum += self.tops[other];
                count += 1;
            }
        }
        let met = T::of(f64::from(count)) / T::of((2 * side + 1) as f64);
        ((sum / count).max(1) as usize, met * met)
    }

    /// Directivity of a repeat: factor on the amplitude for the tilt.
    pub(crate) fn directivity<T: Real>(&self, line: usize, spacing: [T; 2]) -> T {
        let slope = self.slope(line, spacing);
        let square = slope * slope;
        let cos2 = T::one() / (T::one() + square);
        let twice = ((T::one() - square) * cos2).max(T::zero());
        cos2 * cos2 * twice * twice * twice * twice
    }

    /// Tangent of the tilt, positive where the surface lies deeper on later scanlines; 0 where no neighbour continues it.
    #[inline(always)]
    pub(crate) fn slope<T: Real>(&self, line: usize, spacing: [T; 2]) -> T {
        let side = self.side[0] * self.side[1];
        let first = line.saturating_sub(side);
        let last = (line + side).min(self.tops.len() - 1);
        let known = |other: usize| if self.continues(line, other) { other } else { line };
        let (first, last) = (known(first), known(last));
        if first == last {
            return T::zero();
        }
        let number = |n: u32| T::of(f64::from(n));
        let across = number((last - first) as u32) * (spacing[0] + spacing[1] * number(self.tops[line]));
        (number(self.tops[last]) - number(self.tops[first])) / across
    }
}

/// Scanlines to either side that are read of a stretch, and distance between them in scanlines, at the middle depth.
pub(crate) fn side(tables: &Tables) -> [usize; 2] {
    let middle_mm = tables.grid.sample_depth_mm(tables.samples() / 2);
    let lines = SIDE_MM / tables.grid.lateral_spacing_mm(middle_mm);
    let lines = (lines.round() as usize).clamp(1, tables.lines());
    let apart = lines.div_ceil(MAX_READ);
    [lines / apart, apart]
}

/// Samples by which a stretch may rise or fall.
pub(crate) fn rise(tables: &Tables) -> u32 {
    (SIDE_MM / tables.sample_mm()).round() as u32
}

/// First opaque sample of each scanline by the labels of the samples, as [`top`].
pub(crate) fn tops(tables: &Tables, labels: &[u8]) -> Vec<u32> {
    let is_opaque = penumbra::are_opaque(tables);
    let lines = labels[..tables.lines() * tables.samples()].chunks(tables.samples());
    lines.map(|labels| top(labels, &is_opaque)).collect()
}

/// Finds the reflector of each scanline.
pub(super) fn reflectors<T: Real>(view: &View, store: &mut Store<T>) {
    let is_opaque = penumbra::are_opaque(view.tables);
    let lines = store.label.chunks(view.tables.samples());
    for (reflector, labels) in store.effects.shadow.reflectors.iter_mut().zip(lines) {
        *reflector = top(labels, &is_opaque);
    }
}

/// Adds the repeats of each scanline.
pub(super) fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let (lines, samples) = (tables.lines(), tables.samples());
    let spacing = spacing(tables).map(T::of);
    let left = tables.effects.shadow.left_of_average.of::<T>();
    let (surface, labels) = (Surface::new(tables, &store.effects.shadow.reflectors), &store.label);
    let scanlines = chunks_mut(&mut store.amplitude[..lines * samples], samples);
    for_each((0.., scanlines), &|(line, amplitudes)| {
        let top = surface.tops[line] as usize;
        if top >= samples {
            return;
        }
        let index = line * samples + top;
        let returned = T::of(returned(tables, [labels[index - 1], labels[index]], top));
        let (period, met) = surface.stretch::<T>(line);
        let gain = returned * met * surface.directivity(line, spacing);
        for sample in top.max(period)..samples {
            let before = sample - period;
            let repeat = gain * (left[sample] / left[before]) * amplitudes[before];
            let echo = amplitudes[sample];
            amplitudes[sample] = (echo * echo + repeat * repeat).sqrt();
        }
    });
}

/// Amplitude of a repeat by the surface between two labels at a sample relative to the echo, before attenuation.
pub(crate) fn returned(tables: &Tables, labels: [u8; 2], top: usize) -> f64 {
    let [above, below] = labels.map(|label| &tables.label_rows[usize::from(label)]);
    let spread = if is_gas(tables, labels[1]) {
        0.0
    } else {
        spreading(tables) * top as f64
    };
    share(tables) * above.reflection(below) / (1.0 + spread)
}

/// Spread of repeats by bone: growth of the divisor of their amplitude per sample of depth.
pub(crate) fn spreading(tables: &Tables) -> f64 {
    2.0 * tables.sample_mm() / BONE_RADIUS_MM
}

/// Amplitude of a repeat relative to the echo, before attenuation and reflection; 0 without a shadow.
pub fn share(tables: &Tables) -> f64 {
    tables
        .settings
        .effects
        .shadow
        .as_ref()
        .map_or(0.0, |shadow: &Shadow| shadow.reverberation)
}
