//! Solid textures from ultrasound images: preparation of exemplars, synthesis, and comparison of the result with them.

mod report;
pub mod synthesis;
#[cfg(test)]
mod tests;

use std::io::Write;
use std::path::Path;

use serde::Serialize;

use crate::realism::picture::Picture;
use crate::realism::texture::Patch;
use crate::texture::synthesis::{Exemplar, Exemplars, MIN, correlations, synthesise};
use insonify_anatomy::volume::VolumeError;
use insonify_base::output::{OutputError, atomic};
use insonify_base::statistics::{full_width, median};

/// Standard deviation of the trend that counts as gain, share of the smaller side of a region.
const TREND_SHARE: f64 = 0.25;
/// Standard deviation of the low-pass of `structure`, speckle cells (full widths at half maximum of the
/// autocorrelation).
const LOWPASS_CELLS: f64 = 1.0;
/// Full width at half maximum of a Gaussian in standard deviations.
const FWHM: f64 = 2.354_820_045;
/// Steps of each edge in the search for a rectangle of angle and depth.
const ANGLES: usize = 400;
/// Blocks along each side of an exemplar, whose means are compared.
const BLOCKS: usize = 6;
/// Difference of a block's mean from the median of all from which tissue is uneven: in median differences, and at least
/// in dB.
const UNEVEN: [f64; 2] = [6.0, 2.0];
/// Largest lag of autocorrelations, voxels.
const MAX_LAG: usize = 32;

/// Content of a texture made from an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Only what is coarser than the speckle cell: the scene adds its own speckle.
    Structure,
    /// All of it, with its speckle: for scenes without `effects.speckle`.
    Keep,
}

/// Region of an image: column, row, columns, rows; and the pixel of the virtual apex of a curved array.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Left column, upper row, columns, rows.
    pub window: [usize; 4],
    /// Column and row at which the scanlines meet; `None` for a linear array.
    pub apex_px: Option<[f64; 2]>,
}

/// Preparation of exemplars.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Preparation {
    /// Width and height of a pixel, mm.
    pub pixel_mm: [f64; 2],
    /// Decibels of the 255 grey levels.
    pub range_db: f64,
    /// Content of the texture.
    pub content: Content,
    /// Side of a voxel, mm; by default the smaller side of a pixel, of `structure` half a speckle cell.
    pub voxel_mm: Option<f64>,
}

/// Grid of numbers in rows.
#[derive(Clone, Debug)]
struct Image {
    size: [usize; 2],
    values: Vec<f64>,
}

impl Image {
    fn at(&self, x: f64, y: f64) -> f64 {
        let between = |position: f64, n: usize| {
            let position = position.clamp(0.0, n as f64 - 1.0);
            let low = (position as usize).min(n.saturating_sub(2));
            (low, position - low as f64, (low + 1).min(n - 1))
        };
        let ((x0, u, x1), (y0, v, y1)) = (between(x, self.size[0]), between(y, self.size[1]));
        let value = |x: usize, y: usize| self.values[y * self.size[0] + x];
        let row = |y: usize| value(x0, y) * (1.0 - u) + value(x1, y) * u;
        row(y0) * (1.0 - v) + row(y1) * v
    }

    fn map(&self, function: impl Fn(f64) -> f64) -> Self {
        Self {
            size: self.size,
            values: self.values.iter().map(|value| function(*value)).collect(),
        }
    }

    /// Gaussian smoothing by standard deviations in pixels; the weights are renormalised at the borders.
    fn smoothed(&self, sigma: [f64; 2]) -> Self {
        let mut image = self.clone();
        for axis in 0..2 {
            if sigma[axis] < 1e-6 {
                continue;
            }
            let reach = (3.0 * sigma[axis]).ceil() as isize;
            let kernel: Vec<f64> = (-reach..=reach)
                .map(|offset| (-0.5 * (offset as f64 / sigma[axis]).powi(2)).exp())
                .collect();
            let (n, stride) = (self.size[axis] as isize, if axis == 0 { 1 } else { self.size[0] });
            // A Gaussian is separable: one axis after the other.
            let before = image.values.clone();
            for (index, value) in image.values.iter_mut().enumerate() {
                let position = (index / stride % n as usize) as isize;
                let (mut sum, mut total) = (0.0, 0.0);
                for (step, weight) in (-reach..=reach).zip(&kernel) {
                    if (0..n).contains(&(position + step)) {
                        sum += weight * before[(index as isize + step * stride as isize) as usize];
                        total += weight;
                    }
                }
                *value = sum / total;
            }
        }
        image
    }

