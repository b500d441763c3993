//! Output of a match as text, as a scene and as a page.

use std::fmt;

use super::{HistogramDistance, Match, WindowMeasurements};
use crate::realism::report::{named, small};
use insonify_base::document::to_toml;
use insonify_base::number::fixed;
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_base::text;
use insonify_imaging::scene::SceneFile;
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Plot, Series};

impl Match {
    fn summary(&self) -> String {
        let [before, after] = [self.default_score, self.score].map(|HistogramDistance { windows, sector }| {
            format!(
                "{} grey levels in windows and {} in the sector",
                fixed(windows),
                fixed(sector)
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
    fn table(&self, spread: &str) -> Table {
        let rows = self.figures.iter().map(|it| {
            let spread = it.spread.map_or("-".to_owned(), fixed);
            [format!("{}, {}", it.key, it.unit), it.value.to_string(), spread]
        });
        Table::new([Cell::from("figure"), Cell::number("value"), Cell::number(spread)]).with(rows)
    }

    /// Returns the scene text, headed by comments with the figures found and the parameters not identified.
    pub(super) fn written(&self, scene: &SceneFile) -> String {
        let name = text::printable(&self.name);
        let mut written = format!("# Matched to {name} by insonify match.\n# {}.\n", self.summary());
        written += "# Put your own volume and pose in place of [volume]. Not determined by the frame:\n";
        for it in &self.unidentified {
            written += &format!("# - {}: {}\n", it.what, it.why);
        }
        for note in &self.notes {
            written += &format!("# Note: {note}.\n");
        }
        // Serialising tables of numbers and names cannot fail.
        written + "\n" + &to_toml(scene).unwrap_or_default()
    }

    /// Returns the match as one self-contained HTML document.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self) -> Result<String, OutputError> {
        let mut page = Page::new("Match of a frame");
        let summary = self.summary();
        page.paragraph("", &format!("{}: {summary}.", named(&self.name)));
        for note in &self.notes {
            page.paragraph("warning", &format!("{note}."));
        }
        let frames = [
            (&self.real, "the real frame"),
            (&self.matched, "a uniform phantom with the figures found"),
            (&self.default, "the same with default effects"),
        ];
        let frames = frames.map(|(side, what)| (small(&side.frame), what.to_owned()));
        let pictures = frames.iter();
        page.pictures(pictures.filter_map(|(picture, what)| Some((picture.as_ref()?, what.clone()))));
        page.table(&self.table("spread over windows"));
        page.plots(&self.plots())?;
        page.put("<h2>What the frame does not tell</h2>");
        let rows = self.unidentified.iter().map(|it| [it.what.to_owned(), it.why.clone()]);
        page.stacked(&Table::new(["what", "why"]).with(rows));
        Ok(page.finish())
    }

    fn plots(&self) -> Vec<Plot> {
        let plot = |title: &str, [x, y]: [&str; 2], points: &dyn Fn(&WindowMeasurements) -> Vec<[f64; 2]>| {
            let sides = [
                ("real", 1, &self.real),
                ("matched", 0, &self.matched),
                ("default", 6, &self.default),
            ];
            let line =
                |(name, colour, side): (&str, usize, &WindowMeasurements)| Series::line(name, colour, points(side));
            Plot::new(title, Axis::linear(x), Axis::linear(y), sides.map(line).to_vec())
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
        let depths =
            |side: &WindowMeasurements, of: &dyn Fn(&super::DepthMeasurements) -> Option<f64>| -> Vec<[f64; 2]> {
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
        f.write_str(&self.table("spread").text("  ", &[0, 10, 8]))?;
        writeln!(f, "\n{}\n\nnot determined by the frame:", self.summary())?;
        for it in &self.unidentified {
            writeln!(f, "  {}: {}", it.what, it.why)?;
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        Ok(())
    }
}
