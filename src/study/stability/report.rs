//! What cases came to, and how it reads.

mod page;
mod plot;
mod table;

use std::fmt::{self, Write};

use serde::Serialize;

use super::case::Effort;
use super::record::Measure;
use crate::study::machine::Machine;
use table::Table;

/// What one case came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(into = "JudgedCase")]
pub struct CaseReport {
    /// Its group.
    pub group: String,
    /// What is hard.
    pub name: String,
    /// What must hold.
    pub criterion: String,
    /// Backends and precisions.
    pub covers: Vec<String>,
    /// Seed of its random numbers.
    pub seed: u64,
    /// How long it took.
    pub seconds: f64,
    /// All figures.
    pub measures: Vec<Measure>,
}

/// A case with what follows from its figures, for JSON.
#[derive(Serialize)]
struct JudgedCase {
    group: String,
    name: String,
    criterion: String,
    covers: Vec<String>,
    seed: u64,
    seconds: f64,
    holds: bool,
    margin: Option<f64>,
    measures: Vec<JudgedMeasure>,
}

#[derive(Serialize)]
struct JudgedMeasure {
    #[serde(flatten)]
    measure: Measure,
    margin: Option<f64>,
    holds: bool,
}

impl From<CaseReport> for JudgedCase {
    fn from(case: CaseReport) -> Self {
        let (holds, margin) = (case.holds(), case.worst().and_then(Measure::margin));
        let judged = |measure: Measure| JudgedMeasure {
            margin: measure.margin(),
            holds: measure.holds(),
            measure,
        };
        JudgedCase {
            group: case.group,
            name: case.name,
            criterion: case.criterion,
            covers: case.covers,
            seed: case.seed,
            seconds: case.seconds,
            holds,
            margin,
            measures: case.measures.into_iter().map(judged).collect(),
        }
    }
}

impl CaseReport {
    /// Whether every figure holds. A case without figures has shown nothing, and does not.
    pub fn holds(&self) -> bool {
        !self.measures.is_empty() && self.measures.iter().all(Measure::holds)
    }

    /// The figure that decides: one that does not hold, or the one nearest to its limit, or the first.
    pub fn worst(&self) -> Option<&Measure> {
        let rank = |measure: &&Measure| match (measure.holds(), measure.limit, measure.margin()) {
            (false, ..) => -1.0,
            (_, None, _) => f64::INFINITY,
            (_, Some(_), None) => f64::MAX,
            (_, Some(_), Some(margin)) => margin,
        };
        self.measures.iter().min_by(|a, b| rank(a).total_cmp(&rank(b)))
    }

    /// The figures that do not hold.
    pub fn failures(&self) -> impl Iterator<Item = &Measure> {
        self.measures.iter().filter(|measure| !measure.holds())
    }

    fn verdict(&self) -> &'static str {
        if self.holds() { "holds" } else { "FAILS" }
    }
}

/// What all cases came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// How long they ran.
    pub effort: Effort,
    /// What they ran on.
    pub machine: Machine,
    /// Each case.
    pub cases: Vec<CaseReport>,
}

fn short(figure: f64) -> String {
    match figure {
        0.0 => "0".to_owned(),
        _ if figure.is_finite() && (1e-2..1e5).contains(&figure.abs()) => {
            let digits = if figure.fract() == 0.0 { 0 } else { 3 };
            format!("{figure:.digits$}")
        }
        _ => format!("{figure:.1e}"),
    }
}

fn limit(measure: &Measure) -> String {
    measure.limit.map_or("-".to_owned(), short)
}

fn margin(measure: &Measure) -> String {
    match measure.margin() {
        Some(margin) if margin < 9.95 => format!("{margin:.1}x"),
        Some(margin) if margin < 9999.5 => format!("{margin:.0}x"),
        Some(margin) => format!("{margin:.0e}x"),
        None if measure.limit.is_some() && measure.figure == 0.0 => "exact".to_owned(),
        None => "-".to_owned(),
    }
}

/// What does not hold, one line each.
pub(super) fn sentence(measure: &Measure) -> String {
    let mut line = format!("{}: {}", measure.what, short(measure.figure));
    if let Some(limit) = measure.limit {
        let _ = write!(line, ", at most {} expected", short(limit));
    } else {
        line.push_str(", a finite number expected");
    }
    if let Some(note) = &measure.note {
        let _ = write!(line, " ({note})");
    }
    line
}

impl Report {
    /// Whether every case holds.
    pub fn holds(&self) -> bool {
        self.cases.iter().all(CaseReport::holds)
    }

    /// Cases that do not hold.
    pub fn failed(&self) -> usize {
        self.cases.iter().filter(|case| !case.holds()).count()
    }

    /// The names of the groups, in the order of their first case.
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

    /// The report with every figure, in Markdown.
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
            let _ = write!(text, "\n## {group}\n");
            for case in self.of_group(group) {
                let covers = case.covers.join(", ");
                let _ = write!(
                    text,
                    "\n### {}: {}\n\n{}. On {covers}; seed {}; {:.1} s.\n\n| measured | figure | limit | margin | |\n|---|---|---|---|---|\n",
                    case.name,
                    case.verdict(),
                    case.criterion,
                    case.seed,
                    case.seconds
                );
                for measure in &case.measures {
                    let note = measure
                        .note
                        .as_deref()
                        .unwrap_or("")
                        .replace('|', "\\|")
                        .replace('\n', " ");
                    let verdict = if measure.holds() { "" } else { "**FAILS** " };
                    let _ = writeln!(
                        text,
                        "| {} | {} | {} | {} | {verdict}{note} |",
                        measure.what,
                        short(measure.figure),
                        limit(measure),
                        margin(measure)
                    );
                }
            }
        }
        text
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "machine: {}; {}", self.machine, self.effort())?;
        for group in self.groups() {
            writeln!(f, "\n{group}")?;
            let mut table = Table::new(
                [
                    "hard case (seed)",
                    "criterion",
                    "measured nearest to its limit",
                    "figure",
                    "limit",
                    "margin",
                    "verdict",
                ],
                [24, 34, 30, 8, 8, 6, 7],
            );
            for case in self.of_group(group) {
                let name = format!("{} ({})", case.name, case.seed);
                let Some(worst) = case.worst() else {
                    table.row([&name, &case.criterion, "nothing", "-", "-", "-", case.verdict()]);
                    continue;
                };
                let numbers = [short(worst.figure), limit(worst), margin(worst)];
                let [figure, limit, margin] = &numbers;
                table.row([
                    &name,
                    &case.criterion,
                    &worst.what,
                    figure,
                    limit,
                    margin,
                    case.verdict(),
                ]);
            }
            write!(f, "{table}")?;
        }
        let failed = self.failed();
        writeln!(f, "\n{} of {} cases hold", self.cases.len() - failed, self.cases.len())?;
        for case in self.cases.iter().filter(|case| !case.holds()) {
            writeln!(f, "{} does not:", case.name)?;
            for measure in case.failures() {
                writeln!(f, "  {}", sentence(measure))?;
            }
        }
        Ok(())
    }
}
