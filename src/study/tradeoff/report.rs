//! Report of all studies: persistent data, and output as a page, Markdown, JSON and CSV.
//!
//! A [`Report`] is made from studies without knowledge of what they compare. All output is derived from it.

mod markdown;
mod page;
#[cfg(test)]
mod tests;

use std::path::Path;
use std::time::Duration;

use serde::Serialize;

use super::advice::Advice;
use super::render::Files;
use super::{Deadline, Rates, RealTimeChoice, Row, Study, Table, real_time};
use crate::stability::Effort;
use insonify_base::machine::Machine;
use insonify_base::number::significant;
use insonify_base::output::OutputError;
use insonify_base::table::{self, Cell};
use insonify_report::plot::Plot;

/// Report of all studies.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Version of the format.
    pub format: u32,
    /// Name and version of the program.
    pub program: String,
    /// Date in UTC.
    pub date: String,
    /// Length of the studies.
    pub effort: Effort,
    /// Required rates of frames and steps.
    pub pace: Rates,
    /// Machine that the CPU parts ran on.
    pub machine: Machine,
    /// Total duration, s.
    pub seconds: f64,
    /// Devices that were not measured, and why.
    pub notes: Vec<String>,
    /// Studies that failed.
    pub missing: Vec<Missing>,
    /// Results of the studies that succeeded, in the order run.
    pub chapters: Vec<Chapter>,
}

/// Study that failed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Missing {
    /// Name of the study.
    pub name: &'static str,
    /// Text of the error that ended it.
    pub reason: String,
}

/// Results of one study.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Chapter {
    /// Name of the study.
    pub name: &'static str,
    /// Title of the study.
    pub title: &'static str,
    /// Question that the study answers; empty if none is stated.
    pub question: &'static str,
    /// Duration, s.
    pub seconds: f64,
    /// Settings and sizes.
    pub about: Vec<(&'static str, String)>,
    /// Tables, except long traces, which are only plotted.
    pub sections: Vec<Section>,
    /// Omissions and their reasons.
    pub notes: Vec<String>,
    #[serde(skip)]
    drawings: Vec<Drawing>,
}

/// Plot with the stem of its file and the key of its table.
#[derive(Clone, Debug, PartialEq)]
struct Drawing {
    stem: String,
    table: &'static str,
    plot: Plot,
}

/// Table of results: a [`Table`] with what follows from its rows, without the columns that have no values.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Section {
    /// Key in JSON and CSV.
    pub key: &'static str,
    /// Title of the table.
    pub title: String,
    /// Gold standard that errors refer to; empty if the table has no errors.
    pub gold: String,
    /// Columns of the factors that distinguish the rows.
    pub factors: Vec<Column>,
    /// Columns of the measured quantities.
    pub axes: Vec<Column>,
    /// Indices of the primary axes: cost, error, and those shown beside them; all axes if the table offers no choice.
    pub first: Vec<usize>,
    /// Variants, each with its choices and the values measured.
    pub rows: Vec<Row>,
    /// Whether each row is among the best.
    pub best: Vec<bool>,
    /// Meaning of the mark of the best rows; empty if no row is marked.
    pub meaning_of_best: String,
    /// Recommendations; empty if the table offers no choice.
    pub advice: Vec<Advice>,
    /// Recommendations at the required pace.
    pub in_time: Vec<RealTimeChoice>,
}

/// Column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Key in JSON and CSV.
    pub key: &'static str,
    /// Short column heading.
    pub heading: &'static str,
    /// Full name, with the unit after the last comma if there is one.
    pub label: &'static str,
    /// Unit; empty if there is none.
    pub unit: &'static str,
}

impl Report {
    /// Version of the format.
    pub(crate) const FORMAT: u32 = 3;

    /// Returns the flagged rows with their chapter and table.
    pub fn wrong(&self) -> impl Iterator<Item = (&Chapter, &Section, &Row)> {
        self.sections().flat_map(|(chapter, section)| {
            let wrong = section.rows.iter().filter(|row| row.flag.is_some());
            wrong.map(move |row| (chapter, section, row))
        })
    }

