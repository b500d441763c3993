//! Results of the cases, and their output.

use std::fmt::{self, Write};

use serde::Serialize;

use super::record::Measure;
use super::{Effort, HardCase};
use insonify_base::machine::Machine;
use insonify_base::number::figure;
use insonify_base::output::OutputError;
use insonify_base::table::{Cell, Table};
use insonify_base::text::escape;
use insonify_report::page::Page;
use insonify_report::plot::{Axis, Marker, Plot, Series};

/// Margin at which the plot shows an exact result and, on its other side, a figure that is no number.
const ENDS: [f64; 2] = [0.1, 1e13];

/// Result of one case.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CaseReport {
    /// Subject of the group of cases.
    pub group: String,
    /// Short description of the difficulty.
    pub name: String,
    /// Acceptance criterion in words.
    pub criterion: String,
    /// Backends and precisions covered.
    pub covers: Vec<String>,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Running time, s.
    pub seconds: f64,
    /// Whether every figure passes. A case without figures fails.
    pub holds: bool,
    /// Margin of the decisive figure.
    pub margin: Option<f64>,
    /// Figures, in the order of recording.
    pub measures: Vec<Measure>,
}

impl CaseReport {
    /// Creates the report of a case with its verdict.
    pub fn new(group: &str, case: &HardCase, seconds: f64, measures: Vec<Measure>) -> Self {
        let mut report = CaseReport {
            group: group.to_owned(),
            name: case.name.to_owned(),
            criterion: case.criterion.to_owned(),
            covers: case.covers.iter().map(|&cover| cover.to_owned()).collect(),
            seed: case.seed,
            seconds,
            holds: !measures.is_empty() && measures.iter().all(|measure| measure.holds),
            margin: None,
            measures,
        };
        report.margin = report.worst().and_then(|worst| worst.margin);
        report
    }

    /// Returns the decisive figure: one that fails, otherwise the one nearest to its limit, otherwise the first.
    pub fn worst(&self) -> Option<&Measure> {
        let rank = |measure: &&Measure| match (measure.holds, measure.limit, measure.margin) {
            (false, ..) => -1.0,
            (_, None, _) => f64::INFINITY,
            (_, Some(_), None) => f64::MAX,
            (_, Some(_), Some(margin)) => margin,
        };
        self.measures.iter().min_by(|a, b| rank(a).total_cmp(&rank(b)))
    }

    /// Returns the figures that fail.
    pub fn failures(&self) -> impl Iterator<Item = &Measure> {
        self.measures.iter().filter(|measure| !measure.holds)
    }

    fn verdict(&self) -> &'static str {
        if self.holds { "holds" } else { "FAILS" }
    }
}

/// Results of all cases of a run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StabilityReport {
    /// Length of the run.
    pub effort: Effort,
    /// Machine that the cases ran on.
    pub machine: Machine,
    /// Result of each case, in the order run.
    pub cases: Vec<CaseReport>,
}

fn limit(measure: &Measure) -> String {
    measure.limit.map_or("-".to_owned(), figure)
}

fn margin(measure: &Measure) -> String {
    match measure.margin {
        Some(margin) if margin < 9.95 => format!("{margin:.1}x"),
        Some(margin) if margin < 9999.5 => format!("{margin:.0}x"),
        Some(margin) => format!("{margin:.0e}x"),
        None if measure.limit.is_some() && measure.figure == 0.0 => "exact".to_owned(),
        None => "-".to_owned(),
    }
}

/// Describes a figure that fails, on one line.
pub(super) fn sentence(measure: &Measure) -> String {
    let mut line = format!("{}: {}", measure.what, figure(measure.figure));
    if let Some(limit) = measure.limit {
        let _ = write!(line, ", at most {} expected", figure(limit));
    } else {
        line.push_str(", a finite number expected");
    }
    if let Some(note) = &measure.note {
        let _ = write!(line, " ({note})");
    }
    line
}

impl StabilityReport {
    /// Returns the number of cases that fail.
    pub fn failed(&self) -> usize {
        self.cases.iter().filter(|case| !case.holds).count()
    }

    /// Returns the names of the groups in the order of their first case.
    fn groups(&self) -> Vec<&str> {
        let mut groups: Vec<&str> = self.cases.iter().map(|case| case.group.as_str()).collect();
        groups.dedup();
        groups
    }

