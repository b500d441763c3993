//! Report of all studies: persistent data, and output as a page, Markdown, JSON and CSV.
//!
//! A [`Report`] is made from studies without knowledge of what they compare. All output is derived from it.

mod markdown;
mod page;
#[cfg(test)]
mod tests;

use std::path::Path;

use serde::{Serialize, Serializer};

use super::advice::Advice;
use super::render::Files;
use super::{Deadline, Figure, Rates, RealTimeChoice, Row, Study, Table, real_time};
use crate::stability::Effort;
use insonify_base::machine::Machine;
use insonify_base::number::significant;
use insonify_base::output::OutputError;
use insonify_base::table;

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

/// One study of the report.
#[derive(Clone, Debug, PartialEq)]
pub struct Chapter {
    /// Name of the study.
    pub name: &'static str,
    /// Question that the study answers.
    pub question: &'static str,
    /// Duration, s.
    pub seconds: f64,
    /// Required rates of frames and steps.
    pub pace: Rates,
    /// Results.
    pub study: Study,
}

/// Form of a chapter in `results.json`.
#[derive(Serialize)]
struct WrittenChapter<'a> {
    name: &'a str,
    title: &'a str,
    question: &'a str,
    seconds: f64,
    about: &'a [(&'static str, String)],
    sections: Vec<WrittenTable<'a>>,
    notes: &'a [String],
}

/// Form of a table in `results.json`, without the columns that have no values.
#[derive(Serialize)]
struct WrittenTable<'a> {
    key: &'a str,
    title: &'a str,
    gold: &'a str,
    factors: Vec<WrittenColumn>,
    axes: Vec<WrittenColumn>,
    /// Indices of the primary axes.
    first: Vec<usize>,
    rows: Vec<Row>,
    best: Vec<bool>,
    meaning_of_best: String,
    advice: Vec<Advice>,
    in_time: Vec<RealTimeChoice>,
}

#[derive(Serialize)]
struct WrittenColumn {
    key: &'static str,
    heading: &'static str,
    label: &'static str,
    unit: &'static str,
}

impl Serialize for Chapter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let written = WrittenChapter {
            name: self.name,
            title: self.study.title,
            question: self.question,
            seconds: self.seconds,
            about: &self.study.about,
            sections: self.study.listed().map(|table| written(table, &self.pace)).collect(),
            notes: &self.study.notes,
        };
        written.serialize(serializer)
    }
}

fn written<'a>(table: &'a Table, pace: &Rates) -> WrittenTable<'a> {
    let column = |[key, heading, label, unit]: [&'static str; 4]| WrittenColumn {
        key,
        heading,
        label,
        unit,
    };
    let filled = table.filled();
    let factors = table.factors.iter();
    let axes = filled.iter().map(|axis| &table.axes[*axis]);
    let position = |axis: &usize| filled.iter().position(|shown_axis| shown_axis == axis);
    let row = |row: &Row| Row {
        values: filled.iter().map(|axis| row.values[*axis]).collect(),
        ..row.clone()
    };
    WrittenTable {
        key: table.key,
        title: &table.title,
        gold: &table.gold,
        factors: factors
            .map(|factor| column([factor.key, factor.label, factor.label, ""]))
            .collect(),
        axes: axes
            .map(|axis| column([axis.key, axis.heading, axis.label, axis.unit()]))
            .collect(),
        first: table.primary().iter().filter_map(position).collect(),
        rows: table.rows.iter().map(row).collect(),
        best: table.best(),
        meaning_of_best: table.meaning_of_best(),
        advice: table.advice(),
        in_time: table.in_time(pace),
    }
}

impl Report {
    /// Version of the format.
    pub(crate) const FORMAT: u32 = 3;

    /// Returns the flagged rows with their chapter and table.
    pub fn wrong(&self) -> impl Iterator<Item = (&Chapter, &Table, &Row)> {
        self.tables().flat_map(|(chapter, table)| {
            let wrong = table.rows.iter().filter(|row| row.flag.is_some());
            wrong.map(move |row| (chapter, table, row))
        })
    }

    /// Returns the tables, except long traces, with their chapters.
    pub fn tables(&self) -> impl Iterator<Item = (&Chapter, &Table)> {
        let chapters = self.chapters.iter();
        chapters.flat_map(|chapter| chapter.study.listed().map(move |table| (chapter, table)))
    }

    /// Returns the recommendations at the required pace, in the order of the chapters.
    pub fn in_time(&self) -> impl Iterator<Item = RealTimeChoice> {
        self.tables().flat_map(|(_, table)| table.in_time(&self.pace))
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
        for (chapter, table_data) in self.tables() {
            for (row, best) in table_data.judged() {
                let choices = table_data.factors.iter().zip(&row.choices);
                let choices: Vec<String> = choices
                    .map(|(factor, choice)| format!("{}={choice}", factor.key))
                    .collect();
                let measured = table_data.axes.iter().zip(&row.values);
                for (axis, value) in measured.filter_map(|(axis, value)| Some((axis, (*value)?))) {
                    let [name, key, axis, unit] =
                        [chapter.name, table_data.key, axis.key, axis.unit()].map(str::to_owned);
                    let [value, best, gold] = [value.to_string(), best.to_string(), row.gold.to_string()];
                    let flag = row.flag.clone().unwrap_or_default();
                    table.row("", [name, key, choices.join("; "), axis, unit, value, best, gold, flag]);
                }
            }
        }
        table.csv()
    }

    /// Writes `index.html`, `report.md`, `results.json`, `results.csv` and the plots into an existing folder. Returns
    /// the file names in the order written.
    ///
    /// # Errors
    /// [`OutputError`]. Each file is written completely or not at all.
    pub fn write(&self, folder: &Path) -> Result<Vec<String>, OutputError> {
        let mut files = Files::new(folder);
        for chapter in &self.chapters {
            for (figure, plot) in chapter.study.plots() {
                files.put(format!("{}.svg", chapter.stem(figure)), &plot.svg()?)?;
            }
        }
        files.put("results.csv", &self.csv())?;
        files.put("results.json", &self.json()?)?;
        files.put("report.md", &self.markdown())?;
        files.put("index.html", &self.page()?)?;
        Ok(files.names)
    }
}

impl Chapter {
    /// Stem of the file of a figure.
    fn stem(&self, figure: &Figure) -> String {
        if figure.file.starts_with(self.name) {
            figure.file.clone()
        } else {
            format!("{}-{}", self.name, figure.file)
        }
    }
}
