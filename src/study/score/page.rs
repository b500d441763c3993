//! Scores and comparisons as text and as pages.

use std::fmt;
use std::path::Path;

use image::GrayImage;

use super::exercise::GROUPS;
use super::groups::{Comparison, SIGNIFICANT, Spread, quantile};
use super::{COUNT, MEANINGS, NAMES, Score, UNITS};
use crate::realism::picture::decoded;
use insonify_base::number::fixed;
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Marker, Plot, Series};

/// Largest number of points of a curve.
const POINTS: usize = 1500;

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.summary())?;
        f.write_str(&self.table().text("  ", &[4, 10, 14, 4, 60]))
    }
}

impl Score {
    fn summary(&self) -> String {
        let [start, end] = self.during_s;
        let mut text = format!(
            "{}: needle in the body from {start:.2} to {end:.2} s{}, nearest to the target {:.2} mm at {:.2} s, force up to {:.2} N",
            self.run.display(),
            if self.withdrawn { "" } else { " (not withdrawn)" },
            self.metrics.0[COUNT - 1],
            self.nearest_s,
            self.max_force_n
        );
        if let Some(clearance) = self.clearance_mm {
            text += &format!(
                ", {clearance:.1} mm from critical structures, entered {} times",
                self.critical_entries
            );
        }
        text
    }

    fn table(&self) -> Table {
        let rows = (0..COUNT).map(|metric| {
            [
                NAMES[metric].to_owned(),
                fixed(self.metrics.0[metric]),
                fixed(self.at_rest.0[metric]),
                UNITS[metric].to_owned(),
                MEANINGS[metric].to_owned(),
            ]
        });
        let [now, rest] = ["target now", "target at rest"].map(Cell::number);
        Table::new([Cell::from(""), now, rest, Cell::from(""), Cell::from("")]).with(rows)
    }

    /// Returns the score as one self-contained HTML document; `picture` is the image at the closest approach.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self, picture: Option<&GrayImage>) -> Result<String, OutputError> {
        let mut page = Page::new("Score of an insertion");
        page.paragraph("", &(self.summary() + "."));
        if self.critical_entries > 0 {
            page.paragraph(
                "warning",
                &format!("The tip entered critical structures {} times.", self.critical_entries),
            );
        }
        page.table(&self.table());
        page.paragraph(
            "soft",
            "Means while the needle is in the body; m10: minimum. Target now: entry and target displaced by the tissue; at rest: not.",
        );
        if let Some(picture) = picture {
            page.pictures([(picture, format!("closest approach, {:.2} s", self.nearest_s))]);
        }
        page.plots(&self.paths())?;
        page.plots(&self.curves())?;
        Ok(page.finish())
    }

    fn step(&self) -> usize {
        1 + self.samples.len() / POINTS
    }

    /// Path of the tip and the straight line from entry to target in three planes.
    fn paths(&self) -> Vec<Plot> {
        let axes = [("x", 0), ("y", 1), ("z", 2)];
        let plane = |[a, b]: [usize; 2]| {
            let tip = self
                .samples
                .iter()
                .step_by(self.step())
                .map(|sample| [sample.tip[a], sample.tip[b]]);
            let mut series = vec![Series::line("tip", 0, tip.collect())];
            if let Some(sample) = self.samples.first() {
                let ends = [sample.entry[0], sample.target[0]].map(|end| [end[a], end[b]]);
                series.push(Series::line("entry to target at rest", 1, ends.to_vec()));
                series.push(Series::points("target", 2, Marker::Cross, vec![ends[1]]));
            }
            let label = |axis: usize| Axis::linear(&format!("{} (LPS), mm", axes[axis].0));
            Plot::new(
                format!("Path in the {}-{} plane", axes[a].0, axes[b].0),
                label(a),
                label(b),
                series,
            )
            .equal()
        };
        vec![plane([0, 1]), plane([0, 2]), plane([2, 1])]
    }

    /// Value of each metric over time.
    fn curves(&self) -> Vec<Plot> {
        let Some(first_sample) = self.samples.first() else {
            return Vec::new();
        };
        let normal = first_sample.normal;
        let metrics: Vec<(f64, [f64; COUNT])> = self
            .samples
            .iter()
            .step_by(self.step())
            .map(|sample| (sample.time_s, sample.values(1, &normal)))
            .collect();
        let plot = |metric: usize| {
            let points = metrics.iter().map(|(time_s, values)| [*time_s, values[metric]]);
            Plot::new(
                format!("{}: {}", NAMES[metric], MEANINGS[metric]),
                Axis::linear("time, s"),
                Axis::linear(UNITS[metric]),
                vec![Series::line(NAMES[metric], 0, points.collect())],
            )
        };
        (0..COUNT).map(plot).collect()
    }
}

/// Picture of a run at a time, if its frames were rendered as pictures: the nearest of the frames, which are evenly
/// spaced over `end_s` seconds.
pub fn picture(run: &Path, time_s: f64, end_s: f64) -> Option<GrayImage> {
    let folder = std::fs::read_dir(run.join("frames")).ok()?;
    let mut files: Vec<_> = folder
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|ending| ending == "png"))
        .filter(|path| {
            path.file_stem().and_then(|stem| stem.to_str()).is_some_and(|stem| {
                let number = stem.strip_prefix("frame_");
                number.is_some_and(|number| number.bytes().all(|byte| byte.is_ascii_digit()))
            })
        })
        .collect();
    files.sort();
    let last_index = files.len().checked_sub(1)?;
    let index = (time_s / end_s.max(f64::MIN_POSITIVE) * last_index as f64).round() as usize;
    Some(decoded(files.get(index.min(last_index))?).ok()?.into_luma8())
}