    fn of_group(&self, group: &str) -> impl Iterator<Item = &CaseReport> {
        self.cases.iter().filter(move |case| case.group == group)
    }

    fn effort(&self) -> &'static str {
        self.effort.pick("quick counts", "whole counts")
    }

    /// Draws the margins as an SVG document.
    ///
    /// # Errors
    /// [`OutputError`] if the plot cannot be drawn.
    pub fn plot(&self) -> Result<String, OutputError> {
        let (plot, rows) = self.margins();
        plot.svg_by_row(&rows)
    }

    /// Plots the margin of each figure that has a limit, the decisive one of a case drawn large; and the names of the
    /// rows, one per group and case.
    pub(super) fn margins(&self) -> (Plot, Vec<String>) {
        let mut rows = Vec::new();
        let [mut holds, mut fails] = ["holds", "fails"].map(|_| [Vec::new(), Vec::new()]);
        for group in self.groups() {
            rows.push(format!("[ {group} ]"));
            for case in self.of_group(group) {
                let shown = case
                    .measures
                    .iter()
                    .filter(|measure| measure.limit.is_some() || !measure.holds);
                for measure in shown {
                    let exact = if measure.holds { ENDS[1] } else { ENDS[0] };
                    let margin = measure.margin.unwrap_or(exact).clamp(ENDS[0], ENDS[1]);
                    let large = case.worst().is_some_and(|worst| std::ptr::eq(worst, measure));
                    let points = if measure.holds { &mut holds } else { &mut fails };
                    points[usize::from(large)].push([margin, -(rows.len() as f64)]);
                }
                rows.push(case.name.clone());
            }
        }
        let ends = [0.5, 0.5 - rows.len() as f64];
        let mut series = vec![Series::line("limit", 6, ends.map(|y| [1.0, y]).to_vec())];
        for (name, colour, [small, large]) in [("holds", 0, holds), ("fails", 1, fails)] {
            series.push(Series::points(name, colour, Marker::Dot, small));
            series.push(Series::points(name, colour, Marker::Disc, large));
        }
        let x = Axis::log("margin: limit over figure (1e13: exact; large: the figure nearest to its limit)");
        let plot = Plot::new("Margins of the hard cases", x, Axis::linear(""), series);
        (plot, rows)
    }

    /// Returns the report with every figure in Markdown.
    pub fn markdown(&self) -> String {
        let mut text = format!(
            "# Hard cases\n\n{} of {} hold ({}, {}).\n\nMargin: how many times larger the figure might be. Figures without a limit \
             are only reported; NaN and infinity never hold.\n",
            self.cases.len() - self.failed(),
            self.cases.len(),
            self.effort(),
            self.machine
        );
        for group in self.groups() {
            // Writing to a string cannot fail.
            let _ = write!(text, "\n## {group}\n");
            for case in self.of_group(group) {
                let covers = case.covers.join(", ");
                let _ = write!(
                    text,
                    "\n### {}: {}\n\n{}. On {covers}; seed {}; {:.1} s.\n\n",
                    case.name,
                    case.verdict(),
                    case.criterion,
                    case.seed,
                    case.seconds
                );
                let rows = case.measures.iter().map(|measure| {
                    let verdict = if measure.holds { "" } else { "**FAILS** " };
                    let note = format!("{verdict}{}", measure.note.as_deref().unwrap_or_default());
                    [
                        measure.what.clone(),
                        figure(measure.figure),
                        limit(measure),
                        margin(measure),
                        note,
                    ]
                });
                text += &Table::new(["measured", "figure", "limit", "margin", ""])
                    .with(rows)
                    .markdown();
            }
        }
        text
    }
}

impl fmt::Display for StabilityReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "machine: {}; {}", self.machine, self.effort())?;
        for group in self.groups() {
            writeln!(f, "\n{group}")?;
            let head = [
                "hard case (seed)",
                "criterion",
                "measured nearest to its limit",
                "figure",
                "limit",
                "margin",
                "verdict",
            ];
            let rows = self.of_group(group).map(|case| {
                let name = format!("{} ({})", case.name, case.seed);
                let numbers = case.worst().map(|measure| {
                    [
                        measure.what.clone(),
                        figure(measure.figure),
                        limit(measure),
                        margin(measure),
                    ]
                });
                let [what, figure, limit, margin] =
                    numbers.unwrap_or_else(|| ["nothing", "-", "-", "-"].map(str::to_owned));
                let verdict = case.verdict().to_owned();
                [name, case.criterion.clone(), what, figure, limit, margin, verdict]
            });
            f.write_str(&Table::new(head).with(rows).wrapped(&[24, 34, 30, 8, 8, 6, 7]))?;
        }
        let failed = self.failed();
        writeln!(f, "\n{} of {} cases hold", self.cases.len() - failed, self.cases.len())?;
        for case in self.cases.iter().filter(|case| !case.holds) {
            writeln!(f, "{} does not:", case.name)?;
            for measure in case.failures() {
                writeln!(f, "  {}", sentence(measure))?;
            }
        }
        Ok(())
    }
}

