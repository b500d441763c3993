//! Study plots: points and lines on linear or logarithmic axes, as SVG text or PNG pixels.
//!
//! Drawn by `plotters` with a bundled font, so that the same data give the same bytes on every machine.

mod legend;

use std::sync::Once;

use plotters::coord::Shift;
use plotters::coord::combinators::LogCoord;
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::FontStyle;

use insonify_base::number::{ZERO, tick};
use insonify_base::output::OutputError;

/// Width and height of a plot, pixels.
pub const SIZE: [u32; 2] = [1000, 600];
/// Width of the legend beside a plot, pixels.
const LEGEND: i32 = 210;
/// Width of a plot for a page and height of its axes, pixels: small enough for legible lettering at the width of a
/// phone.
const PAGE: [u32; 2] = [460, 330];
/// Width of the axes of a plot for a page over their height, within their labels.
const ASPECT: f64 = (460.0 - 86.0) / (330.0 - 64.0);
/// Half-width of a marker, pixels.
const MARK: i32 = 6;
/// Height of a named row and width of the names, pixels.
const ROW: u32 = 18;
const NAMES: u32 = 270;

/// Colours that can be told apart with any colour vision (M. Okabe and K. Ito, "Color Universal Design", 2008).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(60, 60, 60),
];

/// Plot axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// Label, with the unit.
    pub label: String,
    /// Whether the scale is logarithmic. Values that are not positive are then omitted.
    pub log: bool,
}

impl Axis {
    /// Creates a linear axis.
    pub fn linear(label: &str) -> Self {
        let label = label.to_owned();
        Self { label, log: false }
    }

    /// Creates a logarithmic axis.
    pub fn log(label: &str) -> Self {
        let label = label.to_owned();
        Self { label, log: true }
    }

    fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }

    /// Returns the range of the values with a margin; 1 to 10 if there are none.
    fn range(&self, values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|value| self.shows(*value)) {
            (low, high) = (low.min(value), high.max(value));
        }
        if low > high {
            return 1.0..10.0;
        }
        if self.log {
            let margin = (high / low).powf(0.08).max(1.5);
            let (start, end) = (low / margin, high * margin);
            // A logarithmic axis labels powers of ten only: a range without one is extended to the next on either side.
            let (down, up) = (start.log10().floor(), end.log10().ceil());
            return if up - down > 1.0 {
                start..end
            } else {
                0.999 * 10_f64.powf(down)..1.001 * 10_f64.powf(up)
            };
        }
        // An axis of non-negative values starts at zero, unless they would fill a corner of it.
        let in_a_corner = high > low && high - low < 0.25 * high;
        let from_zero = low >= 0.0 && !in_a_corner;
        let start = if from_zero { 0.0 } else { low };
        let margin = if high > start {
            0.06 * (high - start)
        } else {
            0.5 * high.abs().max(1.0)
        };
        let start = if from_zero { 0.0 } else { low - margin };
        start..high + margin
    }
}

/// Shape of a plotted point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marker {
    /// Filled circle.
    Disc,
    /// Open circle.
    Ring,
    /// Filled square.
    Square,
    /// Filled triangle.
    Triangle,
    /// Two crossed lines.
    Cross,
    /// Open square.
    Frame,
    /// Small filled circle.
    Dot,
    /// No marker, for a line through many points.
    None,
}

impl Marker {
    /// Returns the `n`th of six shapes, modulo six.
    pub fn nth(n: usize) -> Marker {
        use Marker::{Cross, Disc, Frame, Ring, Square, Triangle};
        [Disc, Ring, Square, Triangle, Cross, Frame][n % 6]
    }
}

/// Points with a common colour and marker.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name of the colour in the legend, the same for all series of that colour.
    pub name: String,
    /// Points in the units of the axes.
    pub points: Vec<[f64; 2]>,
    /// Whether a line joins the points in order.
    pub joined: bool,
    /// Marker of the points.
    pub marker: Marker,
    /// Index of the colour, modulo seven.
    pub colour: usize,
}

/// Scatter or line plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Title, drawn above the plot except in a page.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Plotted series.
    pub series: Vec<Series>,
    /// Meanings of the markers, in the order of [`Marker::nth`]; empty if they have none.
    pub markers: Vec<String>,
    /// Points to mark as the best choices (see [`front`](insonify_base::pareto::front)), from left to right, as one
    /// front per set of competing points. A stepped line joins the points of a front if no lines join the series.
    pub front: Vec<Vec<[f64; 2]>>,
    /// True if a unit has the same length along both axes, which are linear then.
    pub equal: bool,
}

impl Series {
    /// Creates points that no line joins.
    pub fn points(name: impl Into<String>, colour: usize, marker: Marker, points: Vec<[f64; 2]>) -> Self {
        Series {
            name: name.into(),
            points,
            joined: false,
            marker,
            colour,
        }
    }

    /// Creates a line without markers.
    pub fn line(name: impl Into<String>, colour: usize, points: Vec<[f64; 2]>) -> Self {
        Series {
            joined: true,
            ..Series::points(name, colour, Marker::None, points)
        }
    }
}

