//! What all studies came to: data that outlives the run, as a page, Markdown, JSON and CSV.
//!
//! A [`Report`] is made from studies and knows nothing of what they compare. Everything shown is made from it; read back from its
//! JSON it equals what was written.

mod markdown;
mod page;
#[cfg(test)]
mod tests;

use std::io::Write;
use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::advice::Advice;
use super::render::{RenderError, number, quoted};
use super::{Beat, InTime, Pace, Row, Study, Table, pace};
use crate::output::atomic;
use crate::study::machine::Machine;
use crate::study::plot::Plot;
use crate::study::stability::Effort;

/// What all studies came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Version of this form.
    pub format: u32,
    /// What measured it.
    pub program: String,
    /// When, in UTC.
    pub date: String,
    /// How long it was let run.
    pub effort: Effort,
    /// How often frames and steps are wanted.
    pub pace: Pace,
    /// On what.
    pub machine: Machine,
    /// How long it took, s.
    pub seconds: f64,
    /// What was not measured, and why.
    pub notes: Vec<String>,
    /// Studies that could not be made.
    pub missing: Vec<Missing>,
    /// The others.
    pub chapters: Vec<Chapter>,
}

/// A study that could not be made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Missing {
    /// Its name.
    pub name: String,
    /// Why.
    pub reason: String,
}

/// What one study came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Chapter {
    /// Its name.
    pub name: String,
    /// Heading.
    pub title: String,
    /// What it answers.
    pub question: String,
    /// How long it took, s.
    pub seconds: f64,
    /// Settings and sizes.
    pub about: Vec<(String, String)>,
    /// Its tables but for long traces, which are plotted alone.
    pub sections: Vec<Section>,
    /// What was left out, and why.
    pub notes: Vec<String>,
    /// Its plots.
    #[serde(skip)]
    drawings: Vec<Drawing>,
}

/// A plot with the stem of its file and the key of its table.
#[derive(Clone, Debug, PartialEq)]
struct Drawing {
    stem: String,
    table: &'static str,
    plot: Plot,
}

/// A table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Section {
    /// Its key.
    pub key: String,
    /// Heading.
    pub title: String,
    /// What errors are against; empty where there are none.
    pub gold: String,
    /// What tells rows apart.
    pub factors: Vec<Column>,
    /// What was measured.
    pub axes: Vec<Column>,
    /// Which axes count first: cost, error, and what stands beside them; all where there is nothing to choose.
    pub first: Vec<usize>,
    /// The rows.
    pub rows: Vec<Row>,
    /// Which of them are the best.
    pub best: Vec<bool>,
    /// What that says; empty where no row is.
    pub meaning_of_best: String,
    /// What to take.
    pub advice: Vec<Advice>,
    /// What to take at the pace that is wanted.
    pub in_time: Vec<InTime>,
}

/// A column of a table.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Key.
    pub key: String,
    /// Heading, short.
    pub heading: String,
    /// What it is, in full.
    pub label: String,
    /// Its unit; empty where there is none.
    pub unit: String,
}

impl Report {
    /// Version of the form.
    pub const FORMAT: u32 = 3;

    /// Rows that break what they promise: chapter, table and flag.
    pub fn wrong(&self) -> impl Iterator<Item = (&Chapter, &Section, &Row)> {
        let sections = self.chapters.iter().flat_map(|chapter| {
            let own = chapter.sections.iter();
            own.map(move |section| (chapter, section))
        });
        sections.flat_map(|(chapter, section)| {
            let wrong = section.rows.iter().filter(|row| row.flag.is_some());
            wrong.map(move |row| (chapter, section, row))
        })
    }

    /// What to take at the pace that is wanted, in the order of the chapters.
    pub fn in_time(&self) -> impl Iterator<Item = &InTime> {
        let sections = self.chapters.iter().flat_map(|chapter| &chapter.sections);
        sections.flat_map(|section| &section.in_time)
    }

    /// Heading of what to take at the pace that is wanted, and what its times are.
    fn at_this_pace(&self) -> [String; 2] {
        let Pace { frames, steps } = self.pace;
        [
            format!("For {frames} frames and {steps} steps a second"),
            format!(
                "For each choice, the option with the smallest error whose time is within {} ms a frame or {} ms a step. Errors below {} of the \
                 tolerance count as zero: among such options the fastest is chosen. Times of frames are 95th percentiles, times of steps \
                 medians of the steps that remesh.",
                number(self.pace.ms(Beat::Frame)),
                number(self.pace.ms(Beat::Step)),
                pace::NOTHING
            ),
        ]
    }

    /// The report for programs.
    ///
    /// # Errors
    /// None that the report can cause: its numbers are finite.
    pub fn json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// Every figure in a line of its own: study, table, choices, axis, unit, value, and what is said of the row.
    pub fn csv(&self) -> String {
        let mut text = "study,table,choices,axis,unit,value,best,gold,flag\n".to_owned();
        for (chapter, section) in self
            .chapters
            .iter()
            .flat_map(|it| it.sections.iter().map(move |own| (it, own)))
        {
            for (row, best) in section.judged() {
                let choices = section.factors.iter().zip(&row.choices);
                let choices: Vec<String> = choices
                    .map(|(factor, choice)| format!("{}={choice}", factor.key))
                    .collect();
                let measured = section.axes.iter().zip(&row.values);
                for (axis, value) in measured.filter_map(|(axis, value)| Some((axis, (*value)?))) {
                    let value = value.to_string();
                    let [best, gold] = [best, row.gold].map(|it| it.to_string());
                    let flag = row.flag.as_deref().unwrap_or("");
                    let choices = choices.join("; ");
                    let cells = [
                        &chapter.name,
                        &section.key,
                        &choices,
                        &axis.key,
                        &axis.unit,
                        &value,
                        &best,
                        &gold,
                        flag,
                    ];
                    text += &cells.map(quoted).join(",");
                    text.push('\n');
                }
            }
        }
        text
    }

