//! Outline of the body around labelled anatomy: a signed distance on a coarse grid, smooth across slices.

use super::{CLOSING_MM, GRID_MM, MIN_MM, WALL_MM};
use crate::volume::LabelVolume;
use crate::volume::distance::Grid;
use insonify_base::cache::cached;
use insonify_base::parallel::{chunks_mut, for_each};

/// Standard deviation of the smoothing of the outline, within and across slices, mm.
const SMOOTHING_MM: f64 = 9.0;
/// Signed distance to the outer edge of the soft tissue, mm (negative inside).
pub(super) struct Outline {
    distance: Grid,
    /// Number of voxels per cell along each axis, and cells of margin before the first voxel.
    cell: [usize; 3],
    margin: [usize; 3],
    slice_axis: usize,
}

impl Outline {
    /// Computes the outline around the labelled voxels of a volume; `None` if nothing is labelled. `layers_mm` is
    /// the largest distance outside it that will be queried.
    pub(super) fn around(volume: &LabelVolume, layers_mm: f64) -> Option<Self> {
        let spacing = volume.spacing_mm();
        let size = volume.size();
        let upwards = |axis: usize| volume.index_to_world()[(2, axis)].abs() / spacing[axis];
        let slice_axis = (0..3).fold(0, |best, axis| if upwards(axis) > upwards(best) { axis } else { best });
        let cell = [0, 1, 2].map(|axis| ((GRID_MM / spacing[axis]).round() as usize).clamp(1, size[axis]));
        let coarse = [0, 1, 2].map(|axis| spacing[axis] * cell[axis] as f64);
        let reach = CLOSING_MM + WALL_MM + layers_mm;
        // No margin across slices: the body goes on beyond the first and the last; empty cells there would
        // close it off with a rounded end.
        let margin = [0, 1, 2].map(|axis| {
            if axis == slice_axis {
                0
            } else {
                (reach / coarse[axis]).ceil() as usize + 2
            }
        });
        let grid_size = [0, 1, 2].map(|axis| size[axis].div_ceil(cell[axis]) + 2 * margin[axis]);
        let labelled = coarse_mask(volume, cell, margin, grid_size);
        if !labelled.contains(&true) {
            return None;
        }
        let seen: Vec<u8> = labelled.iter().map(|&is| u8::from(is)).collect();
        let key = format!(
            "outline {} {grid_size:?} {coarse:?} {slice_axis} {reach}",
            blake3::hash(&seen)
        );
        let bytes = cached(&key, size_of::<f32>() * labelled.len(), || {
            let distance = signed_distance(&labelled, grid_size, coarse, slice_axis, reach);
            bytemuck::cast_slice(&distance.values).to_vec()
        });
        Some(Self {
            distance: Grid {
                size: grid_size,
                spacing: coarse,
                values: bytemuck::pod_collect_to_vec(&bytes),
            },
            cell,
            margin,
            slice_axis,
        })
    }

    /// Index axis of the slices: the one closest to the world's z.
    pub(super) fn slice_axis(&self) -> usize {
        self.slice_axis
    }

    /// Calls `fill` with each unlabelled voxel of a row (along the first axis), its index in the row and its distance,
    /// mm.
    pub(super) fn along_row(&self, j: usize, k: usize, row: &mut [u8], mut fill: impl FnMut(&mut u8, usize, f64)) {
        let grid = &self.distance;
        let cell_range = |axis: usize, voxel: usize| {
            let position = (voxel as f32 + 0.5) / self.cell[axis] as f32 - 0.5 + self.margin[axis] as f32;
            let position = position.clamp(0.0, (grid.size[axis] - 1) as f32);
            let low = (position as usize).min(grid.size[axis].saturating_sub(2));
            let high = (low + 1).min(grid.size[axis] - 1);
            (low, high, position - low as f32)
        };
        let (j0, j1, tj) = cell_range(1, j);
        let (k0, k1, tk) = cell_range(2, k);
        let start = |j: usize, k: usize| grid.size[0] * (j + grid.size[1] * k);
        let starts = [start(j0, k0), start(j1, k0), start(j0, k1), start(j1, k1)];
        let weights = [(1.0 - tj) * (1.0 - tk), tj * (1.0 - tk), (1.0 - tj) * tk, tj * tk];
        let column = |i: usize| -> f32 { starts.iter().zip(weights).map(|(s, w)| w * grid.values[s + i]).sum() };
        let mut known = (usize::MAX, 0.0, 0.0);
        for (i, voxel) in row.iter_mut().enumerate() {
            if *voxel != 0 {
                continue;
            }
            let (i0, i1, ti) = cell_range(0, i);
            if known.0 != i0 {
                known = (i0, column(i0), column(i1));
            }
            fill(voxel, i, f64::from(known.1 + (known.2 - known.1) * ti));
        }
    }
}

