//! Plots of a study: points and lines on linear or logarithmic axes, as SVG text and as PNG pixels.
//!
//! Drawn by `plotters` with a font of our own, so that the same data give the same bytes on every machine.

use std::sync::Once;

use plotters::coord::Shift;
use plotters::coord::combinators::LogCoord;
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::FontStyle;

/// Width and height of a plot, pixels.
pub const SIZE: [u32; 2] = [900, 600];

/// Colours that people with any colour vision tell apart (M. Okabe and K. Ito, "Color Universal Design", 2008).
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(60, 60, 60),
];

/// One axis.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    /// What it shows, with the unit.
    pub label: String,
    /// Whether its scale is logarithmic. Values that are not positive are then left out.
    pub log: bool,
}

impl Axis {
    /// A linear axis.
    pub fn linear(label: &str) -> Self {
        let label = label.to_owned();
        Self { label, log: false }
    }

    /// A logarithmic axis.
    pub fn log(label: &str) -> Self {
        let label = label.to_owned();
        Self { label, log: true }
    }

    fn shows(&self, value: f64) -> bool {
        value.is_finite() && (!self.log || value > 0.0)
    }

    /// The range of some values with a margin; 1 to 10 where there are none.
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
            return low / margin..high * margin;
        }
        let margin = if high > low {
            0.06 * (high - low)
        } else {
            0.5 * high.abs().max(1.0)
        };
        // An axis of times or sizes starts at nothing.
        let start = if low >= 0.0 { 0.0 } else { low - margin };
        start..high + margin
    }
}

/// Points of one colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend.
    pub name: String,
    /// Where they lie, in the units of the axes.
    pub points: Vec<[f64; 2]>,
    /// Whether a line joins them in their order.
    pub joined: bool,
}

/// A plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Its title.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// What is plotted.
    pub series: Vec<Series>,
    /// Points to mark as the best choices (see [`pareto`]); joined by steps.
    pub front: Vec<[f64; 2]>,
}

/// Why a plot cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[error("the plot \"{title}\" cannot be drawn: {cause}")]
pub struct PlotError {
    /// Title of the plot.
    pub title: String,
    /// What the drawing library said.
    pub cause: String,
}

/// The points that no other beats in both coordinates, both better when smaller, from left to right.
pub fn pareto(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let mut sorted: Vec<[f64; 2]> = points
        .iter()
        .copied()
        .filter(|p| p.iter().all(|x| x.is_finite()))
        .collect();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut front: Vec<[f64; 2]> = Vec::new();
    for point in sorted {
        if front.last().is_none_or(|best| point[1] < best[1]) {
            front.push(point);
        }
    }
    front
}

impl Plot {
    /// The plot as an SVG document.
    ///
    /// # Errors
    /// [`PlotError`].
    pub fn svg(&self) -> Result<String, PlotError> {
        let mut text = String::new();
        {
            let root = SVGBackend::with_string(&mut text, (SIZE[0], SIZE[1])).into_drawing_area();
            self.draw(&root)?;
        }
        Ok(text)
    }

    /// The plot as pixels, three bytes each, of [`SIZE`].
    ///
    /// # Errors
    /// [`PlotError`].
    pub fn rgb(&self) -> Result<Vec<u8>, PlotError> {
        let mut pixels = vec![0; (3 * SIZE[0] * SIZE[1]) as usize];
        {
            let root = BitMapBackend::with_buffer(&mut pixels, (SIZE[0], SIZE[1])).into_drawing_area();
            self.draw(&root)?;
        }
        Ok(pixels)
    }

    fn draw<DB: DrawingBackend>(&self, root: &DrawingArea<DB, Shift>) -> Result<(), PlotError> {
        static FONT: Once = Once::new();
        FONT.call_once(|| {
            let font = include_bytes!("../../assets/fonts/DejaVuSans-subset.ttf");
            // A font that cannot be read would show as a failed text in every plot.
            let _ = plotters::style::register_font("sans-serif", FontStyle::Normal, font);
        });
        let all = || self.series.iter().flat_map(|series| &series.points);
        let x = self.x.range(all().map(|point| point[0]));
        let y = self.y.range(all().map(|point| point[1]));
        let linear = RangedCoordf64::from;
        let log = |range: std::ops::Range<f64>| LogCoord::from(range.log_scale());
        match (self.x.log, self.y.log) {
            (false, false) => self.chart(root, linear(x), linear(y)),
            (false, true) => self.chart(root, linear(x), log(y)),
            (true, false) => self.chart(root, log(x), linear(y)),
            (true, true) => self.chart(root, log(x), log(y)),
        }
        .map_err(|cause| PlotError {
            title: self.title.clone(),
            cause: cause.to_string(),
        })
    }

