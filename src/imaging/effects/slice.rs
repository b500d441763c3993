//! Slice: label of every sample, and the constant echo of its tissue.
//!
//! The label is the one with the largest sum of cubic B-spline weights over the 64 voxels around the sample, which
//! smooths the staircase boundaries of coarse segmentations; with `boundary = "vote"` that of the trilinear weights of
//! the eight voxels, with `"nearest"` that of the nearest voxel. Samples outside the volume, or flagged as background
//! by the warp, are background (label index 0). With `beyond = "continue"` the body is continued where a face of the
//! volume cuts it: labels are mirrored at the face, once.
//!
//! ```toml
//! effects.slice = { boundary = "nearest", beyond = "continue" }
//! ```

#[cfg(any(test, feature = "analysis"))]
pub(crate) mod bound;
#[cfg(test)]
mod parity;
#[cfg(test)]
mod physics;

use glam::Vec4;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::buffers::{AMPLITUDE, LABEL, LABEL_ROWS, POSITION, VOXELS};
use super::common::rows;
use super::pass::{Band, Grid, ParamBlock, Pass, Use::*, View, block, bound, reference};
use super::table::{Contradiction, Origin};
use super::{
    Effect, Scanner, Setting, Stage,
    Wanted::{self, Yes},
};
use crate::synth::store::Store;
use crate::synth::tables::Tables;
use insonify_base::parallel::{chunks, chunks_mut, for_each};
use insonify_base::real::Real;
use insonify_base::simd::{Kernel, array, map};
use insonify_tracking::probe::ProbeKind;

/// Sampling of labels. The default, as that of [`Effects`](super::Effects), leaves out what a frame can do without: the
/// usual scene continues the body beyond the volume.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Slice {
    /// Rule for the label near a boundary.
    pub boundary: Boundary,
    /// Continuation of the body beyond the faces of the volume that cut it.
    pub beyond: Beyond,
}

/// Sampling of labels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Slice")]
pub struct Table {
    /// Rule for the label near a boundary. Default `smooth`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub boundary: Option<Boundary>,
    /// Continuation of the body beyond the faces of the volume that cut it. Default `continue`; `void` with
    /// `version = 1` and any `[effects]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beyond: Option<Beyond>,
}

impl Setting for Slice {
    type Stated = Table;

    fn resolved(
        _: &'static str,
        stated: Option<&Table>,
        _: Option<bool>,
        usual: Option<(Scanner, ProbeKind)>,
    ) -> Result<(Self, Option<Origin>), Contradiction> {
        let stated = stated.copied().unwrap_or_default();
        let open = usual.map_or_else(Self::default, |(scanner, _)| <Self as Setting>::usual(scanner));
        let slice = Self {
            boundary: stated.boundary.unwrap_or(open.boundary),
            beyond: stated.beyond.unwrap_or(open.beyond),
        };
        Ok((slice, None))
    }

    fn stated(&self) -> Option<Table> {
        Some(Table {
            boundary: Some(self.boundary),
            beyond: Some(self.beyond),
        })
    }

    fn usual(_: Scanner) -> Self {
        Self {
            beyond: Beyond::Continue,
            ..Self::default()
        }
    }

    fn all() -> Self {
        Self::usual(Scanner::Raw)
    }
}

/// Continuation of the body beyond the faces of the volume that cut it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Beyond {
    /// Void: sound passes without echo or loss.
    #[default]
    Void,
    /// The labels inside, mirrored at the face.
    Continue,
}

/// Rule for the label of a sample near a boundary.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Boundary {
    /// The nearest voxel.
    Nearest,
    /// The largest sum of the trilinear weights of the eight voxels around; ties go to the lowest label index.
    Vote,
    /// The largest sum of cubic B-spline weights of the 64 voxels around, among the labels of the eight.
    #[default]
    Smooth,
}