    fn exemplar(&self) -> Exemplar {
        Exemplar {
            size: self.size,
            values: self.values.iter().map(|value| *value as f32).collect(),
        }
    }
}

/// An exemplar with the side of its pixels.
#[derive(Clone, Debug)]
pub struct PreparedExemplar {
    /// Values in decibels about 0.
    pub exemplar: Exemplar,
    /// Side of a pixel, mm.
    pub voxel_mm: f64,
    /// Speckle cell along columns and rows (full widths at half maximum of the autocorrelation of the amplitude), mm.
    pub cell_mm: [f64; 2],
}

impl PreparedExemplar {
    /// Column and row, as shares of the sides, of the part that is least like the rest, and by how many decibels it is
    /// brighter; `None` if the tissue is even.
    pub fn uneven(&self) -> Option<([f64; 2], f64)> {
        let [width, height] = self.exemplar.size;
        let mut sums = [[0.0, 0.0]; BLOCKS * BLOCKS];
        for (pixel, level) in self.exemplar.values.iter().enumerate() {
            let [column, row] = [pixel % width * BLOCKS / width, pixel / width * BLOCKS / height];
            let block = &mut sums[row * BLOCKS + column];
            *block = [block[0] + f64::from(*level), block[1] + 1.0];
        }
        let means = sums.map(|[sum, count]| sum / count);
        let middle = median(means.to_vec())?;
        let departures = means.map(|mean| mean - middle);
        let usual = median(departures.iter().map(|departure| departure.abs()).collect())?;
        let blocks = departures.into_iter().enumerate();
        let (block, departure) = blocks.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))?;
        let centre = [block % BLOCKS, block / BLOCKS].map(|index| (index as f64 + 0.5) / BLOCKS as f64);
        let limit = (UNEVEN[0] * usual).max(UNEVEN[1]);
        (departure.abs() > limit).then_some((centre, departure))
    }
}

impl Preparation {
    /// Prepares a region of an image: sector regions are resampled to beam space, compression is undone, the slow trend
    /// of the gain removed, and of `structure` the speckle averaged out.
    ///
    /// # Errors
    /// [`VolumeError`] if the region leaves the image, holds coloured pixels or a single grey level, or gives too few
    /// voxels.
    pub fn prepare(&self, picture: &Picture, region: &Region) -> Result<PreparedExemplar, VolumeError> {
        let refuse = |text: String| VolumeError::new(format!("{}: {text}", picture.name));
        let cut = cut(picture, region).map_err(refuse)?;
        let corner = [region.window[0] as f64, region.window[1] as f64];
        let (grey, pixel_mm) = match region.apex_px {
            Some(apex) => self.beam_space(&cut, corner, apex).map_err(refuse)?,
            None => (cut, self.pixel_mm),
        };
        let flat = self.flattened(&grey, pixel_mm);
        let cell_mm = [0, 1].map(|axis| {
            full_width(&flat.exemplar().correlations(axis, MAX_LAG), pixel_mm[axis])
                .unwrap_or(MAX_LAG as f64 * pixel_mm[axis])
        });
        let envelope = match self.content {
            Content::Keep => flat,
            Content::Structure => {
                let power = flat.map(|a| a * a);
                power
                    .smoothed([0, 1].map(|axis| LOWPASS_CELLS * cell_mm[axis] / pixel_mm[axis]))
                    .map(f64::sqrt)
            }
        };
        // Structure is smooth over a speckle cell: two voxels a cell hold it.
        let finest = pixel_mm[0].min(pixel_mm[1]);
        let default_mm = match self.content {
            Content::Keep => finest,
            Content::Structure => (cell_mm[0].min(cell_mm[1]) / 2.0).max(finest),
        };
        let voxel_mm = self.voxel_mm.unwrap_or(default_mm);
        let level = envelope.map(|a| 20.0 * a.log10());
        // Pixels smaller than voxels are averaged first.
        let level = level.smoothed(pixel_mm.map(|mm| ((voxel_mm / mm).powi(2) - 1.0).max(0.0).sqrt() / FWHM));
        let size = [0, 1].map(|axis| ((level.size[axis] as f64 - 1.0) * pixel_mm[axis] / voxel_mm) as usize + 1);
        if size.iter().any(|n| *n < MIN) {
            return Err(refuse(format!(
                "the region gives {} x {} voxels of {voxel_mm:.3} mm; expected at least {MIN} x {MIN}: take a larger region, or smaller voxels (`--voxel-mm`)",
                size[0], size[1]
            )));
        }
        let scale = pixel_mm.map(|mm| voxel_mm / mm);
        let mut values: Vec<f32> = (0..size[0] * size[1])
            .map(|pixel| level.at((pixel % size[0]) as f64 * scale[0], (pixel / size[0]) as f64 * scale[1]) as f32)
            .collect();
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        values.iter_mut().for_each(|value| *value -= mean);
        if values.iter().all(|value| value.abs() < 1e-3) {
            return Err(refuse("the region has a single grey level; expected tissue".to_owned()));
        }
        Ok(PreparedExemplar {
            exemplar: Exemplar { size, values },
            voxel_mm,
            cell_mm,
        })
    }