/// Stepped line through points.
fn stairs<'a>(points: impl Iterator<Item = &'a [f64; 2]>) -> Vec<(f64, f64)> {
    let mut steps: Vec<(f64, f64)> = Vec::new();
    for point in points {
        if let Some(&(_, height)) = steps.last() {
            steps.push((point[0], height));
        }
        steps.push((point[0], point[1]));
    }
    steps
}

/// Size below which a value on an axis is shown as 0.
fn smallest(axis: &Axis, range: std::ops::Range<f64>) -> f64 {
    if axis.log {
        0.0
    } else {
        ZERO * (range.end - range.start)
    }
}

/// Ranges widened about their middles to the proportions of the drawing.
fn level(x: std::ops::Range<f64>, y: std::ops::Range<f64>) -> (std::ops::Range<f64>, std::ops::Range<f64>) {
    let (width, height) = (x.end - x.start, (y.end - y.start) * ASPECT);
    let wide = |range: std::ops::Range<f64>, side: f64| {
        let middle = (range.start + range.end) / 2.0;
        middle - side / 2.0..middle + side / 2.0
    };
    (wide(x, width.max(height)), wide(y, width.max(height) / ASPECT))
}

impl Plot {
    /// Creates a plot whose markers have no meaning and whose points do not compete.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis, series: Vec<Series>) -> Self {
        Plot {
            title: title.into(),
            x,
            y,
            series,
            markers: Vec::new(),
            front: Vec::new(),
            equal: false,
        }
    }

    /// Gives a unit the same length along both linear axes.
    pub fn equal(self) -> Self {
        Plot { equal: true, ..self }
    }

    /// Draws the plot as an SVG document.
    ///
    /// # Errors
    /// [`OutputError`] if drawing fails.
    pub fn svg(&self) -> Result<String, OutputError> {
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, (SIZE[0], SIZE[1])).into_drawing_area();
            self.draw(&root, Layout::Alone)?;
        }
        Ok(text)
    }

    /// Draws the plot as a tall SVG document whose linear vertical axis has a named row at 0, -1, -2 and so on.
    ///
    /// # Errors
    /// [`OutputError`] if drawing fails.
    pub fn svg_by_row(&self, rows: &[String]) -> Result<String, OutputError> {
        let mut text = String::new();
        {
            let size = (SIZE[0], ROW * rows.len() as u32 + 120);
            let root = SVGBackend::with_string(&mut text, size).into_drawing_area();
            self.draw(&root, Layout::Rows(rows))?;
        }
        Ok(text)
    }

    /// Draws the plot as an SVG document for a page on a narrow screen: without title or background, the legend below.
    ///
    /// # Errors
    /// [`OutputError`] if drawing fails.
    pub(crate) fn svg_for_page(&self) -> Result<String, OutputError> {
        let mut text = String::new();
        {
            let height = PAGE[1] + self.legend_height() as u32;
            let root = SVGBackend::with_string(&mut text, (PAGE[0], height)).into_drawing_area();
            self.draw(&root, Layout::Page)?;
        }
        Ok(text)
    }

    /// Draws the plot as RGB pixels, three bytes each, of [`SIZE`].
    ///
    /// # Errors
    /// [`OutputError`] if drawing fails.
    pub fn rgb(&self) -> Result<Vec<u8>, OutputError> {
        let mut pixels = vec![0; (3 * SIZE[0] * SIZE[1]) as usize];
        {
            let root = BitMapBackend::with_buffer(&mut pixels, (SIZE[0], SIZE[1])).into_drawing_area();
            self.draw(&root, Layout::Alone)?;
        }
        Ok(pixels)
    }

    fn draw<'a, DB: DrawingBackend + 'a>(
        &self,
        root: &DrawingArea<DB, Shift>,
        layout: Layout<'_>,
    ) -> Result<(), OutputError> {
        static FONT: Once = Once::new();
        FONT.call_once(|| {
            let font = include_bytes!("../../assets/fonts/DejaVuSans-subset.ttf");
            // An unreadable font would appear as failed text in every plot.
            let _ = plotters::style::register_font("sans-serif", FontStyle::Normal, font);
        });
        let points = || self.series.iter().flat_map(|series| &series.points);
        let x = self.x.range(points().map(|point| point[0]));
        let y = match layout {
            Layout::Rows(rows) => 0.5 - rows.len() as f64..0.5,
            _ => self.y.range(points().map(|point| point[1])),
        };
        let (x, y) = if self.equal { level(x, y) } else { (x, y) };
        let linear = RangedCoordf64::from;
        let log = |range: std::ops::Range<f64>| LogCoord::from(range.log_scale());
        match (self.x.log, self.y.log) {
            (false, false) => self.chart(root, layout, linear(x), linear(y)),
            (false, true) => self.chart(root, layout, linear(x), log(y)),
            (true, false) => self.chart(root, layout, log(x), linear(y)),
            (true, true) => self.chart(root, layout, log(x), log(y)),
        }
        .map_err(|cause| OutputError::Plot {
            title: self.title.clone(),
            cause: cause.to_string(),
        })
    }

    /// Points within both axes.
    fn shown<'p>(&'p self, points: &'p [[f64; 2]]) -> impl Iterator<Item = &'p [f64; 2]> {
        points
            .iter()
            .filter(|point| self.x.shows(point[0]) && self.y.shows(point[1]))
    }

    fn chart<'a, DB, X, Y>(
        &self,
        root: &DrawingArea<DB, Shift>,
        layout: Layout<'_>,
        x: X,
        y: Y,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>>
    where
        DB: DrawingBackend + 'a,
        X: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let (axes, legend) = match layout {
            Layout::Alone | Layout::Rows(_) => {
                root.fill(&WHITE)?;
                root.split_horizontally(SIZE[0] as i32 - LEGEND)
            }
            Layout::Page => root.split_vertically(PAGE[1]),
        };
        let mut builder = ChartBuilder::on(&axes);
        let (labels, lettering) = match layout {
            Layout::Alone | Layout::Rows(_) => {
                let (left, y_labels) = match layout {
                    Layout::Rows(rows) => (NAMES, rows.len()),
                    _ => (78, 11),
                };
                let builder = builder.caption(&self.title, ("sans-serif", 22)).margin(16);
                builder.x_label_area_size(52).y_label_area_size(left);
                ([11, y_labels], [17, 14])
            }
            Layout::Page => {
                builder.margin(8).x_label_area_size(48).y_label_area_size(70);
                ([5, 7], [13, 13])
            }
        };
        let smallest = [smallest(&self.x, x.range()), smallest(&self.y, y.range())];
        let mut chart = builder.build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .bold_line_style(BLACK.mix(0.14))
            .light_line_style(BLACK.mix(0.04))
            .axis_style(BLACK.mix(0.6))
            .x_labels(labels[0])
            .y_labels(labels[1])
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .x_label_formatter(&|value| tick(*value, smallest[0]))
            .y_label_formatter(&|value| match layout {
                Layout::Rows(rows) => rows.get(-value.round() as usize).cloned().unwrap_or_default(),
                _ => tick(*value, smallest[1]),
            })
            .axis_desc_style(("sans-serif", lettering[0]))
            .label_style(("sans-serif", lettering[1]))
            .draw()?;
        let joined = self.series.iter().any(|series| series.joined);
        for front in &self.front {
            let style = BLACK.mix(0.35).stroke_width(2);
            let steps = stairs(self.shown(front).filter(|_| !joined));
            chart.draw_series(LineSeries::new(steps, style))?;
            let circle = |point: &[f64; 2]| Circle::new((point[0], point[1]), MARK + 4, style);
            chart.draw_series(self.shown(front).map(circle))?;
        }
        for series in &self.series {
            let colour = colour(series.colour);
            let shown = || self.shown(&series.points).map(|point| (point[0], point[1]));
            if series.joined {
                // Thick lines have mitred corners, which protrude where a line reverses.
                let width = if series.marker == Marker::None { 1 } else { 2 };
                chart.draw_series(LineSeries::new(shown(), colour.stroke_width(width)))?;
            }
            for point in shown() {
                chart.plotting_area().draw(&marker(point, series.marker, colour))?;
            }
        }
        self.legend(&legend, layout)?;
        root.present()
    }
}