    fn chart<DB, X, Y>(
        &self,
        root: &DrawingArea<DB, Shift>,
        x: X,
        y: Y,
    ) -> Result<(), DrawingAreaErrorKind<DB::ErrorType>>
    where
        DB: DrawingBackend,
        X: Ranged<ValueType = f64> + ValueFormatter<f64>,
        Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        root.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(root)
            .caption(&self.title, ("sans-serif", 22))
            .margin(16)
            .x_label_area_size(52)
            .y_label_area_size(78)
            .build_cartesian_2d(x, y)?;
        chart
            .configure_mesh()
            .bold_line_style(BLACK.mix(0.14))
            .light_line_style(BLACK.mix(0.04))
            .axis_style(BLACK.mix(0.6))
            .x_desc(&self.x.label)
            .y_desc(&self.y.label)
            .x_label_formatter(&|value| number(*value))
            .y_label_formatter(&|value| number(*value))
            .axis_desc_style(("sans-serif", 17))
            .label_style(("sans-serif", 14))
            .draw()?;
        let mut steps: Vec<(f64, f64)> = Vec::new();
        for point in &self.front {
            if let Some(&(_, height)) = steps.last() {
                steps.push((point[0], height));
            }
            steps.push((point[0], point[1]));
        }
        if !steps.is_empty() {
            let style = BLACK.mix(0.35).stroke_width(2);
            chart
                .draw_series(LineSeries::new(steps, style))?
                .label("best choices")
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], style));
            chart.draw_series(
                self.front
                    .iter()
                    .map(|point| Circle::new((point[0], point[1]), 9, BLACK.mix(0.35).stroke_width(2))),
            )?;
        }
        for (series, colour) in self.series.iter().zip(COLOURS.iter().cycle()) {
            let shown = || {
                let inside = |point: &&[f64; 2]| self.x.shows(point[0]) && self.y.shows(point[1]);
                series.points.iter().filter(inside).map(|point| (point[0], point[1]))
            };
            if series.joined {
                chart.draw_series(LineSeries::new(shown(), colour.stroke_width(2)))?;
            }
            chart
                .draw_series(shown().map(|point| Circle::new(point, 5, colour.filled())))?
                .label(&series.name)
                .legend(move |(x, y)| Circle::new((x + 9, y), 5, colour.filled()));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.2))
            .label_font(("sans-serif", 15))
            .margin(8)
            .draw()?;
        root.present()
    }
}

/// A number on an axis: short, with a power of ten where it is long.
fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let exponent = value.abs().log10().floor();
    if (-3.0..5.0).contains(&exponent) {
        let digits = (2.0 - exponent).clamp(0.0, 5.0) as usize;
        let text = format!("{value:.digits$}");
        match text.contains('.') {
            true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
            false => text,
        }
    } else {
        format!("{value:.0e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot() -> Plot {
        let points = vec![[1.0, 1e-3], [10.0, 1e-7], [100.0, 1e-12], [20.0, 1e-2]];
        Plot {
            title: "error against time".into(),
            x: Axis::log("time, ms"),
            y: Axis::log("relative error"),
            front: pareto(&points),
            series: vec![Series {
                name: "level I".into(),
                points,
                joined: false,
            }],
        }
    }

    #[test]
    fn the_front_is_what_nothing_beats() {
        assert_eq!(plot().front, [[1.0, 1e-3], [10.0, 1e-7], [100.0, 1e-12]]);
        assert_eq!(
            pareto(&[[1.0, 2.0], [1.0, 1.0], [2.0, 1.0], [f64::NAN, 0.0]]),
            [[1.0, 1.0]]
        );
        assert!(pareto(&[]).is_empty());
    }

    #[test]
    fn svg_and_pixels_show_the_series() {
        let svg = plot().svg().unwrap();
        for text in [
            "error against time",
            "time, ms",
            "relative error",
            "level I",
            "best choices",
            "1e-12",
        ] {
            assert!(svg.contains(text), "{text} is not in the SVG");
        }
        let pixels = plot().rgb().unwrap();
        let blue = pixels.chunks_exact(3).filter(|pixel| *pixel == [0, 114, 178]).count();
        assert!(blue > 4 * 60, "four discs of radius 5: {blue} pixels of their colour");
        // Letters of the title: dark pixels in its rows.
        let dark = pixels[..(3 * SIZE[0] * 40) as usize]
            .chunks_exact(3)
            .filter(|p| p[0] < 100)
            .count();
        assert!(dark > 200, "{dark} dark pixels where the title stands");
        assert_eq!(svg, plot().svg().unwrap());
    }

    #[test]
    fn values_that_an_axis_cannot_show_are_left_out() {
        let mut plot = plot();
        plot.series[0].points = vec![[0.0, 1.0], [f64::NAN, 1.0], [1.0, f64::INFINITY]];
        plot.front.clear();
        plot.svg().unwrap();
        plot.x.log = false;
        plot.series[0].points = vec![[5.0, 5.0]];
        plot.rgb().unwrap();
    }

    #[test]
    fn numbers_are_short() {
        let cases = [
            (0.0, "0"),
            (1.0, "1"),
            (0.25, "0.25"),
            (0.001, "0.001"),
            (1e-12, "1e-12"),
            (1500.0, "1500"),
            (1e5, "1e5"),
        ];
        for (value, text) in cases {
            assert_eq!(number(value), text);
        }
    }
}