fn p_in_words(p: Option<f64>) -> String {
    match p {
        None => "-".to_owned(),
        Some(p) if p < 0.0001 => "< 0.0001".to_owned(),
        Some(p) => format!("{p:.4}"),
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.spreads().text("  ", &[]))?;
        writeln!(f, "{}", self.tests().text("  ", &[]))?;
        self.counts().iter().try_for_each(|line| writeln!(f, "{line}"))
    }
}

impl Comparison {
    fn spreads(&self) -> Table {
        let heads = self
            .groups
            .iter()
            .map(|group| Cell::number(format!("{} (n = {})", group.name, group.sessions)));
        let table = Table::new([Cell::from(""), Cell::from("")].into_iter().chain(heads));
        table.with((0..COUNT).map(|metric| {
            let spread = |spread: &Spread| {
                let sd = spread.sd.map_or(String::new(), |sd| format!(" +- {}", fixed(sd)));
                format!("{}{sd} ({})", fixed(spread.mean), fixed(spread.median))
            };
            let cells = self.groups.iter().map(|group| spread(&group.metrics[NAMES[metric]]));
            let labels = [NAMES[metric], UNITS[metric]].map(str::to_owned);
            labels.into_iter().chain(cells).collect::<Vec<_>>()
        }))
    }

    fn tests(&self) -> Table {
        let heads = [
            "Welch",
            "Mann-Whitney",
            "Welch, Holm",
            "people: Welch",
            "people: Mann-Whitney",
        ]
        .map(Cell::number);
        let table = Table::new([Cell::from("groups"), Cell::from("")].into_iter().chain(heads));
        table.with(self.pairs.iter().map(|pair| {
            let tests = [
                pair.welch_p,
                pair.mann_whitney_p,
                pair.holm_p,
                pair.person_welch_p,
                pair.person_mann_whitney_p,
            ];
            let names = [format!("{} - {}", pair.a, pair.b), pair.metric.to_owned()];
            names.into_iter().chain(tests.map(p_in_words)).collect::<Vec<_>>()
        }))
    }

    /// Number of metrics that differ significantly, for each pair of groups.
    fn counts(&self) -> Vec<String> {
        let below = |p: Option<f64>| p.is_some_and(|p| p < SIGNIFICANT);
        let pairs = self.pairs.chunks(COUNT).map(|pairs| {
            let count = |p: fn(&super::groups::Pair) -> Option<f64>| pairs.iter().filter(|pair| below(p(pair))).count();
            format!(
                "{} - {}: p < {SIGNIFICANT} in {} of {COUNT} metrics (Welch), {} (Mann-Whitney), {} (Welch, Holm), {} (Welch, means of people)",
                pairs[0].a,
                pairs[0].b,
                count(|pair| pair.welch_p),
                count(|pair| pair.mann_whitney_p),
                count(|pair| pair.holm_p),
                count(|pair| pair.person_welch_p)
            )
        });
        pairs.collect()
    }

    /// Returns the comparison as one self-contained HTML document; `notes` come first.
    ///
    /// # Errors
    /// [`OutputError`] if a plot cannot be drawn.
    pub fn page(&self, title: &str, notes: &[String]) -> Result<String, OutputError> {
        let mut page = Page::new(title);
        notes.iter().for_each(|note| page.paragraph("", note));
        self.counts().iter().for_each(|line| page.paragraph("", line));
        page.put("<h2>Metrics by group</h2>");
        page.paragraph("soft", "Mean +- standard deviation (median) over sessions.");
        page.table(&self.spreads());
        page.put("<h2>Tests</h2>");
        page.paragraph(
            "soft",
            "Two-sided p. Sessions of one person are not independent: the last two columns compare means of people. Holm: corrected for ten metrics.",
        );
        page.table(&self.tests());
        page.put("<h2>Distributions</h2>");
        page.plots(&self.boxes())?;
        Ok(page.finish())
    }

    /// Box plots: quartiles, median, and whiskers to the extremes.
    fn boxes(&self) -> Vec<Plot> {
        let names = self.groups.iter().enumerate();
        let names = names.map(|(index, group)| format!("{}: {}", index + 1, group.name));
        let names = names.collect::<Vec<_>>().join(", ");
        let plot = |metric: usize| {
            let series = self.groups.iter().enumerate().map(|(index, group)| {
                let values = &group.metrics[NAMES[metric]].values;
                let [low, q1, median, q3, high] = [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| quantile(values, share));
                let (middle, left, right) = (index as f64 + 1.0, index as f64 + 0.7, index as f64 + 1.3);
                // One line draws the whole box without a gap, so it goes over some edges twice.
                let outline = [
                    [middle, low],
                    [middle, q1],
                    [left, q1],
                    [left, median],
                    [right, median],
                    [left, median],
                    [left, q3],
                    [middle, q3],
                    [middle, high],
                    [middle, q3],
                    [right, q3],
                    [right, q1],
                    [middle, q1],
                ];
                Series::line(group.name.clone(), index, outline.to_vec())
            });
            Plot::new(
                format!("{}: {}", NAMES[metric], MEANINGS[metric]),
                Axis::linear(&names),
                Axis::linear(UNITS[metric]),
                series.collect(),
            )
        };
        (0..COUNT).map(plot).collect()
    }
}

/// Notes of the page of a study of simulated hands.
pub fn study_notes(tasks: usize, people: usize, seed: u64) -> Vec<String> {
    vec![format!(
        "Simulated hands, not people: {} groups of {people}, {tasks} tasks each, seed {seed}. Zhu et al. 2007 compared 8 consultants, 8 \
         registrars and 8 students, 24 sessions a group; the errors of these hands are chosen, so the figures are not comparable with theirs.",
        GROUPS.len()
    )]
}
