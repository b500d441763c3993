//! Output of a match as text, as a scene and as a page.

use std::fmt;

use super::{HistogramDistance, Match, WindowMeasurements};
use crate::realism::report::{named, small};
use insonify_base::document::{InputError, Setting, to_toml};
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
        let windows: usize = self.real.depths.iter().map(|depth| depth.windows).sum();
        let depths = self.real.depths.len();
        format!(
            "histograms are {after} from those of the frame (default effects: {before}); {windows} windows at {depths} depths, {} rounds",
            self.rounds
        )
    }

    /// Returns name, value and spread of each figure.
    fn table(&self, spread: &str) -> Table {
        let rows = self.figures.iter().map(|figure| {
            let spread = figure.spread.map_or("-".to_owned(), fixed);
            [
                format!("{}, {}", figure.key, figure.unit),
                figure.value.to_string(),
                spread,
            ]
        });
        Table::new([Cell::from("figure"), Cell::number("value"), Cell::number(spread)]).with(rows)
    }

    /// Returns the scene text, headed by comments with the figures found and the parameters not identified.
    pub(super) fn written(&self, scene: &SceneFile) -> String {
        let name = text::printable(&self.name);
        let mut written = format!("# Matched to {name} by insonify match.\n# {}.\n", self.summary());
        written += "# Put your own volume and pose in place of [volume]. Not determined by the frame:\n";
        for reason in &self.unidentified {
            written += &format!("# - {}: {}\n", reason.what, reason.why);
        }
        for note in &self.notes {
            written += &format!("# Note: {note}.\n");
        }
        // Serialising tables of numbers and names cannot fail.
        written + "\n" + &to_toml(scene).unwrap_or_default()
    }

    /// Sets keys of the scene, in place of what was estimated.
    ///
    /// # Errors
    /// A key that scenes do not have, or a value of the wrong type.
    pub fn set(&mut self, settings: &[Setting]) -> Result<(), InputError> {
        if !settings.is_empty() {
            self.scene = self.written(&SceneFile::parse_with(&self.scene, "", settings)?);
        }
        Ok(())
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
        let frames = frames.map(|(side, caption)| (small(&side.frame), caption.to_owned()));
        let pictures = frames.iter();
        page.pictures(pictures.filter_map(|(picture, caption)| Some((picture.as_ref()?, caption.clone()))));
        page.table(&self.table("spread over windows"));
        page.plots(&self.plots())?;
        page.put("<h2>What the frame does not tell</h2>");
        let rows = self
            .unidentified
            .iter()
            .map(|reason| [reason.what.to_owned(), reason.why.clone()]);
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
                .map(|(class, shares)| [class as f64 * 4.0 + 1.5, shares.iter().sum()])
                .collect()
        };
        let lags =
            |values: &[f64]| -> Vec<[f64; 2]> { values.iter().enumerate().map(|(lag, v)| [lag as f64, *v]).collect() };
        let depths =
            |side: &WindowMeasurements, measure: &dyn Fn(&super::DepthMeasurements) -> Option<f64>| -> Vec<[f64; 2]> {
                side.depths
                    .iter()
                    .filter_map(|depth| Some([depth.depth_mm, measure(depth)?]))
                    .collect()
            };
        let share = ["grey level", "share in 4 grey levels"];
        vec![
            plot("Grey levels of the windows", share, &|side| classes(&side.histogram)),
            plot("Grey levels of the sector", share, &|side| {
                classes(&side.sector_histogram)
            }),
            plot(
                "Autocorrelation along the beam",
                ["lag, samples", "autocorrelation"],
                &|side| lags(&side.autocorrelation_axial),
            ),
            plot(
                "Autocorrelation across",
                ["lag, scanlines", "autocorrelation"],
                &|side| lags(&side.autocorrelation_lateral),
            ),
            plot("Mean of the windows over depth", ["depth, mm", "grey level"], &|side| {
                depths(side, &|depth| Some(depth.grey))
            }),
            plot("Lateral width over depth", ["depth, mm", "FWHM, mm"], &|side| {
                depths(side, &|depth| depth.lateral_mm)
            }),
        ]
    }
}

impl fmt::Display for Match {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.table("spread").text("  ", &[0, 10, 8]))?;
        writeln!(f, "\n{}\n\nnot determined by the frame:", self.summary())?;
        for reason in &self.unidentified {
            writeln!(f, "  {}: {}", reason.what, reason.why)?;
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        Ok(())
    }
}