    /// Amplitudes of grey levels without the trend in decibels: a quadratic surface, and what is wide beyond it.
    fn flattened(&self, grey: &Image, pixel_mm: [f64; 2]) -> Image {
        let [width, height] = grey.size;
        let values = grey.map(|grey| grey * self.range_db / 255.0).values;
        let surface = Patch { width, height, values };
        let level = Image {
            size: grey.size,
            values: surface.detrended().values,
        };
        let sigma_mm = TREND_SHARE * (width as f64 * pixel_mm[0]).min(height as f64 * pixel_mm[1]);
        let slow = level.smoothed(pixel_mm.map(|mm| sigma_mm / mm));
        let pairs = level.values.iter().zip(&slow.values);
        Image {
            size: grey.size,
            values: pairs.map(|(level, slow)| 10_f64.powf((level - slow) / 20.0)).collect(),
        }
    }

    /// The largest rectangle of angle and depth within a region, with the width of its pixels at half depth. Rows run
    /// away from the array, whichever side of the region it is on.
    fn beam_space(&self, cut: &Image, corner: [f64; 2], apex: [f64; 2]) -> Result<(Image, [f64; 2]), String> {
        let mm = self.pixel_mm;
        // Region relative to the apex, mm, y down: of an array at the bottom, up.
        let left = (corner[0] - apex[0]) * mm[0];
        let right = left + (cut.size[0] as f64 - 1.0) * mm[0];
        let rows = cut.size[1] as f64 - 1.0;
        let is_flipped = apex[1] >= corner[1] + rows;
        let above = if is_flipped {
            apex[1] - corner[1] - rows
        } else {
            corner[1] - apex[1]
        };
        let (top, bottom) = (above * mm[1], (above + rows) * mm[1]);
        if top <= 0.0 {
            return Err(format!(
                "the apex ({}, {}) lies in the rows of the region; expected one above them, or below where the array is at the bottom",
                apex[0], apex[1]
            ));
        }
        let Some([[least_angle, largest_angle], [near, far]]) = largest_sector([left, right], [top, bottom]) else {
            return Err("the region leaves no rectangle of angle and depth below the apex".to_owned());
        };
        let middle = (near + far) / 2.0;
        let step = mm[0] / middle;
        let size = [
            ((largest_angle - least_angle) / step) as usize + 1,
            ((far - near) / mm[1]) as usize + 1,
        ];
        let value = |pixel: usize| {
            let (angle, radius) = (
                least_angle + (pixel % size[0]) as f64 * step,
                near + (pixel / size[0]) as f64 * mm[1],
            );
            let row = (radius * angle.cos() - top) / mm[1];
            cut.at(
                (radius * angle.sin() - left) / mm[0],
                if is_flipped { rows - row } else { row },
            )
        };
        Ok((
            Image {
                size,
                values: (0..size[0] * size[1]).map(value).collect(),
            },
            mm,
        ))
    }
}

