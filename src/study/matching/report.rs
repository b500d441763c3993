//! Output of a match as text, as a scene and as a page.

use std::fmt;

use super::{Match, Score, Side};
use crate::scene::SceneFile;
use crate::study::page::{Cell, Page, address};
use crate::study::plot::{Axis, Marker, Plot, PlotError, Series};
use crate::study::realism::report::{named, number, small};
use crate::text;

impl Match {
    fn summary(&self) -> String {
        let [before, after] = [self.default_score, self.score].map(|Score { windows, sector }| {
            format!(
                "{} grey levels in windows and {} in the sector",
                number(windows),
                number(sector)
            )
        });
        let windows: usize = self.real.depths.iter().map(|it| it.windows).sum();
        let depths = self.real.depths.len();
        format!(
            "histograms are {after} from those of the frame (default effects: {before}); {windows} windows at {depths} depths, {} rounds",
            self.rounds
        )
    }

    /// Returns name, value and spread of each figure.
    fn rows(&self) -> Vec<[String; 3]> {
        let rows = self.figures.iter().map(|it| {
            let spread = it.spread.map_or("-".to_owned(), number);
            [format!("{}, {}", it.key, it.unit), it.value.to_string(), spread]
        });
        rows.collect()
    }

    /// Returns the scene text, headed by comments with the figures found and the parameters not identified.
    pub(super) fn written(&self, scene: &SceneFile) -> String {
        let name = text::printable(&self.name);
        let mut written = format!("# Matched to {name} by insonify match.\n# {}.\n", self.summary());
        written += "# Put your own volume and pose in place of [volume]. Not told by the frame:\n";
        for it in &self.unidentified {
            written += &format!("# - {}: {}\n", it.what, it.why);
        }
        for note in &self.notes {
            written += &format!("# Note: {note}.\n");
        }
        // Serialising tables of numbers and names cannot fail.
        written + "\n" + &toml::to_string(scene).unwrap_or_default()
    }

    /// Returns the match as one self-contained HTML document.
    ///
    /// # Errors
    /// [`PlotError`] if a plot cannot be drawn.
    pub fn page(&self) -> Result<String, PlotError> {
        let mut page = Page::new("Match of a frame");
        let summary = self.summary();
        page.paragraph("", &format!("{}: {summary}.", named(&self.name)));
        for note in &self.notes {
            page.paragraph("warning", &format!("{note}."));
        }
        page.put("<div class=\"figures\">");
        let frames = [
            (&self.real, "the real frame"),
            (&self.matched, "a uniform phantom with the figures found"),
            (&self.default, "the same with default effects"),
        ];
        for (side, what) in frames {
            if let Some(address) = small(&side.frame).and_then(|it| address(&it).ok()) {
                page.picture(&address, what);
            }
        }
        page.put("</div>");
        let number = |words: &str| Cell::Number(words.to_owned());
        let headings = [
            Cell::Text("figure".to_owned()),
            number("value"),
            number("spread over windows"),
        ];
        let cells = |[name, value, spread]: [String; 3]| {
            ("", vec![Cell::Text(name), Cell::Number(value), Cell::Number(spread)])
        };
        page.table(&headings, &self.rows().into_iter().map(cells).collect::<Vec<_>>());
        page.put("<div class=\"figures\">");
        for plot in self.plots() {
            page.figure(&plot.svg_for_page()?, &plot.title);
        }
        page.put("</div><h2>What the frame does not tell</h2>");
        let headings = ["what", "why"].map(|words| Cell::Text(words.to_owned()));
        let rows = self
            .unidentified
            .iter()
            .map(|it| ("", vec![Cell::Text(it.what.to_owned()), Cell::Text(it.why.clone())]));
        page.stacked(&headings, &rows.collect::<Vec<_>>());
        Ok(page.finish())
    }

    fn plots(&self) -> Vec<Plot> {
        let plot = |title: &str, [x, y]: [&str; 2], points: &dyn Fn(&Side) -> Vec<[f64; 2]>| {
            let sides = [
                ("real", 1, &self.real),
                ("matched", 0, &self.matched),
                ("default", 6, &self.default),
            ];
            let line = |(name, colour, side): (&str, usize, &Side)| Series {
                name: name.to_owned(),
                points: points(side),
                joined: true,
                marker: Marker::None,
                colour,
            };
            Plot {
                title: title.to_owned(),
                x: Axis::linear(x),
                y: Axis::linear(y),
                series: sides.map(line).to_vec(),
                markers: Vec::new(),
                front: Vec::new(),
            }
        };
        // Four grey levels per point.
        let classes = |histogram: &[f64]| -> Vec<[f64; 2]> {
            let classes = histogram.chunks(4).enumerate();
            classes
                .map(|(at, shares)| [at as f64 * 4.0 + 1.5, shares.iter().sum()])
                .collect()
        };
        let lags =
            |values: &[f64]| -> Vec<[f64; 2]> { values.iter().enumerate().map(|(lag, v)| [lag as f64, *v]).collect() };
        let depths = |side: &Side, of: &dyn Fn(&super::AtDepth) -> Option<f64>| -> Vec<[f64; 2]> {
            side.depths
                .iter()
                .filter_map(|it| Some([it.depth_mm, of(it)?]))
                .collect()
        };
        let share = ["grey level", "share in 4 grey levels"];
        vec![
            plot("Grey levels of the windows", share, &|it| classes(&it.histogram)),
            plot("Grey levels of the sector", share, &|it| classes(&it.sector_histogram)),
            plot(
                "Autocorrelation along the beam",
                ["lag, samples", "autocorrelation"],
                &|it| lags(&it.autocorrelation_axial),
            ),
            plot("Autocorrelation across", ["lag, scanlines", "autocorrelation"], &|it| {
                lags(&it.autocorrelation_lateral)
            }),
            plot("Mean of the windows over depth", ["depth, mm", "grey level"], &|it| {
                depths(it, &|at| Some(at.grey))
            }),
            plot("Lateral width over depth", ["depth, mm", "FWHM, mm"], &|it| {
                depths(it, &|at| at.lateral_mm)
            }),
        ]
    }
}

impl fmt::Display for Match {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows = self.rows();
        let names = text::column("figure", rows.iter().map(|row| row[0].as_str()));
        writeln!(f, "{}  {:>10}  {:>8}", names[0], "value", "spread")?;
        for (name, [_, value, spread]) in names[1..].iter().zip(&rows) {
            writeln!(f, "{name}  {value:>10}  {spread:>8}")?;
        }
        writeln!(f, "\n{}\n\nnot told by the frame:", self.summary())?;
        for it in &self.unidentified {
            writeln!(f, "  {}: {}", it.what, it.why)?;
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        Ok(())
    }
}