    /// Returns the sections with their chapters.
    fn sections(&self) -> impl Iterator<Item = (&Chapter, &Section)> {
        let chapters = self.chapters.iter();
        chapters.flat_map(|chapter| chapter.sections.iter().map(move |section| (chapter, section)))
    }

    /// Returns the recommendations at the required pace, in the order of the chapters.
    pub fn in_time(&self) -> impl Iterator<Item = &RealTimeChoice> {
        self.sections().flat_map(|(_, section)| &section.in_time)
    }

    /// Returns the heading of the recommendations at the required pace, and an explanation of their times.
    fn at_this_pace(&self) -> [String; 2] {
        let Rates { frames, steps } = self.pace;
        [
            format!("For {frames} frames and {steps} steps a second"),
            format!(
                "For each choice, the option with the smallest error whose time is within {} ms a frame or {} ms a step. Errors below {} of the \
                 tolerance count as zero: among such options the fastest is chosen. Times of frames are 95th percentiles, times of steps \
                 medians of the steps that remesh.",
                significant(self.pace.ms(Deadline::Frame)),
                significant(self.pace.ms(Deadline::Step)),
                real_time::NEGLIGIBLE_SHARE
            ),
        ]
    }

    /// Returns the report as JSON.
    ///
    /// # Errors
    /// A [`serde_json::Error`], which does not occur, since all numbers are finite.
    pub fn json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// Returns every figure on a line of its own: study, table, choices, axis, unit, value, and the marks of the row.
    pub fn csv(&self) -> String {
        let head = [
            "study", "table", "choices", "axis", "unit", "value", "best", "gold", "flag",
        ];
        let mut table = table::Table::new(head);
        for (chapter, section) in self.sections() {
            for (row, best) in section.judged() {
                let choices = section.factors.iter().zip(&row.choices);
                let choices: Vec<String> = choices.map(|(it, choice)| format!("{}={choice}", it.key)).collect();
                let measured = section.axes.iter().zip(&row.values);
                for (axis, value) in measured.filter_map(|(axis, value)| Some((axis, (*value)?))) {
                    let [name, key, axis, unit] = [chapter.name, section.key, axis.key, axis.unit].map(str::to_owned);
                    let [value, best, gold] = [value.to_string(), best.to_string(), row.gold.to_string()];
                    let flag = row.flag.clone().unwrap_or_default();
                    table.row("", [name, key, choices.join("; "), axis, unit, value, best, gold, flag]);
                }
            }
        }
        table.csv()
    }

    /// Writes `index.html`, `report.md`, `results.json`, `results.csv` and the plots into an existing folder. Returns the file names in the
    /// order written.
    ///
    /// # Errors
    /// [`OutputError`]. Each file is written completely or not at all.
    pub fn write(&self, folder: &Path) -> Result<Vec<String>, OutputError> {
        let mut files = Files::new(folder);
        for drawing in self.chapters.iter().flat_map(|chapter| &chapter.drawings) {
            files.put(format!("{}.svg", drawing.stem), &drawing.plot.svg()?)?;
        }
        files.put("results.csv", &self.csv())?;
        files.put("results.json", &self.json()?)?;
        files.put("report.md", &self.markdown())?;
        files.put("index.html", &self.page()?)?;
        Ok(files.names)
    }
}

impl Chapter {
    /// Creates the chapter of a study.
    pub fn of(name: &'static str, question: &'static str, study: &Study, pace: &Rates, took: Duration) -> Self {
        let drawings = study.plots().into_iter().map(|(figure, plot)| Drawing {
            stem: match figure.file.starts_with(name) {
                true => figure.file.clone(),
                false => format!("{name}-{}", figure.file),
            },
            table: figure.table,
            plot,
        });
        let listed = study.tables.iter().filter(|table| table.listed);
        Chapter {
            name,
            title: study.title,
            question,
            seconds: took.as_secs_f64(),
            about: study.about.clone(),
            sections: listed.map(|table| Section::of(table, pace)).collect(),
            notes: study.notes.clone(),
            drawings: drawings.collect(),
        }
    }