/// Angles and radii of the largest sector within a rectangle below its apex, lengths in those of the rectangle; `None`
/// if there is none. The largest has the most area over its perimeter: slender ones are of no use as exemplars.
fn largest_sector([left, right]: [f64; 2], [top, bottom]: [f64; 2]) -> Option<[[f64; 2]; 2]> {
    // Radii between which all angles lie within the rectangle.
    let radii = |[least, largest]: [f64; 2]| {
        let (mut near, mut far) = (top / least.cos().min(largest.cos()), bottom);
        if least > 0.0 || largest < 0.0 {
            far = bottom / least.cos().max(largest.cos());
        }
        // A side on its own side of the apex binds at the far end, one beyond it at the near end.
        for (side, angle, outwards) in [(left, least, -1.0), (right, largest, 1.0)] {
            let limit = side / angle.sin();
            if angle * outwards > 0.0 {
                far = far.min(limit);
            } else if side * outwards < 0.0 {
                near = near.max(limit);
            }
        }
        [near, far]
    };
    let bound = |side: f64| side.atan2(if side < 0.0 { top } else { bottom });
    let (lowest, highest) = (bound(left), -bound(-right));
    let angle = |step: usize| lowest + (highest - lowest) * step as f64 / ANGLES as f64;
    let mut best = (0.0, None);
    for least in 0..ANGLES {
        for largest in least + 1..=ANGLES {
            let angles = [angle(least), angle(largest)];
            let [near, far] = radii(angles);
            let (width, height) = ((angles[1] - angles[0]) * (near + far) / 2.0, far - near);
            let size = width * height / (width + height);
            if height > 0.0 && size > best.0 {
                best = (size, Some([angles, [near, far]]));
            }
        }
    }
    best.1
}

/// Grey levels of a region; the error says why it has no texture.
fn cut(picture: &Picture, region: &Region) -> Result<Image, String> {
    let [x, y, width, height] = region.window;
    let fits = |start: usize, side: usize, size: usize| start.checked_add(side).is_some_and(|end| end <= size);
    if width < 16 || height < 16 || !fits(x, width, picture.width) || !fits(y, height, picture.height) {
        let size = format!("{} x {}", picture.width, picture.height);
        return Err(format!(
            "region {x},{y},{width},{height}; expected at least 16 x 16 pixels within the image of {size}"
        ));
    }
    let inside = (y..y + height).flat_map(|row| (x..x + width).map(move |column| row * picture.width + column));
    let coloured = inside
        .clone()
        .filter(|&pixel| picture.overlay.get(pixel).is_some_and(|covered| *covered))
        .count();
    if coloured > 0 {
        return Err(format!(
            "{coloured} coloured pixels in the region; expected grey tissue without writing"
        ));
    }
    let cut = Image {
        size: [width, height],
        values: inside.map(|pixel| picture.grey[pixel]).collect(),
    };
    let saturated = cut.values.iter().filter(|grey| **grey >= 254.5 || **grey < 0.5).count();
    if 2 * saturated > cut.values.len() {
        return Err("more than half of the region is black or white; expected tissue in between".to_owned());
    }
    Ok(cut)
}

/// Synthesised texture beside its exemplars.
pub struct SolidTexture {
    /// Voxels along each side.
    pub side: usize,
    /// Side of a voxel, mm.
    pub voxel_mm: f64,
    /// Values in decibels, x fastest.
    level: Vec<f32>,
    exemplars: Exemplars,
    /// Figures of the comparison.
    pub figures: TextureFigures,
}

/// Comparison of a texture with its exemplars.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureFigures {
    /// Voxels along each side.
    pub size: usize,
    /// Side of a voxel, mm.
    pub voxel_mm: f64,
    /// Speckle cell of the first exemplar, mm.
    pub cell_mm: [f64; 2],
    /// Mean distance between the quantiles of the solid and of the first exemplar, dB.
    pub histogram_db: f64,
    /// Full width at half maximum of the autocorrelation along x, y, z of the solid, mm; null beyond the largest lag.
    pub correlation_mm: [Option<f64>; 3],
    /// Full width at half maximum of the autocorrelation along x, y, z of the exemplars, mm; null beyond the largest
    /// lag.
    pub exemplar_correlation_mm: [Option<f64>; 3],
    /// Mean step across the seam over that between other neighbours, along x, y, z.
    pub seam: [f64; 3],
}