/// Registry entry.
pub(crate) const EFFECT: Effect = Effect {
    name: "slice",
    stage: Stage::Tissue,
    example: r#"effects.slice = { boundary = "nearest", beyond = "continue" }"#,
    wanted,
    passes: |_| PASSES.iter().collect(),
    ..Effect::PLAIN
};

static PASSES: &[Pass] = &[Pass {
    name: "slice",
    shader: include_str!("../../../shaders/slice.wgsl"),
    entry: "main",
    bindings: &[
        (&POSITION, ReadOwn),
        (&VOXELS, Read),
        (&LABEL_ROWS, Read),
        (&LABEL, WriteOwn),
        (&AMPLITUDE, WriteOwn),
    ],
    params,
    grid: Grid::Samples,
    flips: false,
    cpu: reference!(run),
    bound: bound!(By(bound::carry)),
}];

fn wanted(_: &Tables) -> Wanted {
    Yes("the labels in its plane".into())
}

block! {
    /// Parameter block of `slice.wgsl`.
    struct SliceParams {
        /// First three rows of the world-to-index transform.
        world_to_index: [Vec4; 3],
        /// Voxels along each axis.
        size: [u32; 3],
        /// 2 to smooth, 1 to vote, 0 for the nearest voxel.
        boundary: u32,
        /// Samples along a scanline.
        samples: u32,
        /// 1 to continue the body beyond the volume.
        mirrored: u32,
        /// Padding to a multiple of 16 bytes.
        unused: [u32; 2],
    }
}

fn params(view: &View, _: Band) -> ParamBlock {
    let tables = view.tables;
    ParamBlock::of(&SliceParams {
        world_to_index: rows::<f32>(tables.volume.world_to_index()).map(Vec4::from),
        size: tables.volume.size().map(|n| n as u32),
        boundary: tables.settings.effects.slice.boundary as u32,
        samples: tables.samples() as u32,
        mirrored: u32::from(tables.settings.effects.slice.beyond == Beyond::Continue),
        unused: [0; 2],
    })
}

fn run<T: Real>(view: &View, store: &mut Store<T>) {
    let tables = view.tables;
    let reader = LabelReader::<T>::new(tables);
    let samples = tables.samples();
    let echo: [T; 256] =
        std::array::from_fn(|label| T::of(tables.label_rows.get(label).map_or(0.0, |row| f64::from(row.echo))));
    for_each(
        (
            chunks(&store.position, samples),
            chunks_mut(&mut store.label, samples),
            chunks_mut(&mut store.amplitude, samples),
        ),
        &|(positions, labels, amplitudes)| {
            T::vectorised(Scanline {
                reader: &reader,
                echo: &echo,
                positions,
                labels,
                amplitudes,
            });
        },
    );
}

/// Labels and echoes of a scanline.
struct Scanline<'a, T> {
    reader: &'a LabelReader<'a, T>,
    echo: &'a [T; 256],
    positions: &'a [[T; 4]],
    labels: &'a mut [u8],
    amplitudes: &'a mut [T],
}

impl<T: Real> Kernel for Scanline<'_, T> {
    type Output = ();

    // Voxel indices of a block of samples in vector registers, then their labels one by one.
    #[inline(always)]
    fn run(self) {
        let Self { reader, echo, .. } = self;
        let mut cell = Cell::default();
        for start in (0..self.labels.len()).step_by(BLOCK) {
            let end = self.labels.len().min(start + BLOCK);
            let positions = &self.positions[start..end];
            let labels = &mut self.labels[start..end];
            let amplitudes = &mut self.amplitudes[start..end];
            let mut shifted = [[T::zero(); BLOCK]; 3];
            let mut base = [[0; BLOCK]; 3];
            let mut is_inside = [true; BLOCK];
            for axis in 0..3 {
                let row = reader.world_to_index[axis];
                let size = T::from_signed(reader.size[axis] as i32);
                for (i, position) in positions.iter().enumerate() {
                    let index = row[0] * position[0] + row[1] * position[1] + row[2] * position[2] + row[3];
                    let x = index + T::of(0.5);
                    shifted[axis][i] = x;
                    // Not of `index`: a single position is read from its shifted form alone, and both must
                    // round alike.
                    base[axis][i] = floor(x - T::of(0.5));
                    is_inside[i] &= x >= T::zero() && x < size;
                }
            }
            for (i, label) in labels.iter_mut().enumerate() {
                let position = [shifted[0][i], shifted[1][i], shifted[2][i]];
                *label = if positions[i][3] == T::one() {
                    0
                } else if is_inside[i] {
                    reader.inside(position, [base[0][i], base[1][i], base[2][i]], &mut cell)
                } else {
                    reader.beyond(position, &mut cell)
                };
            }
            for i in 0..labels.len() {
                amplitudes[i] = echo[usize::from(labels[i])];
            }
        }
    }
}

