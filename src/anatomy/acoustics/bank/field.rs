//! Random fields on a periodic grid.

use insonify_base::parallel::{chunks_mut, for_each};
use insonify_base::random::{hash3, seed_words, unit};

/// A periodic grid of voxels; the centre of voxel (0, 0, 0) lies at the origin.
pub(super) struct Grid {
    pub size: [usize; 3],
    pub spacing_mm: [f32; 3],
}

/// Seed of one texture; each of its fields uses a separate stream.
#[derive(Clone, Copy)]
pub(super) struct Seed {
    words: [u32; 2],
}

impl Seed {
    pub(super) fn new(seed: u64, texture: u32) -> Self {
        Self {
            words: seed_words(seed),
        }
        .stream(0x8000_0000 | texture)
    }

    /// Hash words of stream `number`.
    fn stream(self, number: u32) -> Self {
        let [a, b, _] = hash3([number as i32, 0x5eed, 0], self.words);
        Self { words: [a, b] }
    }

    /// Hash function from a lattice point to three words in stream `number`.
    pub(super) fn words(self, number: u32) -> impl Fn([i32; 3]) -> [u32; 3] + Sync {
        let words = self.stream(number).words;
        move |point| hash3(point, words)
    }
}

impl Grid {
    pub(super) fn new(size: [usize; 3], spacing_mm: [f32; 3]) -> Self {
        Self { size, spacing_mm }
    }

    pub(crate) fn period_mm(&self) -> [f32; 3] {
        [0, 1, 2].map(|axis| self.size[axis] as f32 * self.spacing_mm[axis])
    }

    /// Fills the grid with one value per voxel, from its linear index and its position in mm.
    pub(super) fn fill(&self, value: impl Fn(usize, [f32; 3]) -> f32 + Sync) -> Vec<f32> {
        let mut data = vec![0.0; self.size.iter().product()];
        let (nx, ny) = (self.size[0], self.size[1]);
        for_each((0.., chunks_mut(&mut data, nx)), &|(line, row)| {
            let y = (line % ny) as f32 * self.spacing_mm[1];
            let z = (line / ny) as f32 * self.spacing_mm[2];
            for (i, out) in row.iter_mut().enumerate() {
                *out = value(line * nx + i, [i as f32 * self.spacing_mm[0], y, z]);
            }
        });
        data
    }

    /// A stationary Gaussian field with mean 0 and variance 1: white noise smoothed by a Gaussian of standard deviation
    /// `sigma_mm` along each axis. Its autocorrelation is a Gaussian of standard deviation sqrt(2) `sigma_mm`.
    pub(super) fn gaussian(&self, seed: Seed, stream: u32, sigma_mm: [f32; 3]) -> Vec<f32> {
        let words = seed.words(stream);
        let (nx, ny) = (self.size[0], self.size[1]);
        let mut data = self.fill(|index, _| {
            let point = [index % nx, index / nx % ny, index / nx / ny].map(|n| n as i32);
            words(point).iter().map(|&word| unit(word)).sum()
        });
        for (axis, sigma_mm) in sigma_mm.into_iter().enumerate() {
            data = self.smoothed(&data, axis, sigma_mm / self.spacing_mm[axis]);
        }
        standardise(&mut data);
        data
    }

    /// Convolves along `axis` with a Gaussian of `sigma` voxels, periodically.
    fn smoothed(&self, data: &[f32], axis: usize, sigma: f32) -> Vec<f32> {
        /// Number of standard deviations at which the kernel is truncated: the remainder has a thousandth of its
        /// weight.
        const REACH: f32 = 3.3;
        let reach = (REACH * sigma).ceil() as i64;
        let kernel: Vec<f32> = (-reach..=reach)
            .map(|t| (-0.5 * (t as f32 / sigma.max(1e-6)).powi(2)).exp())
            .collect();
        let [nx, ny, nz] = self.size;
        let wrap = |index: usize, step: i64, n: usize| (index as i64 + step).rem_euclid(n as i64) as usize;
        let mut out = vec![0.0f32; data.len()];
        for_each((0.., chunks_mut(&mut out, nx)), &|(line, row)| {
            let (j, k) = (line % ny, line / ny);
            for (&weight, step) in kernel.iter().zip(-reach..) {
                match axis {
                    0 => {
                        let source = &data[line * nx..][..nx];
                        let start = wrap(0, step, nx);
                        let (first, last) = row.split_at_mut(nx - start);
                        add_scaled(first, &source[start..], weight);
                        add_scaled(last, &source[..start], weight);
                    }
                    1 => add_scaled(row, &data[(wrap(j, step, ny) + ny * k) * nx..][..nx], weight),
                    _ => add_scaled(row, &data[(j + ny * wrap(k, step, nz)) * nx..][..nx], weight),
                }
            }
        });
        out
    }
}

