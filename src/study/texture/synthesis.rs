//! Solid textures from two-dimensional examples (J. Kopf et al., "Solid texture synthesis from 2D exemplars", ACM
//! Transactions on Graphics 26(3), 2007).
//!
//! Histogram and autocorrelation along each axis are then matched to the exemplars, in turns (after D. J. Heeger and J.
//! R. Bergen, "Pyramid-based texture analysis/synthesis", SIGGRAPH 1995).
//!
//! Every square neighbourhood in the planes of the solid that have an exemplar is to look like some neighbourhood of
//! it. Two steps alternate on three resolutions: each neighbourhood finds its match, and each voxel becomes the mean of
//! what all matches around it say, weighted by their likeness to the power of r - 2 and against values that the solid
//! has too many of. Matches are found by propagation and random search (C. Barnes et al., "PatchMatch", ACM
//! Transactions on Graphics 28(3), 2009) in place of a tree: neighbours are read from the round before, so that the
//! result does not depend on the number of threads. The solid is a torus: it repeats without a seam.

use std::f64::consts::TAU;

use insonify_anatomy::volume::VolumeError;
use insonify_base::parallel::{self, for_each, sort_by};
use insonify_base::random::{hash3, seed_words, unit};
use insonify_base::statistics::full_width;

/// Side of a neighbourhood, voxels.
const SIDE: usize = 8;
/// Voxels of a neighbourhood.
const PATCH: usize = SIDE * SIDE;
/// Exponent r of the distance between neighbourhoods. Kopf et al. take 0.8; steeper weights keep more of the contrast
/// (3.7 for 3.0 of 4 dB of filtered noise).
const EXPONENT: f64 = -1.0;
/// Least distance that counts, share of the variance of the exemplars: perfect matches in two planes do not outweigh
/// the third.
const MIN_DISTANCE_SHARE: f64 = 0.05;
/// Largest factor by which the rows of an exemplar are stretched.
const MAX_STRETCH: f64 = 8.0;
/// Searches for matches before each averaging.
const SEARCHES: usize = 2;
/// Turns of matching spectra and histogram.
const MATCHING_TURNS: usize = 4;
/// Largest gain of a frequency in one turn.
const MAX_GAIN: f64 = 1.3;
/// Number of resolutions, each twice the one before.
const LEVELS: usize = 3;
/// Rounds of matching and averaging on each resolution, coarsest first.
const ROUNDS: [usize; LEVELS] = [24, 16, 10];
/// Bins of the histograms.
const BINS: usize = 32;
/// Random candidates of a neighbourhood in a round, each from half the range of the one before.
const RANDOM_CANDIDATES: usize = 6;
/// Least side of an exemplar, pixels: two neighbourhoods at the coarsest resolution.
pub const MIN: usize = (2 * SIDE) << (LEVELS - 1);

/// Example of a texture: values in rows.
#[derive(Clone, Debug)]
pub struct Exemplar {
    /// Columns and rows.
    pub size: [usize; 2],
    /// Values row by row.
    pub values: Vec<f32>,
}

/// Exemplars of the planes of a solid; rows run along the second axis of each.
#[derive(Clone, Debug)]
pub struct Exemplars {
    /// Columns along x, rows along y.
    pub xy: Exemplar,
    /// Columns along z, rows along y.
    pub zy: Exemplar,
    /// Columns along x, rows along z.
    pub xz: Exemplar,
}

impl Exemplar {
    /// The exemplar with its rows in reverse.
    fn reversed(&self) -> Self {
        let values = self.values.chunks(self.size[0]).rev().flatten().copied();
        Self {
            size: self.size,
            values: values.collect(),
        }
    }

    /// The exemplar with its rows stretched by a factor, as far as enough of them remain.
    fn stretched(&self, factor: f64) -> Self {
        let [width, height] = self.size;
        let factor = factor
            .clamp(1.0 / MAX_STRETCH, MAX_STRETCH)
            .max(MIN as f64 / height as f64);
        let rows = ((height - 1) as f64 * factor) as usize + 1;
        let value = |pixel: usize| {
            let row = ((pixel / width) as f64 / factor).min((height - 1) as f64);
            let low = (row as usize).min(height - 2);
            let share = (row - low as f64) as f32;
            let in_row = |row: usize| self.values[row * width + pixel % width];
            in_row(low) * (1.0 - share) + in_row(low + 1) * share
        };
        Self {
            size: [width, rows],
            values: (0..width * rows).map(value).collect(),
        }
    }