impl StabilityReport {
    /// Returns the report, with every figure, as one self-contained HTML document.
    ///
    /// # Errors
    /// [`OutputError`] if the plot cannot be drawn.
    pub fn page(&self) -> Result<String, OutputError> {
        let mut page = Page::new("Hard cases");
        let (failed, cases) = (self.failed(), self.cases.len());
        let verdict = format!(
            "{} of {cases} hard cases hold ({}, {}).",
            cases - failed,
            self.effort(),
            self.machine
        );
        page.paragraph(if failed > 0 { "warning" } else { "advice" }, &verdict);
        // Every failure in words and before the tables, whose rows show a case by one figure only.
        for case in self.cases.iter().filter(|case| !case.holds) {
            let failures: Vec<String> = case.failures().map(sentence).collect();
            page.paragraph(
                "warning",
                &format!("{} does not hold: {}", case.name, failures.join("; ")),
            );
        }
        page.paragraph(
            "soft",
            "Each case is hard for numerical methods, with a criterion from theory. The figure shown is the one nearest to its limit; the \
             margin is how many times larger it might be. NaN and infinity never hold, and what must be refused fails if it is not.",
        );
        page.wide_figure(
            &self.plot()?,
            "How many times larger each figure might be before its case fails",
        );
        for group in self.groups() {
            page.put(format_args!("<h2>{}</h2>", escape(group)));
            let head = [
                Cell::from("hard case"),
                Cell::from("measured nearest to its limit"),
                Cell::number("margin"),
                Cell::from(""),
            ];
            let mut table = Table::new(head);
            for case in self.of_group(group) {
                table.row(if case.holds { "" } else { "wrong" }, case.row());
            }
            page.stacked(&table);
            for case in self.of_group(group) {
                case.details(&mut page);
            }
        }
        Ok(page.finish())
    }
}

impl CaseReport {
    fn row(&self) -> [Cell; 4] {
        let (nearest, margin) = match self.worst() {
            Some(worst) => (Cell::Pair(worst.what.clone(), bound(worst)), margin(worst)),
            None => ("nothing".into(), "-".to_owned()),
        };
        let class = if self.holds { "good" } else { "bad" };
        [
            Cell::Pair(self.name.clone(), self.criterion.clone()),
            nearest,
            margin.into(),
            Cell::Tags(vec![(class, self.verdict().to_owned())]),
        ]
    }

    fn details(&self, page: &mut Page) {
        let covers = self.covers.join(", ");
        page.put(format_args!(
            "<details><summary>{}: all {} figures</summary>",
            escape(&self.name),
            self.measures.len()
        ));
        let seconds = self.seconds;
        page.paragraph("soft", &format!("On {covers}; seed {}; {seconds:.1} s.", self.seed));
        let [figures, limits, margins] = ["figure", "limit", "margin"].map(Cell::number);
        let mut table = Table::new([Cell::from("measured"), figures, limits, margins, Cell::from("")]);
        for measure in &self.measures {
            let tags = (!measure.holds).then(|| ("bad", "FAILS".to_owned()));
            let what = match &measure.note {
                Some(note) => Cell::Pair(measure.what.clone(), note.clone()),
                None => measure.what.clone().into(),
            };
            let numbers = [figure(measure.figure), limit(measure), margin(measure)].map(Cell::from);
            let cells = std::iter::once(what).chain(numbers);
            let class = if measure.holds { "" } else { "wrong" };
            table.row(class, cells.chain([Cell::Tags(tags.into_iter().collect())]));
        }
        page.table(&table);
        page.put("</details>");
    }
}

/// Describes a figure and its limit.
fn bound(measure: &Measure) -> String {
    match measure.limit {
        Some(_) => format!("{}, at most {}", figure(measure.figure), limit(measure)),
        None => figure(measure.figure),
    }
}