/// Largest integer not above a voxel index from -0.5 on: shifted by one, the truncation is a floor.
#[inline(always)]
fn floor<T: Real>(index: T) -> i32 {
    (index + T::one()).trunc().integer() - 1
}

/// Number of samples whose indices are computed together.
pub(crate) const BLOCK: usize = 64;

/// Number of labels whose shares are summed together.
const TOGETHER: usize = 4;

/// Cache of the voxels around the last sample.
struct Cell<T> {
    base: [i32; 3],
    /// Labels of the eight voxels around it; bits 0, 1, 2 of their number step along x, y, z.
    labels: [u8; 8],
    is_uniform: bool,
    /// Distinct labels of the eight, the number of them (0 if the voxels around are not read yet), and which of them
    /// each of the eight is.
    kinds: [u8; 8],
    count: usize,
    kind: [u8; 8],
    /// For each of the 64 voxels around, row by row along x: 1 for the distinct label that it has, 0 for the others.
    members: [[[[T; TOGETHER]; 4]; 16]; 8 / TOGETHER],
}

impl<T: Real> Default for Cell<T> {
    fn default() -> Self {
        Self {
            base: [i32::MIN; 3],
            labels: [0; 8],
            is_uniform: true,
            kinds: [0; 8],
            count: 0,
            kind: [0; 8],
            members: [[[[T::zero(); TOGETHER]; 4]; 16]; 8 / TOGETHER],
        }
    }
}

/// Distance from a face of the volume within which a mirrored position is kept, voxels: in single precision, 10,000
/// voxels can still be distinguished from it.
pub(crate) const WITHIN: f64 = 1e-3;

/// Index of a voxel that no volume has.
const OUTSIDE: u32 = u32::MAX;

/// Reads labels at world positions.
pub(crate) struct LabelReader<'a, T> {
    voxels: &'a [u8],
    size: [usize; 3],
    world_to_index: [[T; 4]; 3],
    boundary: Boundary,
    mirrored: bool,
}

impl<'a, T: Real> LabelReader<'a, T> {
    /// Creates a reader of the scene's volume.
    pub(crate) fn new(tables: &'a Tables) -> Self {
        Self {
            voxels: tables.volume.voxels(),
            size: tables.volume.size(),
            world_to_index: rows(tables.volume.world_to_index()),
            boundary: tables.settings.effects.slice.boundary,
            mirrored: tables.settings.effects.slice.beyond == Beyond::Continue,
        }
    }

    /// First three rows of the world-to-index transform.
    pub(crate) fn rows(&self) -> &[[T; 4]; 3] {
        &self.world_to_index
    }

    /// Continuous voxel index of a world position.
    #[inline(always)]
    pub(crate) fn index(&self, position: [T; 3]) -> [T; 3] {
        map(self.world_to_index, |row| {
            row[0] * position[0] + row[1] * position[1] + row[2] * position[2] + row[3]
        })
    }

    /// Label index outside the volume, at `shifted` (voxels, from the corner of the first): that of the mirrored
    /// position; 0 outside the body continued beyond the volume.
    #[inline(never)]
    fn beyond(&self, shifted: [T; 3], cell: &mut Cell<T>) -> u8 {
        let Some((shifted, _)) = self.within(shifted) else {
            return 0;
        };
        self.inside(shifted, map(shifted, |x| floor(x - T::of(0.5))), cell)
    }

