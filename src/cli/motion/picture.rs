//! Pictures of motion and strain in colour over the B-mode.

use image::{Rgb, RgbImage};

use super::Motion;
use crate::failure::{Error, usage};
use crate::rf::laid_out;
use crate::terminal;
use insonify_imaging::canvas;
use insonify_imaging::rf::bmode::{envelope, grey, scan_converted, white};
use insonify_imaging::rf::file::Echoes;
use insonify_imaging::rf::motion::Estimate;
use insonify_tracking::probe::{BeamGrid, ImageGrid};

/// Windows over which strain is a slope.
const SLOPE: usize = 9;
/// Opacity of colours over the B-mode.
const OPACITY: f64 = 0.55;

/// Motion (um) or strain (%) of the windows of a frame, of which a picture is drawn; NaN where they are lost.
pub(super) struct Shown {
    pub(super) frame: usize,
    strain: bool,
    values: Vec<f64>,
}

impl Shown {
    pub(super) fn motion(frame: usize, estimates: &[Estimate], _: &[f64], fallback: f64) -> Self {
        let value = |estimate: &Estimate| {
            if estimate.is_trusted(fallback) {
                estimate.axial_um
            } else {
                f64::NAN
            }
        };
        Self {
            frame,
            strain: false,
            values: estimates.iter().map(value).collect(),
        }
    }

    pub(super) fn strain(frame: usize, estimates: &[Estimate], depths: &[f64], fallback: f64) -> Self {
        let lines = estimates.chunks(depths.len());
        Self {
            frame,
            strain: true,
            values: lines.flat_map(|line| slopes(depths, line, fallback)).collect(),
        }
    }

