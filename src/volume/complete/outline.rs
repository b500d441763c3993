//! The outline of the body around labelled anatomy: a signed distance on a coarse grid, smooth from slice to slice.

use rayon::prelude::*;

use super::{CLOSING_MM, GRID_MM, LEAST_MM, WALL_MM};
use crate::volume::LabelVolume;

/// Standard deviation of the smoothing of the outline, within and across slices, mm.
const SMOOTHING_MM: f64 = 9.0;
/// Stands for no seed at all in squared distances, mm^2: far beyond any volume and safe to add.
const NONE: f32 = 1e12;

/// A grid of distances, x fastest.
struct Grid {
    size: [usize; 3],
    spacing: [f64; 3],
    values: Vec<f32>,
}

/// Signed distance to the outer edge of the soft tissue, mm (negative inside).
pub(super) struct Outline {
    distance: Grid,
    /// Voxels to a cell along each axis, and cells of margin before the first voxel.
    cell: [usize; 3],
    margin: [usize; 3],
    slice_axis: usize,
}

impl Outline {
    /// The outline around the labelled voxels of a volume; `None` where nothing is labelled. `layers_mm` is how far
    /// outside it distances are asked for.
    pub(super) fn around(volume: &LabelVolume, layers_mm: f64) -> Option<Self> {
        let spacing = volume.spacing_mm();
        let size = volume.size();
        let upwards = |axis: usize| volume.index_to_world()[(2, axis)].abs() / spacing[axis];
        let slice_axis = (0..3).fold(0, |best, axis| if upwards(axis) > upwards(best) { axis } else { best });
        let cell = [0, 1, 2].map(|axis| ((GRID_MM / spacing[axis]).round() as usize).clamp(1, size[axis]));
        let coarse = [0, 1, 2].map(|axis| spacing[axis] * cell[axis] as f64);
        let reach = CLOSING_MM + WALL_MM + layers_mm;
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
        let in_slice: Vec<usize> = (0..3).filter(|&axis| axis != slice_axis).collect();
        let new = |values: Vec<f32>| Grid {
            size: grid_size,
            spacing: coarse,
            values,
        };
        // Within slices first; then in space, which carries the outline over slices that label little of the body.
        let body = closed(&closed(&labelled, &new, &in_slice), &new, &[0, 1, 2]);
        let mut signed = distance(&body, &new, &[0, 1, 2]);
        let inward = distance(&body.iter().map(|inside| !inside).collect::<Vec<_>>(), &new, &[0, 1, 2]);
        let cap = reach as f32;
        signed
            .values
            .par_iter_mut()
            .zip(&inward.values)
            .for_each(|(value, inside)| *value = (value.sqrt() - inside.sqrt()).clamp(-cap, cap));
        signed.smooth();
        let near_label = distance(&labelled, &new, &[0, 1, 2]);
        let half_cell = 0.5 * coarse.iter().copied().fold(0.0, f64::max) as f32;
        let (wall, least) = (WALL_MM as f32, LEAST_MM as f32);
        signed
            .values
            .par_iter_mut()
            .zip(&near_label.values)
            .for_each(|(value, &label)| *value = (*value - wall).min(label.sqrt() - half_cell - least));
        signed.smooth_lightly();
        Some(Self {
            distance: signed,
            cell,
            margin,
            slice_axis,
        })
    }

    /// The index axis along which slices lie: the one closest to the world's z.
    pub(super) fn slice_axis(&self) -> usize {
        self.slice_axis
    }

    /// Calls `fill` with each unlabelled voxel of a row (along the first axis) and its distance, mm.
    pub(super) fn along_row(&self, j: usize, k: usize, row: &mut [u8], mut fill: impl FnMut(&mut u8, f64)) {
        let grid = &self.distance;
        let place = |axis: usize, voxel: usize| {
            let at = (voxel as f32 + 0.5) / self.cell[axis] as f32 - 0.5 + self.margin[axis] as f32;
            let at = at.clamp(0.0, (grid.size[axis] - 1) as f32);
            let low = (at as usize).min(grid.size[axis].saturating_sub(2));
            let high = (low + 1).min(grid.size[axis] - 1);
            (low, high, at - low as f32)
        };
        let (j0, j1, tj) = place(1, j);
        let (k0, k1, tk) = place(2, k);
        let start = |j: usize, k: usize| grid.size[0] * (j + grid.size[1] * k);
        let starts = [start(j0, k0), start(j1, k0), start(j0, k1), start(j1, k1)];
        let weights = [(1.0 - tj) * (1.0 - tk), tj * (1.0 - tk), (1.0 - tj) * tk, tj * tk];
        let column = |i: usize| -> f32 { starts.iter().zip(weights).map(|(s, w)| w * grid.values[s + i]).sum() };
        let mut known = (usize::MAX, 0.0, 0.0);
        for (i, voxel) in row.iter_mut().enumerate() {
            if *voxel != 0 {
                continue;
            }
            let (i0, i1, ti) = place(0, i);
            if known.0 != i0 {
                known = (i0, column(i0), column(i1));
            }
            fill(voxel, f64::from(known.1 + (known.2 - known.1) * ti));
        }
    }
}

