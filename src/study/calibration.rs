//! Report of a calibration: figures, lines for a scene, a fragment for PLUS, residuals.

use std::fmt::Write;

use nalgebra::Matrix4;

use insonify_base::machine::today;
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_base::text::escape;
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Marker, Plot, Series};
use insonify_tracking::calibrate::points::ImageCalibration;
use insonify_tracking::calibrate::poses::Poses;
use insonify_tracking::calibrate::{Direction, Pivot, Residual};

/// Bins of the histogram of residuals.
const BINS: usize = 24;

/// A calibration in words and figures.
pub struct Sheet<'a> {
    title: &'static str,
    /// Names and values.
    figures: Vec<[String; 2]>,
    /// Lines for a scenario.
    scene: String,
    /// `Transform` element of a PLUS configuration, if the calibration is one.
    plus: Option<String>,
    residuals: &'a [Residual],
    unit: &'static str,
}

fn row(name: &str, value: impl Into<String>) -> [String; 2] {
    [name.to_owned(), value.into()]
}

fn three(values: [f64; 3], digits: usize) -> String {
    values.map(|value| format!("{value:.digits$}")).join(", ")
}

/// Sixteen numbers row by row, as scenes and PLUS read them.
fn numbers(matrix: &Matrix4<f64>) -> String {
    let rows = [0, 1, 2, 3].map(|row| {
        let cells = [0, 1, 2, 3].map(|column| {
            let rounded = (matrix[(row, column)] * 1e8).round() / 1e8;
            // No negative zero.
            format!("{}", rounded + 0.0)
        });
        cells.join(" ")
    });
    rows.join("  ")
}

fn transform(from: &str, to: &str, matrix: &Matrix4<f64>, error: f64) -> String {
    format!(
        "<Transform From=\"{}\" To=\"{}\"\n  Matrix=\"{}\"\n  Error=\"{error:.6}\" Date=\"{}\" />\n",
        escape(from),
        escape(to),
        numbers(matrix),
        today()
    )
}

impl<'a> Sheet<'a> {
    /// Report of a pivot calibration.
    pub fn pivot(calibration: &'a Pivot, poses: &Poses) -> Self {
        // A pivot determines a place but no axes: the transform takes those of the marker.
        let matrix = Matrix4::new_translation(&calibration.point_mm.into());
        let listed = numbers(&matrix);
        Self {
            title: "Pivot calibration",
            figures: vec![
                row(
                    &format!("point in `{}`, mm", poses.marker),
                    three(calibration.point_mm, 3),
                ),
                row("standard deviations, mm", three(calibration.std_mm, 4)),
                row(
                    &format!("pivot in `{}`, mm", poses.tracker),
                    three(calibration.pivot_mm, 3),
                ),
                row("residual RMS, mm", format!("{:.4}", calibration.rms_mm)),
                row("largest residual, mm", format!("{:.4}", calibration.max_mm)),
                row(
                    "poses",
                    count(calibration.used, calibration.trimmed, calibration.skipped),
                ),
            ],
            scene: format!(
                "# the tip of a needle:\n[needle.motion.sequence]\ntip_to_marker = \"{listed}\"\n\
                 # or the centre of a probe's array, its axes along those of the marker:\n\
                 # [scene.motion.sequence]\n# transducer_to_probe = \"{listed}\"\n"
            ),
            plus: Some(transform(
                &format!("{}Tip", poses.marker),
                &poses.marker,
                &matrix,
                calibration.rms_mm,
            )),
            residuals: &calibration.residuals,
            unit: "mm",
        }
    }

    /// Report of a direction.
    pub fn direction(title: &'static str, calibration: &'a Direction, marker: &str) -> Self {
        Self {
            title,
            figures: vec![
                row(&format!("direction in `{marker}`"), three(calibration.direction, 5)),
                row("deviation RMS, degrees", format!("{:.4}", calibration.rms_deg)),
                row("poses", count(calibration.used, calibration.trimmed, 0)),
            ],
            scene: format!(
                "# with a `tip_to_marker` that does not rotate, as `calibrate pivot` gives it:\n\
                 [needle.motion.sequence]\nshaft_axis = [{}]\n",
                three(calibration.direction, 8)
            ),
            plus: None,
            residuals: &calibration.residuals,
            unit: "degrees",
        }
    }