    /// Largest magnitude but for 2 % that false matches may have; 0 without values.
    pub(super) fn size(&self) -> f64 {
        let values = self.values.iter().filter(|value| !value.is_nan());
        let mut sizes: Vec<f64> = values.map(|value| value.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        sizes.get(sizes.len() * 98 / 100).copied().unwrap_or(0.0)
    }
}

impl Motion {
    pub(super) fn picture(&self, echoes: &Echoes, depths: &[f64], shown: &Shown) -> Result<RgbImage, Error> {
        let probe = self.geometry.probe(echoes, self.sampling_mhz, self.speed_m_s)?;
        let Some(probe) = probe else {
            let expected = "give --sampling-mhz and --pitch-mm, or --radius-mm and --angle-deg";
            return Err(usage("a picture needs the geometry of the lines", expected));
        };
        let (beam, image) = laid_out(&probe)?;
        let Shown {
            frame,
            strain,
            ref values,
        } = *shown;
        let envelope = envelope(echoes, frame);
        let below = scan_converted(&grey(&envelope, white(&envelope), 60.0), &beam, &image, 0);
        let count = depths.len();
        if values.iter().all(|value| value.is_nan()) {
            return Err(usage(
                format!("no window of frame {frame} correlates"),
                "leave out --strain and --displacement; the tissue moves too far between frames, or the echoes are noise",
            ));
        }
        // The largest saturate: one false match would otherwise pale all other colours. The bound keeps the scale above
        // 0 in tissue at rest.
        let largest = rounded(shown.size().max(1e-12));
        let unit = if strain { "%" } else { "um" };
        terminal::note(format_args!(
            "frame {frame}: colours from {} {unit} ({}, blue) to {largest} {unit} ({}, red)",
            -largest,
            if strain { "compressed" } else { "towards the probe" },
            if strain { "stretched" } else { "away" }
        ));
        let ends = [depths[0], depths[count - 1]];
        let mut picture = coloured(&below, &beam, &image, values, ends, largest);
        colour_bar(&mut picture, largest, unit);
        Ok(picture)
    }
}

/// Axial strain along a line, %: slopes over some windows; NaN where a window is lost.
fn slopes(depths: &[f64], line: &[Estimate], fallback: f64) -> Vec<f64> {
    let slope = |index: usize| {
        let start = index.saturating_sub(SLOPE / 2);
        let end = (index + SLOPE / 2 + 1).min(line.len());
        let trusted = || {
            depths[start..end]
                .iter()
                .zip(&line[start..end])
                .filter(|(_, estimate)| estimate.is_trusted(fallback))
        };
        let n = trusted().count() as f64;
        if !line[index].is_trusted(fallback) || n < 3.0 {
            return f64::NAN;
        }
        let x = trusted().map(|(depth, _)| depth).sum::<f64>() / n;
        let y = trusted().map(|(_, estimate)| estimate.axial_um).sum::<f64>() / n;
        let (top, bottom) = trusted().fold((0.0, 0.0), |(top, bottom), (depth, estimate)| {
            (
                top + (depth - x) * (estimate.axial_um - y),
                bottom + (depth - x).powi(2),
            )
        });
        // um/mm are per mille.
        0.1 * top / bottom
    };
    (0..line.len()).map(slope).collect()
}

/// Values of windows in colour over grey pixels: blue below 0, red above.
fn coloured(
    below: &[u8],
    beam: &BeamGrid,
    image: &ImageGrid,
    values: &[f64],
    ends: [f64; 2],
    largest: f64,
) -> RgbImage {
    let count = values.len() / beam.lines();
    RgbImage::from_fn(image.width() as u32, image.height() as u32, |x, y| {
        let grey = f64::from(below[y as usize * image.width() + x as usize]);
        let [px, py] = image.to_plane(f64::from(x), f64::from(y));
        if beam.to_beam(px, py).is_none() {
            return Rgb([0; 3]);
        }
        let (line, depth) = beam.to_line_and_depth(px, py);
        let window = (depth - ends[0]) / (ends[1] - ends[0]) * (count - 1) as f64;
        if !(0.0..=(count - 1) as f64).contains(&window) {
            return Rgb([grey as u8; 3]);
        }
        let (low, share) = (
            (window as usize).min(count - 2),
            window - (window as usize).min(count - 2) as f64,
        );
        let row = line.round().clamp(0.0, (beam.lines() - 1) as f64) as usize * count;
        let value = values[row + low] * (1.0 - share) + values[row + low + 1] * share;
        if value.is_nan() {
            return Rgb([grey as u8; 3]);
        }
        Rgb(tint(grey, value / largest))
    })
}

/// Grey in the colour of a level of -1 (blue) to 1 (red).
fn tint(grey: f64, level: f64) -> [u8; 3] {
    let colour = if level < 0.0 {
        [40.0, 90.0, 255.0]
    } else {
        [255.0, 70.0, 30.0]
    };
    let opacity = OPACITY * level.abs().min(1.0).sqrt();
    colour.map(|part: f64| (grey * (1.0 - opacity) + part * opacity).round() as u8)
}

/// A number above 0, up to two significant digits.
fn rounded(number: f64) -> f64 {
    let unit = 10f64.powf(number.log10().floor() - 1.0);
    // Powers of ten below 1 are not exact: their reciprocals are.
    if unit < 1.0 {
        (number / unit).ceil() / unit.recip().round()
    } else {
        (number / unit).ceil() * unit
    }
}

/// Bar of the colours of a picture with its ends, in its upper right corner.
fn colour_bar(picture: &mut RgbImage, largest: f64, unit: &str) {
    let (width, height) = (picture.width(), picture.height());
    let (left, top, long) = (width.saturating_sub(16), 10, height.saturating_sub(20).min(120));
    for y in 0..long {
        let level = 1.0 - 2.0 * f64::from(y) / f64::from(long.max(2) - 1);
        for x in left..width.saturating_sub(6) {
            picture.put_pixel(x, top + y, Rgb(tint(110.0, level)));
        }
    }
    for (share, value) in [(0.0, largest), (0.5, 0.0), (1.0, -largest)] {
        let name = format!("{value} {unit}");
        let [wide, high] = canvas::text_size(&name, 1);
        let y = f64::from(top) + share * f64::from(long) - 0.5 * f64::from(high);
        canvas::text(picture, [left.saturating_sub(wide + 5), y as u32], &name, 1, [255; 3]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_colours_have_two_digits_and_hold_the_values() {
        let cases = [
            (1724.5, 1800.0),
            (0.0123, 0.013),
            (0.1, 0.1),
            (25.2, 26.0),
            (3.0, 3.0),
            (0.00991, 0.01),
        ];
        for (number, expected) in cases {
            assert_eq!(rounded(number), expected, "{number}");
        }
    }
}