    /// Label index in the volume at `shifted` (voxels, from the corner of the first), in the cell from voxel `base` on.
    /// `cell` caches the voxels around the previous position.
    #[inline(always)]
    fn inside(&self, shifted: [T; 3], base: [i32; 3], cell: &mut Cell<T>) -> u8 {
        match self.boundary {
            Boundary::Nearest => self.nearest(shifted),
            _ => self.vote(shifted, base, cell),
        }
    }

    /// Position in the volume that corresponds to `shifted` (voxels, from the corner of the first), and the axes along
    /// which it is mirrored; `None` if there is none.
    #[inline(always)]
    pub(crate) fn within(&self, mut shifted: [T; 3]) -> Option<([T; 3], [bool; 3])> {
        let mut mirrored = [false; 3];
        if self.holds(shifted) {
            return Some((shifted, mirrored));
        }
        if !self.mirrored {
            return None;
        }
        let last = |axis: usize| T::from_signed(self.size[axis] as i32 - 1);
        let face = array(|axis| shifted[axis].max(T::zero()).min(last(axis)));
        if self.nearest(face) == 0 {
            return None;
        }
        for axis in 0..3 {
            let size = T::from_signed(self.size[axis] as i32);
            mirrored[axis] = shifted[axis] < T::zero() || shifted[axis] >= size;
            if shifted[axis] < T::zero() {
                shifted[axis] = -shifted[axis];
            } else if shifted[axis] >= size {
                // Slightly below the face for points on it.
                shifted[axis] = (size + size - shifted[axis]).min(size - T::of(WITHIN));
            }
        }
        self.holds(shifted).then_some((shifted, mirrored))
    }

    #[inline(always)]
    fn holds(&self, shifted: [T; 3]) -> bool {
        (0..3).all(|axis| shifted[axis] >= T::zero() && shifted[axis] < T::from_signed(self.size[axis] as i32))
    }

    /// Labels of the voxels nearest to places in voxels from the corner of the first, as many as there are labels.
    #[inline(always)]
    pub(crate) fn nearest_to(&self, shifted: &[[T; BLOCK]; 3], labels: &mut [u8]) {
        let size = map(self.size, |size| T::from_signed(size as i32));
        let pitch = map(self.size, |size| size as u32);
        let mut voxel = [OUTSIDE; BLOCK];
        for i in 0..BLOCK {
            let place: [T; 3] = array(|axis| shifted[axis][i]);
            let is_along = |axis: usize| place[axis] >= T::zero() && place[axis] < size[axis];
            let [x, y, z] = map(place, |x| x.floor().integer() as u32);
            let index = x.wrapping_add(pitch[0].wrapping_mul(y.wrapping_add(pitch[1].wrapping_mul(z))));
            voxel[i] = if is_along(0) & is_along(1) & is_along(2) {
                index
            } else {
                OUTSIDE
            };
        }
        for (i, label) in labels.iter_mut().enumerate() {
            *label = match self.voxels.get(voxel[i] as usize) {
                Some(label) => *label,
                None => self.nearest_beyond([shifted[0][i], shifted[1][i], shifted[2][i]]),
            };
        }
    }

    #[inline(never)]
    fn nearest_beyond(&self, shifted: [T; 3]) -> u8 {
        self.within(shifted).map_or(0, |(shifted, _)| self.nearest(shifted))
    }

    #[inline(always)]
    fn nearest(&self, shifted: [T; 3]) -> u8 {
        let [i, j, k] = map(shifted, |x| x.truncate() as usize);
        self.voxels[i + self.size[0] * (j + self.size[1] * k)]
    }