    /// Report of an image calibration; `array_centre_px` is the pixel of the array's centre, if known.
    pub fn image(calibration: &'a ImageCalibration, marker: &str, array_centre_px: Option<[f64; 2]>) -> Self {
        let matrix = &calibration.image_to_probe.0;
        let [width, height] = calibration.pixel_mm;
        let centre = match array_centre_px {
            Some([column, row]) => format!("array_centre_px = [{column}, {row}]\n"),
            None => "# array_centre_px = [column, row]: the pixel in the middle of the array's face, where the centre line of the image begins\n".to_owned(),
        };
        Self {
            title: "Image calibration",
            figures: vec![
                row("pixel, mm", format!("{width:.5} x {height:.5}")),
                row(
                    "position of the mean pixel, standard deviations, mm",
                    three(calibration.std_mm, 4),
                ),
                row(
                    "rotation about the marker's axes, standard deviations, degrees",
                    three(calibration.std_deg, 4),
                ),
                row(
                    "angle between rows and columns before they are made perpendicular, degrees",
                    format!("{:.2}", calibration.axes_apart_deg),
                ),
                row("residual RMS, mm", format!("{:.4}", calibration.rms_mm)),
                row("largest residual, mm", format!("{:.4}", calibration.max_mm)),
                row(
                    "pixels",
                    count(calibration.used, calibration.trimmed, calibration.skipped),
                ),
            ],
            scene: format!(
                "[scene.motion.sequence]\nimage_to_probe = \"{}\"\n{centre}",
                numbers(matrix)
            ),
            plus: Some(transform("Image", marker, matrix, calibration.rms_mm)),
            residuals: &calibration.residuals,
            unit: "mm",
        }
    }

    /// Returns the report as text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for [name, value] in &self.figures {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{name:<52} {value}");
        }
        let _ = write!(
            text,
            "\nLines for a scenario (in a scene without `scene.`):\n\n{}",
            self.scene
        );
        if let Some(plus) = &self.plus {
            let _ = write!(text, "\nFor `CoordinateDefinitions` of PLUS:\n\n{plus}");
        }
        text
    }

    /// Returns the report as one self-contained HTML document.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self) -> Result<String, OutputError> {
        let mut page = Page::new(self.title);
        let rows = self
            .figures
            .iter()
            .map(|[name, value]| [Cell::from(name.as_str()), Cell::number(value)]);
        page.table(&Table::new(["", ""]).with(rows));
        if !self.residuals.is_empty() {
            page.plots(&[self.histogram(), self.by_pose()])?;
        }
        for (heading, text) in [
            ("Lines for a scenario (in a scene without `scene.`)", Some(&self.scene)),
            ("For PLUS", self.plus.as_ref()),
        ] {
            if let Some(text) = text {
                page.put(format_args!(
                    "<h2>{heading}</h2><pre class=\"wide\">{}</pre>",
                    escape(text)
                ));
            }
        }
        Ok(page.finish())
    }

    fn histogram(&self) -> Plot {
        let used: Vec<f64> = self.residuals.iter().filter(|r| r.used).map(|r| r.value).collect();
        let widest = used.iter().copied().fold(0.0, f64::max).max(1e-9);
        let mut counts = [0_usize; BINS];
        for value in &used {
            counts[((value / widest * BINS as f64) as usize).min(BINS - 1)] += 1;
        }
        let edge = |bin: usize| widest * bin as f64 / BINS as f64;
        let mut points = vec![[0.0, 0.0]];
        for (bin, count) in counts.into_iter().enumerate() {
            points.extend([[edge(bin), count as f64], [edge(bin + 1), count as f64]]);
        }
        points.push([widest, 0.0]);
        Plot::new(
            "Residuals of the used items",
            Axis::linear(&format!("residual, {}", self.unit)),
            Axis::linear("number"),
            vec![Series::line("used", 0, points)],
        )
    }

    fn by_pose(&self) -> Plot {
        let points = |used: bool| {
            let chosen = self.residuals.iter().filter(|r| r.used == used);
            chosen.map(|r| [r.frame as f64, r.value]).collect::<Vec<_>>()
        };
        let mut series = vec![Series::points("used", 0, Marker::Disc, points(true))];
        if self.residuals.iter().any(|r| !r.used) {
            series.push(Series::points("left out", 1, Marker::Cross, points(false)));
        }
        Plot::new(
            "Residuals by frame",
            Axis::linear("frame"),
            Axis::linear(&format!("residual, {}", self.unit)),
            series,
        )
    }
}

fn count(used: usize, trimmed: usize, skipped: usize) -> String {
    let mut text = format!("{used} used");
    if trimmed > 0 {
        let _ = write!(text, ", {trimmed} left out as outliers");
    }
    if skipped > 0 {
        let _ = write!(text, ", {skipped} without a valid pose");
    }
    text
}