    fn variance(&self) -> f64 {
        self.covariance(0, 0)[0]
    }

    /// Half width at half maximum of the autocorrelation along the columns (0) or rows (1), pixels.
    fn width(&self, axis: usize) -> f64 {
        let max_lag = self.size[axis] / 2;
        full_width(&self.correlations(axis, max_lag), 0.5).unwrap_or(max_lag as f64)
    }

    /// Autocorrelation along the columns (0) or rows (1) at lags of 0 to `max_lag` pixels.
    pub fn correlations(&self, axis: usize, max_lag: usize) -> Vec<f64> {
        normalised(self.covariance(axis, max_lag))
    }

    /// Autocovariance along the columns (0) or rows (1) up to a lag, 0 beyond its extent.
    fn covariance(&self, axis: usize, max_lag: usize) -> Vec<f64> {
        let [width, height] = self.size;
        let mean = self.values.iter().map(|value| f64::from(*value)).sum::<f64>() / self.values.len() as f64;
        let lag = |lag: usize| {
            let [columns, rows] = if axis == 0 {
                [width.saturating_sub(lag), height]
            } else {
                [width, height.saturating_sub(lag)]
            };
            let step = if axis == 0 { lag } else { lag * width };
            let sum: f64 = (0..rows)
                .flat_map(|row| (0..columns).map(move |column| row * width + column))
                .map(|pixel| (f64::from(self.values[pixel]) - mean) * (f64::from(self.values[pixel + step]) - mean))
                .sum();
            sum / (columns * rows).max(1) as f64
        };
        (0..=max_lag).map(lag).collect()
    }

    fn halved(&self) -> Self {
        let size = self.size.map(|n| n / 2);
        let value = |pixel: usize| {
            let [column, row] = [2 * (pixel % size[0]), 2 * (pixel / size[0])];
            let value = |dx: usize, dy: usize| self.values[(row + dy) * self.size[0] + column + dx];
            (value(0, 0) + value(1, 0) + value(0, 1) + value(1, 1)) / 4.0
        };
        Self {
            size,
            values: (0..size[0] * size[1]).map(value).collect(),
        }
    }
}

/// Axes of the three planes: that of the columns and that of the rows.
const PLANES: [[usize; 2]; 3] = [[0, 1], [2, 1], [0, 2]];

/// Solid on one resolution.
struct Solid<'a> {
    side: usize,
    values: Vec<f32>,
    /// Exemplars by plane.
    exemplars: [&'a Exemplar; 3],
    /// Upper left corner of the match of the neighbourhood of each voxel, by plane.
    matches: [Vec<[u16; 2]>; 3],
    /// Distance of each match, as a weight.
    weights: [Vec<f32>; 3],
    seed: [u32; 2],
}

