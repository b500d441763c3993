//! Euclidean distance transforms and smoothing on grids.

use insonify_base::parallel::{chunks_mut, for_each, for_each_init};

/// Squared distance where there is no seed, mm^2: far beyond any volume and safe to add.
const NO_SEED_MM2: f32 = 1e12;

/// A grid of numbers, x fastest.
pub struct Grid {
    /// Number of cells along each axis.
    pub size: [usize; 3],
    /// Distance between cells, mm.
    pub spacing: [f64; 3],
    /// Values of the cells, x fastest.
    pub values: Vec<f32>,
}

impl Grid {
    fn stride(&self, axis: usize) -> usize {
        self.size[..axis].iter().product()
    }

    /// Replaces each value by the minimum of value plus squared distance along the given axes: the exact squared
    /// Euclidean distance to the zeros (P. Felzenszwalb and D. Huttenlocher, "Distance Transforms of Sampled
    /// Functions", 2012).
    fn transform(&mut self, axes: &[usize]) {
        for &axis in axes {
            let spacing = self.spacing[axis] as f32;
            self.along(axis, |line, scratch| lower_envelope(line, spacing, scratch));
        }
    }

    /// Squared distances to the cells of a set, mm^2, along some axes; very large if the set is empty.
    pub fn squared_distances(set: &[bool], size: [usize; 3], spacing: [f64; 3], axes: &[usize]) -> Self {
        let values = set
            .iter()
            .map(|&inside| if inside { 0.0 } else { NO_SEED_MM2 })
            .collect();
        let mut grid = Self { size, spacing, values };
        grid.transform(axes);
        grid
    }

    /// Applies Gaussian smoothing with a standard deviation in mm; the ends are extended as constants.
    pub fn smooth(&mut self, deviation_mm: f64) {
        for axis in 0..3 {
            let sigma = deviation_mm / self.spacing[axis];
            let reach = (2.5 * sigma).ceil() as usize;
            let kernel: Vec<f32> = (0..=reach)
                .map(|i| (-0.5 * (i as f64 / sigma).powi(2)).exp() as f32)
                .collect();
            self.convolve(axis, &kernel);
        }
    }

    /// Filters along an axis by a symmetric kernel, given from its centre, of any sum; the ends are extended as
    /// constants.
    pub(crate) fn convolve(&mut self, axis: usize, kernel: &[f32]) {
        let total = kernel[0] + 2.0 * kernel[1..].iter().sum::<f32>();
        self.along(axis, |line, scratch| {
            scratch.line.clear();
            scratch.line.extend_from_slice(line);
            let last = line.len() - 1;
            for (sample, value) in line.iter_mut().enumerate() {
                let mut sum = kernel[0] * scratch.line[sample];
                for (step, weight) in kernel.iter().enumerate().skip(1) {
                    sum +=
                        weight * (scratch.line[sample.saturating_sub(step)] + scratch.line[(sample + step).min(last)]);
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
            for_each_init(
                chunks_mut(&mut self.values, slab),
                &Scratch::default,
                &|scratch, slab| {
                    for block in slab.chunks_mut(length * stride) {
                        lines(block, length, stride, scratch, &work);
                    }
                },
            );
            return;
        }
        // Along the last axis a line crosses every slab: columns are gathered, processed, and written back.
        let values = &self.values;
        let mut columns = vec![Vec::new(); self.size[1]];
        for_each_init((0.., &mut columns[..]), &Scratch::default, &|scratch, (j, block)| {
            block.reserve_exact(self.size[0] * length);
            for i in 0..self.size[0] {
                let first = block.len();
                block.extend((0..length).map(|k| values[i + self.size[0] * j + stride * k]));
                work(&mut block[first..], scratch);
            }
        });
        let row = self.size[0];
        for_each((0.., chunks_mut(&mut self.values, stride)), &|(k, slab)| {
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
        line.extend((0..length).map(|sample| block[i + sample * stride]));
        work(&mut line, scratch);
        for (sample, value) in line.iter().enumerate() {
            block[i + sample * stride] = *value;
        }
    }
    scratch.gathered = line;
}

/// Buffers that a thread reuses between lines.
#[derive(Default)]
struct Scratch {
    gathered: Vec<f32>,
    line: Vec<f32>,
    vertices: Vec<usize>,
    bounds: Vec<f32>,
}

/// One-dimensional squared distance transform: the lower envelope of parabolas rooted at the samples.
fn lower_envelope(line: &mut [f32], spacing: f32, scratch: &mut Scratch) {
    if line.iter().all(|&value| value >= NO_SEED_MM2) || line.iter().all(|&value| value == 0.0) {
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
    for sample in (0..copy.len()).filter(|&sample| copy[sample] < NO_SEED_MM2) {
        // A parabola overtaken before its own part begins is nowhere lowest. The first bound is minus
        // infinity, so that one parabola always remains.
        while let (Some(&last), Some(&bound)) = (vertices.last(), bounds.last()) {
            if crossing(last, sample) > bound {
                break;
            }
            vertices.pop();
            bounds.pop();
        }
        bounds.push(
            vertices
                .last()
                .map_or(f32::NEG_INFINITY, |&last| crossing(last, sample)),
        );
        vertices.push(sample);
    }
    let mut nearest = 0;
    for (sample, value) in line.iter_mut().enumerate() {
        let x = sample as f32 * spacing;
        while bounds.get(nearest + 1).is_some_and(|&bound| bound < x) {
            nearest += 1;
        }
        let offset = (sample as f32 - vertices[nearest] as f32) * spacing;
        *value = offset * offset + copy[vertices[nearest]];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_has_its_standard_deviation_in_millimetres() {
        let (size, spacing) = ([41, 31, 21], [0.5, 1.0, 2.0]);
        let middle = 20 + 41 * (15 + 31 * 10);
        let mut values = vec![0.0; 41 * 31 * 21];
        values[middle] = 1.0;
        let mut grid = Grid { size, spacing, values };
        grid.smooth(2.5);
        for (axis, stride) in [1, 41, 41 * 31].into_iter().enumerate() {
            // Along the axis through the middle, where the other two are constant factors.
            let reach = size[axis] as i32 / 2;
            let at = |step: i32| f64::from(grid.values[(middle as i32 + step * stride) as usize]);
            let square = |step: i32| (f64::from(step) * spacing[axis]).powi(2);
            let sum: f64 = (-reach..=reach).map(at).sum();
            let spread: f64 = (-reach..=reach).map(|step| at(step) * square(step)).sum();
            let deviation = (spread / sum).sqrt();
            // The kernel ends at 2.5 standard deviations, which takes 5 %.
            assert!((deviation / 2.5 - 0.97).abs() < 0.04, "{axis}: {deviation}");
        }
    }

    #[test]
    fn distances_equal_a_search_over_all_seeds() {
        let size = [9, 7, 8];
        let spacing = [1.5, 2.0, 3.0];
        let seed = |at: usize| (at * 2_654_435_761).is_multiple_of(61);
        let count: usize = size.iter().product();
        let mut grid = Grid {
            size,
            spacing,
            values: (0..count).map(|at| if seed(at) { 0.0 } else { NO_SEED_MM2 }).collect(),
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