fn add_scaled(row: &mut [f32], source: &[f32], weight: f32) {
    for (out, &value) in row.iter_mut().zip(source) {
        *out += weight * value;
    }
}

/// Shifts and scales to mean 0 and variance 1; a constant becomes 0. Sums are computed in a fixed order.
fn standardise(data: &mut [f32]) {
    let count = data.len() as f64;
    let mean = data.iter().map(|&x| f64::from(x)).sum::<f64>() / count;
    let variance = data.iter().map(|&x| (f64::from(x) - mean).powi(2)).sum::<f64>() / count;
    let factor = if variance > 0.0 { 1.0 / variance.sqrt() } else { 0.0 };
    for value in data {
        *value = ((f64::from(*value) - mean) * factor) as f32;
    }
}

/// Converts decibels to amplitudes.
pub(super) fn to_amplitudes(decibels: &mut [f32]) {
    for_each(&mut decibels[..], &|value| *value = 10f32.powf(*value / 20.0));
}

/// Smooth step: 0 below `low`, 1 above `high`.
pub(super) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A bump of height 1 around 0 with half-width `width` at 1/e.
pub(super) fn bump(x: f32, width: f32) -> f32 {
    (-(x / width).powi(2)).exp()
}

// Periodic cells: the Voronoi regions of one jittered point in each box of a lattice (S. Worley, SIGGRAPH 1996).

/// A lattice of boxes over one period, with a point in each.
pub(super) struct Cells {
    counts: [i32; 3],
    box_mm: [f32; 3],
    /// Position of each point within its box, in boxes, and a random number in [0, 1) per cell.
    points: Vec<([f32; 3], f32)>,
}

/// Where a box lies along one axis, relative to a position.
#[derive(Clone, Copy)]
struct Side {
    /// Part of the index of its point.
    stored: usize,
    /// Where it starts, in boxes.
    start: f32,
    /// Least squared distance of its point along the axis, in boxes.
    least: f32,
}

/// Location of a position within its cell.
pub(super) struct Place {
    /// Distance to the nearest wall, mm.
    pub wall_mm: f32,
    /// Absolute cosine of the angle between the wall's normal and each axis: 1 along it, 0 across it.
    pub facing: [f32; 3],
    /// Random number of the cell in [0, 1).
    pub id: f32,
}

/// Fraction of a box over which its point is jittered; the rest avoids sliver cells.
const JITTER: f32 = 0.85;

impl Cells {
    /// Creates cells of about `box_mm`, adjusted so that a whole number fits the period of `grid`.
    pub(super) fn new(grid: &Grid, seed: Seed, stream: u32, box_mm: [f32; 3]) -> Self {
        let period = grid.period_mm();
        let counts = [0, 1, 2].map(|axis| (period[axis] / box_mm[axis]).round().max(1.0) as i32);
        let (position_words, identity) = (seed.words(stream), seed.words(stream + 1));
        let mut points = Vec::new();
        for k in 0..counts[2] {
            for j in 0..counts[1] {
                for i in 0..counts[0] {
                    let offset = position_words([i, j, k]).map(|word| 0.5 + JITTER * (unit(word) - 0.5));
                    points.push((offset, unit(identity([i, j, k])[0])));
                }
            }
        }
        Self {
            counts,
            box_mm: [0, 1, 2].map(|axis| period[axis] / counts[axis] as f32),
            points,
        }
    }

    /// The two points nearest to `position` (mm), of those of its box and the 26 around it: squared distance,
    /// difference, both in boxes, and the number of the cell.
    fn nearest(&self, position: [f32; 3]) -> [(f32, [f32; 3], f32); 2] {
        let scaled = [0, 1, 2].map(|axis| position[axis] / self.box_mm[axis]);
        let sides = [0, 1, 2].map(|axis| self.sides(axis, scaled[axis]));
        let point = |[x, y, z]: [Side; 3]| {
            let (offset, id) = self.points[x.stored + y.stored + z.stored];
            let start = [x.start, y.start, z.start];
            let to = [0, 1, 2].map(|axis| start[axis] + offset[axis] - scaled[axis]);
            (to.iter().map(|x| x * x).sum::<f32>(), to, id)
        };
        // The second nearest point is not farther than both of these.
        let [xs, ys, zs] = sides;
        let closest = usize::from(scaled[0] - scaled[0].floor() >= 0.5) * 2;
        let second_bound = point([xs[1], ys[1], zs[1]]).0.max(point([xs[closest], ys[1], zs[1]]).0);
        let mut nearest = [(f32::INFINITY, [0.0f32; 3], 0.0f32); 2];
        for z in zs {
            for y in ys {
                for x in xs {
                    // Rounded as the distance is, so that no point of the box is nearer.
                    if x.least + y.least + z.least > second_bound {
                        continue;
                    }
                    let candidate = point([x, y, z]);
                    if candidate.0 < nearest[0].0 {
                        nearest = [candidate, nearest[0]];
                    } else if candidate.0 < nearest[1].0 {
                        nearest[1] = candidate;
                    }
                }
            }
        }
        nearest
    }