/// Squared distances to the cells of a set, mm^2, along some axes.
fn distance(set: &[bool], new: &impl Fn(Vec<f32>) -> Grid, axes: &[usize]) -> Grid {
    let mut grid = new(set.iter().map(|&inside| if inside { 0.0 } else { NONE }).collect());
    grid.transform(axes);
    grid
}

/// Closing of a set by a ball (a disc, in two axes): dilated, then worn back by the same radius.
fn closed(set: &[bool], new: &impl Fn(Vec<f32>) -> Grid, axes: &[usize]) -> Vec<bool> {
    let radius = (CLOSING_MM * CLOSING_MM) as f32;
    let dilated = distance(set, new, axes);
    let beyond: Vec<bool> = dilated.values.iter().map(|&squared| squared > radius).collect();
    let from_beyond = distance(&beyond, new, axes);
    set.iter()
        .zip(&from_beyond.values)
        .map(|(&inside, &squared)| inside || squared > radius)
        .collect()
}

/// Which cells hold a labelled voxel.
fn coarse_mask(volume: &LabelVolume, cell: [usize; 3], margin: [usize; 3], size: [usize; 3]) -> Vec<bool> {
    let [nx, ny, nz] = volume.size();
    let mut mask = vec![false; size.iter().product()];
    mask.par_chunks_mut(size[0] * size[1])
        .enumerate()
        .for_each(|(c, slice)| {
            let Some(c) = c.checked_sub(margin[2]) else { return };
            for k in c * cell[2]..((c + 1) * cell[2]).min(nz) {
                for j in 0..ny {
                    let row = &volume.voxels()[nx * (j + ny * k)..][..nx];
                    let line = &mut slice[size[0] * (j / cell[1] + margin[1]) + margin[0]..];
                    for (cells, found) in row.chunks(cell[0]).zip(line) {
                        *found |= cells.iter().any(|&label| label != 0);
                    }
                }
            }
        });
    mask
}

impl Grid {
    fn stride(&self, axis: usize) -> usize {
        self.size[..axis].iter().product()
    }

    /// Replaces each value by the least value plus squared distance along the axes given: the exact squared Euclidean
    /// distance to the zeros (P. Felzenszwalb and D. Huttenlocher, "Distance Transforms of Sampled Functions", 2012).
    fn transform(&mut self, axes: &[usize]) {
        for &axis in axes {
            let spacing = self.spacing[axis] as f32;
            self.along(axis, |line, scratch| lower_envelope(line, spacing, scratch));
        }
    }

    /// Gaussian smoothing; the ends are held constant.
    fn smooth(&mut self) {
        for axis in 0..3 {
            let sigma = SMOOTHING_MM / self.spacing[axis];
            let reach = (2.5 * sigma).ceil() as usize;
            let kernel: Vec<f32> = (0..=reach)
                .map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32)
                .collect();
            let total = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
            self.convolve(axis, &kernel, total);
        }
    }

    /// Takes the corners of cells off the surface: a (1 2 1) filter along each axis.
    fn smooth_lightly(&mut self) {
        for axis in 0..3 {
            self.convolve(axis, &[2.0, 1.0], 4.0);
        }
    }

    fn convolve(&mut self, axis: usize, kernel: &[f32], total: f32) {
        self.along(axis, |line, scratch| {
            scratch.line.clear();
            scratch.line.extend_from_slice(line);
            let last = line.len() - 1;
            for (at, value) in line.iter_mut().enumerate() {
                let mut sum = kernel[0] * scratch.line[at];
                for (step, weight) in kernel.iter().enumerate().skip(1) {
                    sum += weight * (scratch.line[at.saturating_sub(step)] + scratch.line[(at + step).min(last)]);
                }
                *value = sum / total;
            }
        });
    }

    /// Runs `work` on every line along an axis, in parallel over slabs.
    fn along(&mut self, axis: usize, work: impl Fn(&mut [f32], &mut Scratch) + Sync) {
        let (length, stride) = (self.size[axis], self.stride(axis));
        if axis < 2 {
            let slab = self.size[0] * self.size[1];
            self.values
                .par_chunks_mut(slab)
                .for_each_init(Scratch::default, |scratch, slab| {
                    for block in slab.chunks_mut(length * stride) {
                        lines(block, length, stride, scratch, &work);
                    }
                });
            return;
        }
        // Along the last axis a line crosses every slab: columns are gathered, worked on, and put back.
        let values = &self.values;
        let columns: Vec<Vec<f32>> = (0..self.size[1])
            .into_par_iter()
            .map_init(Scratch::default, |scratch, j| {
                let mut block = Vec::with_capacity(self.size[0] * length);
                for i in 0..self.size[0] {
                    let first = block.len();
                    block.extend((0..length).map(|k| values[i + self.size[0] * j + stride * k]));
                    work(&mut block[first..], scratch);
                }
                block
            })
            .collect();
        let row = self.size[0];
        self.values.par_chunks_mut(stride).enumerate().for_each(|(k, slab)| {
            for (line, column) in slab.chunks_mut(row).zip(&columns) {
                for (i, value) in line.iter_mut().enumerate() {
                    *value = column[i * length + k];
                }
            }
        });
    }
}