    #[inline(always)]
    fn vote(&self, shifted: [T; 3], base: [i32; 3], cell: &mut Cell<T>) -> u8 {
        if cell.base != base {
            let columns = self.offsets::<2>(0, base[0], 1);
            let rows = self.offsets::<2>(1, base[1], 1);
            let slabs = self.offsets::<2>(2, base[2], 1);
            let first = self.voxels[columns[0] + rows[0] + slabs[0]];
            let mut differing = 0;
            for (corner, label) in cell.labels.iter_mut().enumerate() {
                *label = self.voxels[columns[corner & 1] + rows[corner >> 1 & 1] + slabs[corner >> 2]];
                differing |= *label ^ first;
            }
            (cell.base, cell.count, cell.is_uniform) = (base, 0, differing == 0);
        }
        // The eight hold more than half of the B-spline's weights, wherever the sample lies among them.
        if cell.is_uniform {
            return cell.labels[0];
        }
        let mut fraction = [T::zero(); 3];
        for axis in 0..3 {
            fraction[axis] = shifted[axis] - T::of(0.5) - T::from_signed(base[axis]);
        }
        match self.boundary {
            Boundary::Smooth => self.smooth(cell, fraction),
            _ => majority(cell.labels, fraction),
        }
    }

    /// Label of a cell with the largest sum of B-spline weights.
    #[inline(always)]
    fn smooth(&self, cell: &mut Cell<T>, fraction: [T; 3]) -> u8 {
        let weights = [spline(fraction[0]), spline(fraction[1]), spline(fraction[2])];
        let nearest = (0..3).fold(0, |corner, axis| {
            corner | usize::from(fraction[axis] > T::of(0.5)) << axis
        });
        // A label with more than half of all weights among the eight inner voxels wins whatever the outer ones are, as
        // it does for most samples.
        let label = cell.labels[nearest];
        if inner_share(&cell.labels, label, &weights) > T::of(HALF + ROUNDED) {
            return label;
        }
        if cell.count == 0 {
            self.widen(cell);
        }
        let mut shares = [T::zero(); 8];
        for group in 0..cell.count.div_ceil(TOGETHER) {
            shares[group * TOGETHER..][..TOGETHER].copy_from_slice(&together(&cell.members[group], &weights));
        }
        let (mut best, mut best_share) = (0, -T::one());
        for number in 0..8 {
            let corner = nearest ^ number;
            let (candidate, share) = (cell.labels[corner], shares[usize::from(cell.kind[corner] & 7)]);
            if share > best_share || (share == best_share && candidate < best) {
                (best, best_share) = (candidate, share);
            }
            // More than half of all weights: no other label has more.
            if share > T::of(HALF) {
                break;
            }
        }
        best
    }

    /// Reads the 64 voxels around a cell.
    #[inline(always)]
    fn widen(&self, cell: &mut Cell<T>) {
        for corner in 0..8 {
            let label = cell.labels[corner];
            let mut known = 0;
            while known < cell.count && cell.kinds[known] != label {
                known += 1;
            }
            if known == cell.count {
                cell.kinds[known] = label;
                cell.count += 1;
            }
            cell.kind[corner] = known as u8;
        }
        // A cubic B-spline reaches one voxel beyond the cell on each side: four by four by four.
        let columns = self.offsets::<4>(0, cell.base[0] - 1, 1);
        let rows = self.offsets::<4>(1, cell.base[1] - 1, 1);
        let slabs = self.offsets::<4>(2, cell.base[2] - 1, 1);
        let mut around = [[0; 4]; 16];
        for (number, row) in around.iter_mut().enumerate() {
            *row = self.row(&columns, rows[number % 4] + slabs[number / 4]);
        }
        let around = around.as_flattened();
        // As masks, for all samples of the cell: the sums of weights are then products without a branch.
        for group in 0..cell.count.div_ceil(TOGETHER) {
            let kinds: [u8; TOGETHER] = array(|member| cell.kinds[group * TOGETHER + member]);
            let members = cell.members[group].as_flattened_mut();
            for voxel in 0..64 {
                members[voxel] = map(kinds, |kind| if around[voxel] == kind { T::one() } else { T::zero() });
            }
        }
    }

