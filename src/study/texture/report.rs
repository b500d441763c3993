//! Report of a texture as text and as a page.

use std::f64::consts::TAU;
use std::fmt;

use image::GrayImage;

use super::{MAX_LAG, SolidTexture, TextureFigures};
use crate::texture::synthesis::correlations;
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_base::text::escape;
use insonify_imaging::rf::fft::{Complex32, Fft};
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Plot, Series};

/// Names of the axes.
const AXES: [&str; 3] = ["x", "y", "z"];
/// Bins of the histograms.
const BINS: usize = 40;
/// Zoom of the pictures.
const ZOOM: u32 = 3;

fn length(mm: Option<f64>) -> String {
    mm.map_or("-".to_owned(), |mm| format!("{mm:.3}"))
}

impl TextureFigures {
    fn table(&self) -> Table {
        let head = ["solid, mm", "exemplar, mm", "ratio", "seam"].map(Cell::number);
        let table = Table::new([Cell::from("autocorrelation along")].into_iter().chain(head));
        table.with((0..3).map(|axis| {
            let (solid, exemplar) = (self.correlation_mm[axis], self.exemplar_correlation_mm[axis]);
            let ratio = solid
                .zip(exemplar)
                .map_or("-".to_owned(), |(a, b)| format!("{:.2}", a / b));
            let seam = format!("{:.2}", self.seam[axis]);
            [AXES[axis].to_owned(), length(solid), length(exemplar), ratio, seam]
        }))
    }
}

impl fmt::Display for TextureFigures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{0} x {0} x {0} voxels of {1:.3} mm; speckle cell of the exemplar {2:.3} x {3:.3} mm; histogram {4:.2} dB off",
            self.size, self.voxel_mm, self.cell_mm[0], self.cell_mm[1], self.histogram_db
        )?;
        f.write_str(&self.table().text("  ", &[]))
    }
}