/// Makes a texture from prepared exemplars.
///
/// # Errors
/// The errors of [`synthesise`].
pub fn make(
    prepared: &PreparedExemplar,
    exemplars: Exemplars,
    side: usize,
    seed: u64,
    progress: &mut dyn FnMut(f64),
) -> Result<SolidTexture, VolumeError> {
    let level = synthesise(&exemplars, side, seed, progress)?;
    let voxel_mm = prepared.voxel_mm;
    let width_mm = |axis: usize| full_width(&correlations(&level, side, axis, MAX_LAG.min(side / 2)), voxel_mm);
    let exemplar_mm = |exemplar: &Exemplar, axis: usize| full_width(&exemplar.correlations(axis, MAX_LAG), voxel_mm);
    let mean = |a: Option<f64>, b: Option<f64>| Some((a? + b?) / 2.0);
    let figures = TextureFigures {
        size: side,
        voxel_mm,
        cell_mm: prepared.cell_mm,
        histogram_db: histogram_distance(&level, &exemplars.xy.values),
        correlation_mm: [0, 1, 2].map(width_mm),
        exemplar_correlation_mm: [
            exemplar_mm(&exemplars.xy, 0),
            // The rows of two planes run along y.
            mean(exemplar_mm(&exemplars.xy, 1), exemplar_mm(&exemplars.zy, 1)),
            exemplar_mm(&exemplars.zy, 0),
        ],
        seam: [0, 1, 2].map(|axis| seam(&level, side, axis)),
    };
    Ok(SolidTexture {
        side,
        voxel_mm,
        level,
        exemplars,
        figures,
    })
}

/// Mean distance between the quantiles of two samples.
fn histogram_distance(a: &[f32], b: &[f32]) -> f64 {
    const QUANTILES: usize = 1000;
    let sorted = |values: &[f32]| {
        let mut values = values.to_vec();
        values.sort_by(f32::total_cmp);
        (0..QUANTILES)
            .map(|quantile| values[(2 * quantile + 1) * values.len() / (2 * QUANTILES)])
            .collect::<Vec<_>>()
    };
    let pairs = sorted(a).into_iter().zip(sorted(b));
    pairs.map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / QUANTILES as f64
}

/// Mean step across the seam of an axis over that between other neighbours.
fn seam(level: &[f32], side: usize, axis: usize) -> f64 {
    let stride = side.pow(axis as u32);
    let (mut across, mut inside) = ([0.0, 0.0], [0.0, 0.0]);
    for voxel in 0..level.len() {
        let index = voxel / stride % side;
        let next = voxel - index * stride + (index + 1) % side * stride;
        let step = f64::from((level[voxel] - level[next]).abs());
        let sums = if index + 1 == side { &mut across } else { &mut inside };
        sums[0] += step;
        sums[1] += 1.0;
    }
    across[0] / across[1] / (inside[0] / inside[1])
}

impl SolidTexture {
    /// Echo amplitudes, x fastest.
    pub fn amplitudes(&self) -> Vec<f32> {
        self.level.iter().map(|level| 10_f32.powf(level / 20.0)).collect()
    }

    /// Writes the texture as a NRRD file of 32-bit amplitudes.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        let (side, mm) = (self.side, self.voxel_mm);
        atomic::write(path, |file| {
            write!(
                file,
                "NRRD0004\n# periodic texture of echo amplitudes\ntype: float\ndimension: 3\nsizes: {side} {side} {side}\n\
                 spacings: {mm} {mm} {mm}\nunits: \"mm\" \"mm\" \"mm\"\nendian: little\nencoding: raw\n\n"
            )?;
            let bytes: Vec<u8> = self.amplitudes().iter().flat_map(|value| value.to_le_bytes()).collect();
            file.write_all(&bytes)
        })
    }
}