    /// Boxes before, at and behind a place along an axis.
    fn sides(&self, axis: usize, coordinate: f32) -> [Side; 3] {
        let home = coordinate.floor() as i32;
        let stride = self.counts[..axis].iter().product::<i32>();
        [home - 1, home, home + 1].map(|index| {
            let start = index as f32;
            let [low, high] = [-0.5, 0.5].map(|end| start + (0.5 + JITTER * end) - coordinate);
            let least = if low > 0.0 { low } else { high.min(0.0) };
            Side {
                stored: (index.rem_euclid(self.counts[axis]) * stride) as usize,
                start,
                least: least * least,
            }
        })
    }

    /// Locates `position` (mm). Distances are measured in boxes, so that cells are as flat as their boxes.
    pub(super) fn place(&self, position: [f32; 3]) -> Place {
        let [(first, a, id), (second, b, _)] = self.nearest(position);
        // The wall is the plane second - first = 0; its distance is that difference over its gradient, in mm.
        let gradient = [0, 1, 2].map(|axis| 2.0 * (b[axis] - a[axis]) / self.box_mm[axis]);
        let steepness = gradient.iter().map(|x| x * x).sum::<f32>().sqrt().max(1e-6);
        Place {
            wall_mm: (second - first) / steepness,
            facing: gradient.map(|x| x.abs() / steepness),
            id,
        }
    }
}

// Bright flattened strands in a periodic grid, nearly parallel to its first axis.

/// Geometry and brightness of strands. Each is a ribbon with a soft edge that tapers towards its ends.
pub(super) struct Strands {
    /// Number of strands per 1000 cubic millimetres.
    pub density: f32,
    /// Minimum and maximum length, mm.
    pub length_mm: [f32; 2],
    /// Minimum and maximum thickness across the ribbon (full width at 1/e), mm.
    pub thickness_mm: [f32; 2],
    /// Minimum and maximum width along the ribbon, mm.
    pub width_mm: [f32; 2],
    /// Minimum and maximum peak, dB above the surroundings.
    pub peak_db: [f32; 2],
    /// Largest slope relative to the first axis (tangent).
    pub slope: f32,
    /// Largest angle between a ribbon's normal and the second axis, radians.
    pub roll: f32,
}

/// Height of a strand below which it is ignored, dB.
const FAINT_DB: f32 = 0.3;

impl Strands {
    /// Decibels above 0 in each voxel: those of the brightest strand through it.
    pub(super) fn draw(&self, grid: &Grid, seed: Seed, stream: u32) -> Vec<f32> {
        let period = grid.period_mm();
        let count = (self.density * period.iter().product::<f32>() / 1000.0).round() as i32;
        let streams = [0, 1, 2].map(|n| seed.words(stream + n));
        let mut data = vec![0.0; grid.size.iter().product()];
        for number in 0..count {
            let [a, b, c] = [0, 1, 2].map(|n| streams[n]([number, 0, 0]).map(unit));
            self.draw_strand(grid, &mut data, [a, b, c]);
        }
        data
    }