impl SolidTexture {
    /// Returns the comparison with the exemplars as one self-contained HTML document; `lines` are those for a scene.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self, lines: &str) -> Result<String, OutputError> {
        let mut page = Page::new("Solid texture from an image");
        page.put(format_args!("<pre class=\"wide\">{}</pre>", escape(lines)));
        page.table(&self.figures.table());
        page.paragraph(
            "soft",
            "Full widths at half maximum. Seam: mean step across the border over that between other neighbours; 1 is no seam.",
        );
        let [width, height] = self.exemplars.xy.size;
        let exemplar = self.picture([width, height], |x, y| self.exemplars.xy.values[y * width + x]);
        let n = self.side;
        let value = |x: usize, y: usize, z: usize| self.level[x + n * (y + n * z)];
        let slices = [
            ("x-y", self.picture([n, n], |a, b| value(a, b, n / 2))),
            ("z-y", self.picture([n, n], |a, b| value(n / 2, b, a))),
            ("x-z", self.picture([n, n], |a, b| value(a, n / 2, b))),
        ];
        let slices = slices
            .iter()
            .map(|(plane, picture)| (picture, format!("solid, {plane} plane")));
        page.pictures(std::iter::once((&exemplar, "exemplar".to_owned())).chain(slices));
        page.plots(&[self.histograms(), self.autocorrelations(), self.spectra()])?;
        Ok(page.finish())
    }

    fn range(&self) -> [f32; 2] {
        let values = || self.exemplars.xy.values.iter().copied();
        [
            values().fold(f32::INFINITY, f32::min),
            values().fold(f32::NEG_INFINITY, f32::max),
        ]
    }

    fn picture(&self, [width, height]: [usize; 2], value: impl Fn(usize, usize) -> f32) -> GrayImage {
        let [low, high] = self.range();
        GrayImage::from_fn(width as u32 * ZOOM, height as u32 * ZOOM, |x, y| {
            let value = value((x / ZOOM) as usize, (y / ZOOM) as usize);
            image::Luma([(255.0 * (value - low) / (high - low)).clamp(0.0, 255.0) as u8])
        })
    }

    fn histograms(&self) -> Plot {
        let [low, high] = self.range();
        let width = (high - low) / BINS as f32;
        let line = |values: &[f32]| {
            let mut counts = [0.0; BINS];
            for value in values {
                counts[(((value - low) / width) as usize).min(BINS - 1)] += 1.0;
            }
            let point = |(bin, count): (usize, f64)| {
                let middle = f64::from(low + (bin as f32 + 0.5) * width);
                [middle, count / values.len() as f64]
            };
            counts.into_iter().enumerate().map(point).collect::<Vec<_>>()
        };
        Plot::new(
            "Histograms",
            Axis::linear("level, dB"),
            Axis::linear("share"),
            vec![
                Series::line("exemplar", 0, line(&self.exemplars.xy.values)),
                Series::line("solid", 1, line(&self.level)),
            ],
        )
    }

    fn autocorrelations(&self) -> Plot {
        let line = |values: Vec<f64>| {
            let points = values.into_iter().enumerate();
            points
                .map(|(lag, value)| [lag as f64 * self.voxel_mm, value])
                .collect::<Vec<_>>()
        };
        let exemplar = &self.exemplars.xy;
        let mut series = vec![
            Series::line("exemplar, columns", 0, line(exemplar.correlations(0, MAX_LAG))),
            Series::line("exemplar, rows", 1, line(exemplar.correlations(1, MAX_LAG))),
        ];
        let solid = |axis: usize| line(correlations(&self.level, self.side, axis, MAX_LAG.min(self.side / 2)));
        series.extend((0..3).map(|axis| Series::line(format!("solid, {}", AXES[axis]), 2 + axis, solid(axis))));
        Plot::new(
            "Autocorrelation",
            Axis::linear("lag, mm"),
            Axis::linear("correlation"),
            series,
        )
    }

    /// Mean power along columns and rows, by frequency.
    fn spectra(&self) -> Plot {
        let (n, exemplar) = (self.side, &self.exemplars.xy);
        let [width, height] = exemplar.size;
        let length = n.min(width).min(height);
        // Lines of equal length in all, as a spectrum depends on it; of the many of the solid some 256 do.
        let solid = |axis: usize| {
            let stride = n.pow(axis as u32);
            let line = |line_index: usize| {
                let start = line_index % stride + line_index / stride * stride * n;
                (0..length).map(|index| self.level[start + index * stride]).collect()
            };
            power(
                &(0..n * n).step_by(1 + n * n / 256).map(line).collect::<Vec<_>>(),
                self.voxel_mm,
            )
        };
        let row = |row: usize| exemplar.values[row * width..row * width + length].to_vec();
        let column = |column: usize| (0..length).map(|row| exemplar.values[row * width + column]).collect();
        let rows: Vec<_> = (0..height).step_by(1 + height / 64).map(row).collect();
        let columns: Vec<_> = (0..width).step_by(1 + width / 64).map(column).collect();
        let mut series = vec![
            Series::line("exemplar, columns", 0, power(&rows, self.voxel_mm)),
            Series::line("exemplar, rows", 1, power(&columns, self.voxel_mm)),
        ];
        series.extend((0..3).map(|axis| Series::line(format!("solid, {}", AXES[axis]), 2 + axis, solid(axis))));
        Plot::new(
            "Power spectra",
            Axis::linear("frequency, 1/mm"),
            Axis::log("power, dB^2"),
            series,
        )
    }
}

/// Mean periodogram of lines of equal length, under a Hann window.
fn power(lines: &[Vec<f32>], step_mm: f64) -> Vec<[f64; 2]> {
    let n = lines.first().map_or(0, Vec::len);
    let hann = |sample: usize| 0.5 - 0.5 * (TAU * sample as f64 / n as f64).cos();
    let windowed = |line: &Vec<f32>| -> Vec<Complex32> {
        let values = line.iter().enumerate();
        values
            .map(|(sample, value)| (hann(sample) as f32 * value).into())
            .collect()
    };
    let mut spectra: Vec<Complex32> = lines.iter().flat_map(windowed).collect();
    Fft::new(n).forward(&mut spectra);
    let mean = |frequency: usize| {
        let powers = spectra.iter().skip(frequency).step_by(n);
        let sum: f64 = powers.map(|value| f64::from(value.norm_sqr()) / n as f64).sum();
        [frequency as f64 / (n as f64 * step_mm), sum / lines.len() as f64]
    };
    (1..=n / 2).map(mean).collect()
}