    /// Returns the plots of a table, or with `None` those of traces, which have no section.
    fn drawings_of(&self, section: Option<&Section>) -> impl Iterator<Item = &Drawing> {
        self.drawings.iter().filter(move |drawing| match section {
            Some(section) => section.key == drawing.table,
            None => self.sections.iter().all(|section| section.key != drawing.table),
        })
    }
}

impl Section {
    fn of(table: &Table, pace: &Rates) -> Self {
        let column = |[key, heading, label, unit]: [&'static str; 4]| Column {
            key,
            heading,
            label,
            unit,
        };
        let factors = table.factors.iter().map(|it| column([it.key, it.label, it.label, ""]));
        let shown = table.filled();
        let axes = shown.iter().map(|at| &table.axes[*at]);
        let axes = axes.map(|it| column([it.key, it.heading, it.label, it.unit()]));
        let row = |row: &Row| Row {
            values: shown.iter().map(|at| row.values[*at]).collect(),
            ..row.clone()
        };
        let first: Vec<&str> = match &table.goal {
            Some(goal) => [&[goal.cost, goal.error], &goal.beside[..]].concat(),
            None => table.axes.iter().map(|axis| axis.key).collect(),
        };
        let place = |key: &str| shown.iter().position(|at| table.axes[*at].key == key);
        Section {
            key: table.key,
            title: table.title.clone(),
            gold: table.gold.clone(),
            factors: factors.collect(),
            axes: axes.collect(),
            first: first.into_iter().filter_map(place).collect(),
            rows: table.rows.iter().map(row).collect(),
            best: table.best(),
            meaning_of_best: table.meaning_of_best(),
            advice: table.advice(),
            in_time: table.in_time(pace),
        }
    }

    /// Returns the rows, each with whether it is one of the best.
    fn judged(&self) -> impl Iterator<Item = (&Row, bool)> {
        self.rows.iter().zip(self.best.iter().copied())
    }

    /// Returns the rows with some of the axes.
    fn table(&self, axes: &[usize]) -> table::Table {
        let factors = self.factors.iter().map(|factor| Cell::from(factor.heading));
        let axis = |at: &usize| Cell::Explained(self.axes[*at].heading.to_owned(), self.axes[*at].label.to_owned());
        let mut table = table::Table::new(factors.chain(axes.iter().map(axis)).chain(["".into()]));
        for (row, best) in self.judged() {
            let choices = row.choices.iter().map(|choice| Cell::from(choice.as_str()));
            let values = axes.iter().map(|at| row.figure(*at).into());
            let class = if row.flag.is_some() { "wrong" } else { "" };
            table.row(
                class,
                choices.chain(values).chain([Cell::Tags(Section::tags((row, best)))]),
            );
        }
        table
    }

    /// Describes the columns of some axes, and the marks of the rows.
    fn legend(&self, axes: &[usize]) -> String {
        let axes = axes.iter().map(|at| &self.axes[*at]);
        let columns = axes.filter(|axis| axis.heading != axis.label);
        let columns = columns.map(|axis| format!("{}: {}", axis.heading, axis.label));
        let columns = columns.collect::<Vec<_>>().join("; ");
        let words = [("Columns: ", &columns), ("", &self.meaning_of_best)];
        let words = words.into_iter().filter(|(_, words)| !words.is_empty());
        words
            .map(|(what, words)| format!("{what}{words}."))
            .collect::<Vec<_>>()
            .join(" ")
    }

    /// Returns the labels of a row (flagged, gold standard, best), each with a CSS class.
    fn tags((row, best): (&Row, bool)) -> Vec<(&'static str, String)> {
        let flag = row.flag.as_ref().map(|flag| ("bad", format!("WRONG: {flag}")));
        let gold = row.gold.then(|| ("plain", "gold standard".to_owned()));
        let best = best.then(|| ("good", "best".to_owned()));
        [flag, gold, best].into_iter().flatten().collect()
    }
}