/// Makes a solid of `side`^3 values, x fastest. `progress` receives the completed share.
///
/// # Errors
/// [`VolumeError`] for an exemplar that is too small or not finite, or a side that is not a multiple of 4 from 32
/// to 256.
pub fn synthesise(
    exemplars: &Exemplars,
    side: usize,
    seed: u64,
    progress: &mut dyn FnMut(f64),
) -> Result<Vec<f32>, VolumeError> {
    if !(32..=256).contains(&side) || !side.is_multiple_of(1 << (LEVELS - 1)) {
        return Err(VolumeError::option(
            "size",
            format!("size {side}: expected a multiple of 4 from 32 to 256"),
        ));
    }
    let planes = [&exemplars.xy, &exemplars.zy, &exemplars.xz];
    for exemplar in planes {
        let [width, height] = exemplar.size;
        if width < MIN || height < MIN || exemplar.values.len() != width * height {
            return Err(VolumeError::new(format!(
                "an exemplar of {width} x {height}; expected at least {MIN} x {MIN}"
            )));
        }
        if !exemplar.values.iter().all(|value| value.is_finite()) {
            return Err(VolumeError::new("an exemplar holds values that are not finite"));
        }
    }
    let mut pyramid: Vec<[Exemplar; 3]> = vec![planes.map(Exemplar::clone)];
    for level in 1..LEVELS {
        let finer = &pyramid[level - 1];
        pyramid.push([0, 1, 2].map(|plane| finer[plane].halved()));
    }
    // A round costs eight times more on each finer resolution.
    let cost = |level: usize| (ROUNDS[level] << (3 * level)) as f64;
    let total: f64 = (0..LEVELS).map(cost).sum();
    let mut done = 0.0;
    let mut coarser: Option<Solid<'_>> = None;
    for (level, planes) in pyramid.iter().rev().enumerate() {
        let level_side = side >> (LEVELS - 1 - level);
        let exemplars = planes.each_ref();
        let mut solid = match &coarser {
            None => Solid::random(level_side, exemplars, seed_words(seed)),
            Some(coarser) => Solid::refined(coarser, level_side, exemplars),
        };
        for round in 0..ROUNDS[level] {
            for search in 0..SEARCHES {
                solid.search(round * SEARCHES + search, level);
            }
            solid.average();
            done += (1 << (3 * level)) as f64;
            progress(done / total);
        }
        coarser = Some(solid);
    }
    let mut values = coarser.map(|solid| solid.values).unwrap_or_default();
    exemplars.match_statistics(&mut values, side);
    Ok(values)
}

impl Exemplars {
    /// Exemplars of all planes. Without one of its own the z-y plane takes the first, its rows in reverse, and the x-z
    /// plane the first with its rows stretched to the correlation length of the columns of the z-y plane: the same
    /// exemplar as it is in two planes would be met by a solid that only depends on x + z and y.
    pub fn of(xy: Exemplar, zy: Option<Exemplar>, xz: Option<Exemplar>) -> Self {
        let zy = zy.unwrap_or_else(|| xy.reversed());
        let xz = xz.unwrap_or_else(|| xy.stretched(zy.width(0) / xy.width(1)));
        Self { xy, zy, xz }
    }

    /// All values of the exemplars.
    fn values(&self) -> Vec<f32> {
        let exemplars = [&self.xy, &self.zy, &self.xz];
        exemplars
            .into_iter()
            .flat_map(|exemplar| exemplar.values.iter().copied())
            .collect()
    }

    /// Matches the autocorrelation along each axis, and the histogram.
    fn match_statistics(&self, values: &mut [f32], side: usize) {
        let wanted = [0, 1, 2].map(|axis| {
            let planes = [&self.xy, &self.zy, &self.xz];
            let covariances = planes.iter().zip(PLANES).flat_map(|(exemplar, axes)| {
                let direction = axes.iter().position(|side_axis| *side_axis == axis)?;
                Some(exemplar.covariance(direction, side / 2))
            });
            let covariances: Vec<Vec<f64>> = covariances.collect();
            let mean = (0..=side / 2).map(|lag| {
                covariances.iter().map(|covariance| covariance[lag]).sum::<f64>() / covariances.len() as f64
            });
            spectrum(&mean.collect::<Vec<_>>(), side)
        });
        let like = self.values();
        match_histogram(values, &like);
        for _ in 0..MATCHING_TURNS {
            for (axis, wanted) in wanted.iter().enumerate() {
                let present = spectrum(&covariance(values, side, axis, side / 2), side);
                let strongest = present.iter().copied().fold(0.0, f64::max);
                // Frequencies that the solid lacks are not raised from nothing, and small steps let histogram and
                // spectra settle together.
                let gain = wanted.iter().zip(&present).map(|(wanted, present)| {
                    (wanted / present.max(1e-4 * strongest))
                        .sqrt()
                        .clamp(1.0 / MAX_GAIN, MAX_GAIN)
                });
                filter(values, side, axis, &gain.collect::<Vec<_>>());
            }
            match_histogram(values, &like);
        }
    }
}