/// Signed distance to the outline of the body around labelled cells, mm (negative inside), up to `reach`.
fn signed_distance(labelled: &[bool], size: [usize; 3], spacing: [f64; 3], slice_axis: usize, reach: f64) -> Grid {
    let in_slice: Vec<usize> = (0..3).filter(|&axis| axis != slice_axis).collect();
    let distance = |set: &[bool], axes: &[usize]| Grid::squared_distances(set, size, spacing, axes);
    // Within slices first; then in three dimensions, which extends the outline over slices that label little of
    // the body.
    let body = closed(&closed(labelled, &distance, &in_slice), &distance, &[0, 1, 2]);
    let mut signed = distance(&body, &[0, 1, 2]);
    let inward = distance(&body.iter().map(|inside| !inside).collect::<Vec<_>>(), &[0, 1, 2]);
    let cap = reach as f32;
    for_each((&mut signed.values[..], &inward.values[..]), &|(value, inside)| {
        *value = (value.sqrt() - inside.sqrt()).clamp(-cap, cap)
    });
    signed.smooth(SMOOTHING_MM);
    let near_label = distance(labelled, &[0, 1, 2]);
    let half_cell = 0.5 * spacing.iter().copied().fold(0.0, f64::max) as f32;
    let (wall, least) = (WALL_MM as f32, MIN_MM as f32);
    for_each((&mut signed.values[..], &near_label.values[..]), &|(value, &label)| {
        *value = (*value - wall).min(label.sqrt() - half_cell - least)
    });
    // Smooths corners of cells off the surface.
    (0..3).for_each(|axis| signed.convolve(axis, &[2.0, 1.0]));
    signed
}

/// Morphological closing of a set by a ball (a disc, in two axes): dilation, then erosion by the same radius.
fn closed(set: &[bool], distance: &impl Fn(&[bool], &[usize]) -> Grid, axes: &[usize]) -> Vec<bool> {
    let radius = (CLOSING_MM * CLOSING_MM) as f32;
    let dilated = distance(set, axes);
    let beyond: Vec<bool> = dilated.values.iter().map(|&squared| squared > radius).collect();
    let from_beyond = distance(&beyond, axes);
    set.iter()
        .zip(&from_beyond.values)
        .map(|(&inside, &squared)| inside || squared > radius)
        .collect()
}

/// Marks the cells that contain a labelled voxel.
fn coarse_mask(volume: &LabelVolume, cell: [usize; 3], margin: [usize; 3], size: [usize; 3]) -> Vec<bool> {
    let [nx, ny, nz] = volume.size();
    let mut mask = vec![false; size.iter().product()];
    for_each((0.., chunks_mut(&mut mask, size[0] * size[1])), &|(c, slice)| {
        let Some(c) = c.checked_sub(margin[2]) else { return };
        for k in c * cell[2]..((c + 1) * cell[2]).min(nz) {
            for j in 0..ny {
                let row = &volume.voxels()[nx * (j + ny * k)..][..nx];
                let line = &mut slice[size[0] * (j / cell[1] + margin[1]) + margin[0]..];
                for (cells, labelled) in row.chunks(cell[0]).zip(line) {
                    *labelled |= cells.iter().any(|&label| label != 0);
                }
            }
        }
    });
    mask
}