/// Layout of a plot.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Layout<'a> {
    /// With title, the legend beside the axes.
    Alone,
    /// Without title or background, the legend below the axes.
    Page,
    /// As [`Layout::Alone`], with these names in place of the numbers of the vertical axis.
    Rows(&'a [String]),
}

fn colour(n: usize) -> RGBAColor {
    COLOURS[n % COLOURS.len()].to_rgba()
}

/// Returns a drawable point of the given shape.
fn marker<'a, DB, C>(centre: C, marker: Marker, colour: RGBAColor) -> DynElement<'a, DB, C>
where
    DB: DrawingBackend + 'a,
    C: Clone + 'static,
{
    let thick = colour.stroke_width(2);
    let corners = [(-MARK + 1, -MARK + 1), (MARK, MARK)];
    match marker {
        Marker::Disc => Circle::new(centre, MARK, colour.filled()).into_dyn(),
        Marker::Ring => Circle::new(centre, MARK, thick).into_dyn(),
        Marker::Square => (EmptyElement::at(centre) + Rectangle::new(corners, colour.filled())).into_dyn(),
        Marker::Triangle => TriangleMarker::new(centre, MARK + 1, colour.filled()).into_dyn(),
        Marker::Cross => Cross::new(centre, MARK, thick).into_dyn(),
        Marker::Dot => Circle::new(centre, MARK / 3, colour.filled()).into_dyn(),
        Marker::Frame => (EmptyElement::at(centre) + Rectangle::new(corners, thick)).into_dyn(),
        Marker::None => EmptyElement::at(centre).into_dyn(),
    }
}

#[cfg(test)]
mod tests;