fn normalised(covariance: Vec<f64>) -> Vec<f64> {
    covariance.iter().map(|value| value / covariance[0]).collect()
}

/// Autocorrelation of a periodic solid along an axis at lags of 0 to `max_lag` voxels.
pub fn correlations(values: &[f32], side: usize, axis: usize, max_lag: usize) -> Vec<f64> {
    normalised(covariance(values, side, axis, max_lag))
}

/// Autocovariance of a periodic solid along an axis.
fn covariance(values: &[f32], side: usize, axis: usize, max_lag: usize) -> Vec<f64> {
    let stride = side.pow(axis as u32);
    let mean = values.iter().map(|value| f64::from(*value)).sum::<f64>() / values.len() as f64;
    let lag = |lag: usize| {
        let product = |voxel: usize| {
            let index = voxel / stride % side;
            let shifted = voxel - index * stride + (index + lag) % side * stride;
            (f64::from(values[voxel]) - mean) * (f64::from(values[shifted]) - mean)
        };
        (0..values.len()).map(product).sum::<f64>() / values.len() as f64
    };
    parallel::map(0..max_lag + 1, &lag)
}

/// Power at frequencies from 0 to half of the sampling rate from an even autocovariance up to half of the period, under
/// a Hann taper.
fn spectrum(covariance: &[f64], side: usize) -> Vec<f64> {
    let half = side / 2;
    let power_at = |frequency: usize| {
        let sum: f64 = (1..half)
            .map(|lag| {
                let taper = 0.5 + 0.5 * (TAU * lag as f64 / side as f64).cos();
                2.0 * taper * covariance[lag] * (TAU * (frequency * lag) as f64 / side as f64).cos()
            })
            .sum();
        (covariance[0] + sum).max(0.0)
    };
    (0..=half).map(power_at).collect()
}

/// Multiplies the amplitudes of all frequencies along an axis of a periodic solid, by a periodic even kernel.
fn filter(values: &mut [f32], side: usize, axis: usize, gain: &[f64]) {
    let half = side / 2;
    let kernel: Vec<f32> = (0..side)
        .map(|lag| {
            let wave = |frequency: usize| {
                let twice = if frequency == 0 || frequency == half { 1.0 } else { 2.0 };
                twice * gain[frequency] * (TAU * (frequency * lag) as f64 / side as f64).cos()
            };
            ((0..=half).map(wave).sum::<f64>() / side as f64) as f32
        })
        .collect();
    let stride = side.pow(axis as u32);
    let before = values.to_vec();
    for_each((0.., &mut values[..]), &|(voxel, value)| {
        let index = voxel / stride % side;
        let start = voxel - index * stride;
        let weighted =
            |neighbour: usize| kernel[(index + side - neighbour) % side] * before[start + neighbour * stride];
        *value = (0..side).map(weighted).sum();
    });
}

impl<'a> Solid<'a> {
    fn random(side: usize, exemplars: [&'a Exemplar; 3], seed: [u32; 2]) -> Self {
        let count = side * side * side;
        let matches = [0, 1, 2].map(|plane: usize| {
            let corners = (0..count).map(|voxel| anywhere(exemplars[plane], voxel, plane as i32, seed));
            corners.collect::<Vec<_>>()
        });
        let mut solid = Self {
            side,
            values: vec![0.0; count],
            exemplars,
            weights: [0, 1, 2].map(|plane: usize| vec![1.0; matches[plane].len()]),
            matches,
            seed,
        };
        solid.average();
        solid
    }

    fn refined(coarser: &Solid<'_>, side: usize, exemplars: [&'a Exemplar; 3]) -> Self {
        let count = side * side * side;
        let parent = |voxel: usize| {
            let [x, y, z] = [voxel % side, voxel / side % side, voxel / side / side].map(|n| n / 2);
            x + coarser.side * (y + coarser.side * z)
        };
        let matches = [0, 1, 2].map(|plane: usize| {
            let corner = |voxel: usize| {
                let index = [voxel % side, voxel / side % side, voxel / side / side];
                let corner = coarser.matches[plane][parent(voxel)];
                [0, 1].map(|axis| {
                    // The neighbourhood of half the extent in the middle of the coarser one.
                    let fine = 2 * usize::from(corner[axis]) + SIDE / 2 + index[PLANES[plane][axis]] % 2;
                    fine.min(exemplars[plane].size[axis] - SIDE) as u16
                })
            };
            (0..count).map(corner).collect::<Vec<_>>()
        });
        let mut solid = Self {
            side,
            values: (0..count).map(|voxel| coarser.values[parent(voxel)]).collect(),
            exemplars,
            weights: [0, 1, 2].map(|plane: usize| vec![1.0; matches[plane].len()]),
            matches,
            seed: coarser.seed,
        };
        solid.average();
        solid
    }