/// Runs `work` on the lines of a block in which neighbours on a line are `stride` apart.
fn lines(
    block: &mut [f32],
    length: usize,
    stride: usize,
    scratch: &mut Scratch,
    work: &impl Fn(&mut [f32], &mut Scratch),
) {
    if stride == 1 {
        work(block, scratch);
        return;
    }
    let mut line = std::mem::take(&mut scratch.gathered);
    for i in 0..stride {
        line.clear();
        line.extend((0..length).map(|at| block[i + at * stride]));
        work(&mut line, scratch);
        for (at, value) in line.iter().enumerate() {
            block[i + at * stride] = *value;
        }
    }
    scratch.gathered = line;
}

/// Buffers that a thread keeps between lines.
#[derive(Default)]
struct Scratch {
    gathered: Vec<f32>,
    line: Vec<f32>,
    vertices: Vec<usize>,
    bounds: Vec<f32>,
}

/// One-dimensional squared distance transform: the lower envelope of parabolas rooted at the samples.
fn lower_envelope(line: &mut [f32], spacing: f32, scratch: &mut Scratch) {
    if line.iter().all(|&value| value >= NONE) || line.iter().all(|&value| value == 0.0) {
        return;
    }
    let Scratch {
        line: copy,
        vertices,
        bounds,
        ..
    } = scratch;
    copy.clear();
    copy.extend_from_slice(line);
    vertices.clear();
    bounds.clear();
    let crossing = |a: usize, b: usize| {
        let (xa, xb) = (a as f32 * spacing, b as f32 * spacing);
        ((copy[b] - copy[a]) / (xb - xa) + xa + xb) / 2.0
    };
    for at in (0..copy.len()).filter(|&at| copy[at] < NONE) {
        while let (Some(&last), Some(&bound)) = (vertices.last(), bounds.last()) {
            if crossing(last, at) > bound {
                break;
            }
            vertices.pop();
            bounds.pop();
        }
        bounds.push(vertices.last().map_or(f32::NEG_INFINITY, |&last| crossing(last, at)));
        vertices.push(at);
    }
    let mut nearest = 0;
    for (at, value) in line.iter_mut().enumerate() {
        let x = at as f32 * spacing;
        while bounds.get(nearest + 1).is_some_and(|&bound| bound < x) {
            nearest += 1;
        }
        let offset = (at as f32 - vertices[nearest] as f32) * spacing;
        *value = offset * offset + copy[vertices[nearest]];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_equal_a_search_over_all_seeds() {
        let size = [9, 7, 8];
        let spacing = [1.5, 2.0, 3.0];
        let seed = |at: usize| (at * 2_654_435_761).is_multiple_of(61);
        let count: usize = size.iter().product();
        let mut grid = Grid {
            size,
            spacing,
            values: (0..count).map(|at| if seed(at) { 0.0 } else { NONE }).collect(),
        };
        grid.transform(&[0, 1, 2]);
        let index = |at: usize| [at % 9, at / 9 % 7, at / 63];
        for at in 0..count {
            let least = (0..count)
                .filter(|&other| seed(other))
                .map(|other| {
                    (0..3)
                        .map(|axis| ((index(at)[axis] as f64 - index(other)[axis] as f64) * spacing[axis]).powi(2))
                        .sum::<f64>()
                })
                .fold(f64::INFINITY, f64::min);
            assert!((f64::from(grid.values[at]) - least).abs() < 1e-3, "{:?}", index(at));
        }
    }
}