    /// Offsets of every `stride`-th voxel along an axis from `first` on, each clamped to the volume.
    #[inline(always)]
    pub(crate) fn offsets<const N: usize>(&self, axis: usize, first: i32, stride: i32) -> [usize; N] {
        let pitch = [1, self.size[0], self.size[0] * self.size[1]][axis];
        let last = self.size[axis] - 1;
        array(|step| ((first + step as i32 * stride).max(0) as usize).min(last) * pitch)
    }

    /// Labels at offsets along the first axis, given the sum of the offsets along the others.
    #[inline(always)]
    pub(crate) fn row<const N: usize>(&self, columns: &[usize; N], offset: usize) -> [u8; N] {
        let mut row = [0; N];
        if columns[1] == columns[0] + 1 && columns[N - 1] == columns[0] + N - 1 {
            row.copy_from_slice(&self.voxels[columns[0] + offset..][..N]);
        } else {
            for lane in 0..N {
                row[lane] = self.voxels[columns[lane] + offset];
            }
        }
        row
    }
}

/// Half of the B-spline weights of the 64 voxels around a sample.
const HALF: f64 = 108.0;
/// Bound on the rounding of their sums, which is at most 0.0015 in single precision.
const ROUNDED: f64 = 0.01;

/// Sum of the B-spline weights of those of the eight voxels around a sample that have a label.
#[inline(always)]
fn inner_share<T: Real>(labels: &[u8; 8], label: u8, [x, y, z]: &[[T; 4]; 3]) -> T {
    let mut share = T::zero();
    for corner in 0..8 {
        let weight = x[1 + (corner & 1)] * y[1 + (corner >> 1 & 1)] * z[1 + (corner >> 2)];
        share += if labels[corner] == label { weight } else { T::zero() };
    }
    share
}

/// Sums of the B-spline weights, along each axis, of the voxels that are members.
#[inline(always)]
fn together<T: Real>(members: &[[[T; TOGETHER]; 4]; 16], [x, y, z]: &[[T; 4]; 3]) -> [T; TOGETHER] {
    let mut sums = [[T::zero(); TOGETHER]; 4];
    for (row, members) in members.iter().enumerate() {
        let weight = y[row % 4] * z[row / 4];
        for column in 0..4 {
            for label in 0..TOGETHER {
                sums[column][label] += weight * members[column][label];
            }
        }
    }
    array(|label| {
        let [a, b, c, d] = [sums[0][label], sums[1][label], sums[2][label], sums[3][label]];
        x[0] * a + x[1] * b + (x[2] * c + x[3] * d)
    })
}

/// Label with the largest sum of trilinear weights; corner bits 0, 1, 2 step along x, y, z.
#[inline(always)]
pub fn majority<T: Real>(labels: [u8; 8], fraction: [T; 3]) -> u8 {
    let weight = |corner: usize, axis: usize| {
        if corner >> axis & 1 == 1 {
            fraction[axis]
        } else {
            T::one() - fraction[axis]
        }
    };
    let weights: [T; 8] = array(|c| weight(c, 0) * weight(c, 1) * weight(c, 2));
    let (mut best, mut best_share) = (labels[0], T::zero());
    for candidate in labels {
        let mut share = T::zero();
        for corner in 0..8 {
            if labels[corner] == candidate {
                share += weights[corner];
            }
        }
        if share > best_share || (share == best_share && candidate < best) {
            (best, best_share) = (candidate, share);
        }
    }
    best
}

/// Weights of the cubic B-spline on the four points around a fraction of a step, times 6: without thirds, samples on
/// faces of voxels have exact sums in any precision.
#[inline(always)]
pub fn spline<T: Real>(t: T) -> [T; 4] {
    let (one, three) = (T::one(), T::of(3.0));
    let u = one - t;
    let inner = |t: T, u: T| one + three * t * (one + t * u);
    [u * u * u, inner(u, t), inner(t, u), t * t * t]
}