    /// Strides of the axes.
    fn strides(&self) -> [usize; 3] {
        [1, self.side, self.side * self.side]
    }

    /// Offset of a voxel moved along an axis of the torus.
    #[inline]
    fn moved(&self, voxel: usize, axis: usize, step: isize) -> usize {
        let stride = self.strides()[axis];
        let index = voxel / stride % self.side;
        let next = (index as isize + step).rem_euclid(self.side as isize) as usize;
        voxel - index * stride + next * stride
    }

    /// Values of the neighbourhood whose upper left corner is a voxel.
    fn patch(&self, start: usize, [columns, rows]: [usize; 2]) -> [f32; PATCH] {
        let mut patch = [0.0; PATCH];
        let mut row_start = start;
        for row in 0..SIDE {
            let mut voxel = row_start;
            for column in 0..SIDE {
                patch[row * SIDE + column] = self.values[voxel];
                voxel = self.moved(voxel, columns, 1);
            }
            row_start = self.moved(row_start, rows, 1);
        }
        patch
    }

    /// Improves the match of every neighbourhood.
    fn search(&mut self, round: usize, level: usize) {
        let floor = MIN_DISTANCE_SHARE * PATCH as f64 * self.exemplars[0].variance();
        for plane in 0..3 {
            let exemplar = self.exemplars[plane];
            let old = &self.matches[plane];
            let nearest = parallel::map(0..old.len(), &|voxel| {
                self.best(voxel, plane, exemplar, [round as i32, level as i32])
            });
            let weight = |square: f32| ((f64::from(square) / floor) + 1.0).powf(EXPONENT / 2.0 - 1.0) as f32;
            self.weights[plane] = nearest.iter().map(|(_, square)| weight(*square)).collect();
            self.matches[plane] = nearest.into_iter().map(|(corner, _)| corner).collect();
        }
    }

    fn best(&self, target: usize, plane: usize, exemplar: &Exemplar, [round, level]: [i32; 2]) -> ([u16; 2], f32) {
        let axes = PLANES[plane];
        let patch = self.patch(target, axes);
        let old = &self.matches[plane];
        let largest_corner = exemplar.size.map(|n| n - SIDE);
        let mut best = old[target];
        let mut least = distance(&patch, exemplar, best, f32::INFINITY);
        let mut consider = |corner: [isize; 2]| {
            let corner = [0, 1].map(|axis| corner[axis].clamp(0, largest_corner[axis] as isize) as u16);
            if corner != best {
                let square = distance(&patch, exemplar, corner, least);
                if square < least {
                    (best, least) = (corner, square);
                }
            }
        };
        let corner_of = |voxel: usize| old[voxel].map(|n| n as isize);
        for axis in 0..2 {
            for step in [-1, 1] {
                let mut corner = corner_of(self.moved(target, axes[axis], step));
                corner[axis] -= step;
                consider(corner);
            }
        }
        let start = old[target].map(|n| n as isize);
        let mut reach = largest_corner[0].max(largest_corner[1]) as f64;
        for draw in 0..RANDOM_CANDIDATES {
            // A place of its own in the hash for each draw: 8 draws a round and 4 levels a plane are set aside.
            let word = hash3(
                [target as i32, round * 8 + draw as i32, plane as i32 * 4 + level],
                self.seed,
            );
            let step = [0, 1].map(|axis| ((f64::from(unit(word[axis])) * 2.0 - 1.0) * reach) as isize);
            consider([start[0] + step[0], start[1] + step[1]]);
            reach /= 2.0;
        }
        (best, least)
    }