    /// Writes `index.html`, `report.md`, `results.json`, `results.csv` and the plots into a folder that exists. Returns the names of
    /// the files, in the order written.
    ///
    /// # Errors
    /// [`RenderError`]. Each file appears whole or not at all.
    pub fn write(&self, folder: &Path) -> Result<Vec<String>, RenderError> {
        let mut files = Vec::new();
        let mut put = |name: String, text: &str| -> Result<(), RenderError> {
            atomic::write(&folder.join(&name), |file| file.write_all(text.as_bytes()))?;
            files.push(name);
            Ok(())
        };
        for drawing in self.chapters.iter().flat_map(|chapter| &chapter.drawings) {
            put(format!("{}.svg", drawing.stem), &drawing.plot.svg()?)?;
        }
        put("results.csv".to_owned(), &self.csv())?;
        put("results.json".to_owned(), &self.json()?)?;
        put("report.md".to_owned(), &self.markdown())?;
        put("index.html".to_owned(), &self.page()?)?;
        Ok(files)
    }
}

impl Chapter {
    /// What a study came to.
    pub fn of(name: &str, question: &str, study: &Study, pace: &Pace, took: Duration) -> Self {
        let figures = study.figures.iter().filter_map(|figure| {
            let table = study.tables.iter().find(|table| table.key == figure.table)?;
            let stem = match figure.file.starts_with(name) {
                true => figure.file.clone(),
                false => format!("{name}-{}", figure.file),
            };
            Some(Drawing {
                stem,
                table: figure.table,
                plot: table.plot(figure)?,
            })
        });
        Chapter {
            name: name.to_owned(),
            title: study.title.to_owned(),
            question: question.to_owned(),
            seconds: took.as_secs_f64(),
            about: study
                .about
                .iter()
                .map(|(key, value)| ((*key).to_owned(), value.clone()))
                .collect(),
            sections: study
                .tables
                .iter()
                .filter(|table| table.listed)
                .map(|table| Section::of(table, pace))
                .collect(),
            notes: study.notes.clone(),
            drawings: figures.collect(),
        }
    }

    /// Its plots of a table; those of traces, which have no section, with none.
    fn drawings_of(&self, section: Option<&Section>) -> impl Iterator<Item = &Drawing> {
        self.drawings.iter().filter(move |drawing| match section {
            Some(section) => section.key == drawing.table,
            None => self.sections.iter().all(|section| section.key != drawing.table),
        })
    }
}

impl Section {
    fn of(table: &Table, pace: &Pace) -> Self {
        let factors = table.factors.iter().map(|factor| Column {
            key: factor.key.to_owned(),
            heading: factor.label.to_owned(),
            label: factor.label.to_owned(),
            unit: String::new(),
        });
        // Columns that nobody filled tell nothing.
        let filled = |at: &usize| table.rows.iter().any(|row| row.values[*at].is_some());
        let shown: Vec<usize> = (0..table.axes.len()).filter(filled).collect();
        let axes = shown.iter().map(|at| &table.axes[*at]).map(|axis| Column {
            key: axis.key.to_owned(),
            heading: axis.heading.to_owned(),
            label: axis.label.to_owned(),
            unit: axis.unit().to_owned(),
        });
        let row = |row: &Row| Row {
            values: shown.iter().map(|at| row.values[*at]).collect(),
            ..row.clone()
        };
        let first: Vec<&str> = match &table.goal {
            Some(goal) => [goal.cost, goal.error]
                .into_iter()
                .chain(goal.beside.iter().copied())
                .collect(),
            None => table.axes.iter().map(|axis| axis.key).collect(),
        };
        let place = |key: &str| shown.iter().position(|at| table.axes[*at].key == key);
        Section {
            key: table.key.to_owned(),
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

    /// The rows, each with whether it is one of the best.
    fn judged(&self) -> impl Iterator<Item = (&Row, bool)> {
        self.rows.iter().zip(self.best.iter().copied())
    }

    /// What the columns of some axes are, and the marks of the rows.
    fn legend(&self, axes: &[usize]) -> String {
        let axes = axes.iter().map(|at| &self.axes[*at]);
        let columns = axes.filter(|axis| axis.heading != axis.label);
        let columns: Vec<String> = columns
            .map(|axis| format!("{}: {}", axis.heading, axis.label))
            .collect();
        let columns = match columns.join("; ") {
            none if none.is_empty() => none,
            some => format!("Columns: {some}."),
        };
        let best = match self.meaning_of_best.as_str() {
            "" => String::new(),
            meaning => format!("{meaning}."),
        };
        let words = [columns, best].into_iter().filter(|words| !words.is_empty());
        words.collect::<Vec<_>>().join(" ")
    }

    /// The words of the flag, gold and best of a row, with a class for each.
    fn tags((row, best): (&Row, bool)) -> Vec<(&'static str, String)> {
        let flag = row.flag.as_ref().map(|flag| ("bad", format!("WRONG: {flag}")));
        let gold = row.gold.then(|| ("plain", "gold standard".to_owned()));
        let best = best.then(|| ("good", "best".to_owned()));
        [flag, gold, best].into_iter().flatten().collect()
    }
}