    fn draw_strand(&self, grid: &Grid, data: &mut [f32], [at, shape, lie]: [[f32; 3]; 3]) {
        let pick = |[low, high]: [f32; 2], share: f32| low + share * (high - low);
        let period = grid.period_mm();
        let centre = [0, 1, 2].map(|axis| at[axis] * period[axis]);
        let half_length = 0.5 * pick(self.length_mm, shape[0] * shape[0]);
        let half_thickness = 0.5 * pick(self.thickness_mm, shape[1]);
        let half_width = 0.5 * pick(self.width_mm, lie[1]);
        let peak = pick(self.peak_db, shape[2]);
        let (sin, cos) = (self.roll * (2.0 * lie[0] - 1.0)).sin_cos();
        let slope = [lie[2], (lie[2] * 7.31).fract()].map(|share| self.slope * (2.0 * share - 1.0));
        // A slight bow, so that no strand is exactly straight.
        let bow = 0.35 * (2.0 * (lie[1] * 5.17).fract() - 1.0);

        let reach = half_thickness.max(half_width) * (peak / FAINT_DB).ln().max(0.0).sqrt();
        let span = |axis: usize, middle: f32, reach: f32| {
            let spacing = grid.spacing_mm[axis];
            (((middle - reach) / spacing).ceil() as i64)..=(((middle + reach) / spacing).floor() as i64)
        };
        let wrap = |index: i64, axis: usize| index.rem_euclid(grid.size[axis] as i64) as usize;
        for i in span(0, centre[0], half_length) {
            let along = i as f32 * grid.spacing_mm[0] - centre[0];
            let share = along / half_length;
            let taper = (1.0 - share * share).max(0.0);
            let middle = [centre[1] + slope[0] * along + bow * taper, centre[2] + slope[1] * along];
            for k in span(2, middle[1], reach) {
                let z = k as f32 * grid.spacing_mm[2] - middle[1];
                for j in span(1, middle[0], reach) {
                    let y = j as f32 * grid.spacing_mm[1] - middle[0];
                    let (across, beside) = (cos * y + sin * z, cos * z - sin * y);
                    let height = peak
                        * taper.sqrt()
                        * (-(across / half_thickness).powi(2) - (beside / half_width).powi(2)).exp();
                    let voxel = wrap(i, 0) + grid.size[0] * (wrap(j, 1) + grid.size[1] * wrap(k, 2));
                    data[voxel] = data[voxel].max(height);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Along every axis neighbours correlate as the field says, exp(-d^2 / (4 sigma^2)), and far apart not at all.
    #[test]
    fn gaussian_fields_have_their_correlation_along_every_axis() {
        let grid = Grid::new([48, 40, 36], [0.5, 0.6, 0.8]);
        let field = grid.gaussian(Seed::new(5, 1), 2, [0.6, 0.9, 1.2]);
        let strides = [1, 48, 48 * 40];
        for (axis, sigma) in [0.6, 0.9, 1.2f32].into_iter().enumerate() {
            for steps in [1, 2, 12] {
                let index = |at: usize| at / strides[axis] % grid.size[axis];
                let pairs = (0..field.len()).filter(|&at| index(at) + steps < grid.size[axis]);
                let products: Vec<f32> = pairs.map(|at| field[at] * field[at + steps * strides[axis]]).collect();
                let correlation = products.iter().sum::<f32>() / products.len() as f32;
                let distance = steps as f32 * grid.spacing_mm[axis];
                let expected = (-distance * distance / (4.0 * sigma * sigma)).exp();
                // Some hundred independent grains along each axis.
                assert!(
                    (correlation - expected).abs() < 0.06,
                    "{axis} {steps}: {correlation} {expected}"
                );
            }
        }
    }

    #[test]
    fn nearest_points_are_those_of_all_27_boxes() {
        let grid = Grid::new([40, 60, 50], [0.6; 3]);
        let seed = Seed::new(7, 3);
        for box_mm in [[5.6, 12.0, 12.0], [32.0, 4.7, 9.0], [4.4; 3]] {
            let cells = Cells::new(&grid, seed, 0, box_mm);
            let words = seed.words(9);
            for trial in 0..20_000 {
                let position = words([trial, 1, 2]).map(|word| 60.0 * unit(word) - 15.0);
                let scaled = [0, 1, 2].map(|axis| position[axis] / cells.box_mm[axis]);
                let mut all = Vec::new();
                for box_at in 0..27 {
                    let step = [box_at % 3 - 1, box_at / 3 % 3 - 1, box_at / 9 - 1];
                    let cell = [0, 1, 2].map(|axis| scaled[axis].floor() as i32 + step[axis]);
                    let [i, j, k] = [0, 1, 2].map(|axis| cell[axis].rem_euclid(cells.counts[axis]));
                    let (offset, id) = cells.points[(i + cells.counts[0] * (j + cells.counts[1] * k)) as usize];
                    let to = [0, 1, 2].map(|axis| cell[axis] as f32 + offset[axis] - scaled[axis]);
                    all.push((to.iter().map(|x| x * x).sum::<f32>(), to, id));
                }
                all.sort_by(|a, b| a.0.total_cmp(&b.0));
                assert_eq!(cells.nearest(position), [all[0], all[1]], "{position:?}");
            }
        }
    }
}