    /// Sets every voxel to the weighted mean of what the matches around it say.
    fn average(&mut self) {
        let exemplar_values = || {
            self.exemplars
                .into_iter()
                .flat_map(|exemplar| exemplar.values.iter().copied())
        };
        let low = exemplar_values().fold(f32::INFINITY, f32::min);
        let width = ((exemplar_values().fold(f32::NEG_INFINITY, f32::max) - low) / BINS as f32).max(1e-9);
        let bin = |value: f32| (((value - low) / width) as usize).min(BINS - 1);
        let histogram = |values: &mut dyn Iterator<Item = f32>| {
            let (mut counts, mut total) = ([0.0_f32; BINS], 0.0_f32);
            for value in values {
                counts[bin(value)] += 1.0;
                total += 1.0;
            }
            counts.map(|count| count / total.max(1.0))
        };
        let wanted = histogram(&mut exemplar_values());
        let present = histogram(&mut self.values.iter().copied());
        // Values of which there are too many count less.
        let mut bin_weights = [0.0_f32; BINS];
        for bin in 0..BINS {
            let surplus = (present[bin] / wanted[bin].max(1e-4) - 1.0).max(0.0);
            bin_weights[bin] = 1.0 / (1.0 + surplus);
        }
        // A voxel lies in as many neighbourhoods of each plane as they have pixels: steps back from it lead to their
        // corners.
        let values: Vec<f32> = parallel::map(0..self.values.len(), &|voxel| {
            let (mut sum, mut total) = (0.0_f32, 0.0_f32);
            for plane in 0..3 {
                let exemplar = self.exemplars[plane];
                let [columns, rows] = PLANES[plane];
                let mut row_start = voxel;
                for row in 0..SIDE {
                    let mut corner = row_start;
                    for column in 0..SIDE {
                        let [x, y] = self.matches[plane][corner].map(usize::from);
                        let value = exemplar.values[(y + row) * exemplar.size[0] + x + column];
                        let weight = self.weights[plane][corner] * bin_weights[bin(value)];
                        sum += weight * value;
                        total += weight;
                        corner = self.moved(corner, columns, -1);
                    }
                    row_start = self.moved(row_start, rows, -1);
                }
            }
            sum / total
        });
        self.values = values;
    }
}

fn anywhere(exemplar: &Exemplar, voxel: usize, stream: i32, seed: [u32; 2]) -> [u16; 2] {
    let word = hash3([voxel as i32, -1, stream], seed);
    [0, 1].map(|axis| (f64::from(unit(word[axis])) * (exemplar.size[axis] - SIDE + 1) as f64) as u16)
}

/// Squared distance between a neighbourhood and one of an exemplar; at least `limit` where it exceeds that.
#[inline]
fn distance(patch: &[f32; PATCH], exemplar: &Exemplar, [x, y]: [u16; 2], limit: f32) -> f32 {
    let mut sum = 0.0;
    for (row, patch_row) in patch.chunks_exact(SIDE).enumerate() {
        let start = (usize::from(y) + row) * exemplar.size[0] + usize::from(x);
        let exemplar_row = &exemplar.values[start..start + SIDE];
        sum += patch_row
            .iter()
            .zip(exemplar_row)
            .map(|(a, b)| (a - b) * (a - b))
            .sum::<f32>();
        if sum >= limit {
            return sum;
        }
    }
    sum
}

/// Replaces values by those of the same rank among `like`, so that both have the same histogram.
fn match_histogram(values: &mut [f32], like: &[f32]) {
    let mut sorted = like.to_vec();
    sorted.sort_by(f32::total_cmp);
    let mut order: Vec<u32> = (0..values.len() as u32).collect();
    sort_by(&mut order, |&a, &b| {
        values[a as usize].total_cmp(&values[b as usize]).then(a.cmp(&b))
    });
    let count = values.len();
    for (rank, voxel) in order.into_iter().enumerate() {
        values[voxel as usize] = sorted[(rank * sorted.len() + sorted.len() / 2) / count];
    }
}
