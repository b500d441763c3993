//! What accuracy costs in time: the one shape of all studies of that kind.
//!
//! A [`Study`] holds [`Table`]s. A row of a table is one way of doing a thing: [`Factor`]s say which (level, backend, precision,
//! size), [`Axis`] by axis it has a figure (time, error, bytes). [`Figure`]s name the axes to plot against each other. A study
//! only measures and fills in, names the gold standard of each table and what a user wants of it ([`Goal`]); advice follows from
//! the rows ([`Table::advice`]), and so does which of them are the best ([`Table::best`]); text, JSON, CSV and plots are made from the tables in one place, [`Study::text`] and its neighbours.
//!
//! | module | what it studies |
//! |---|---|
//! | [`gather`] | all of them, one after the other, into one [`report`] |
//! | [`insertion`] | needle insertions: levels, bevels, models, candidates of the probe, links |
//! | [`beam`] | the needle as a beam in tissue |
//! | [`remesh`] | levels of remeshing |
//! | [`history`] | rules of fading memory |
//! | [`tissue`] | schemes and models of tissue that stiffens and creeps |
//! | [`image`] | grids, labels, sampling, grain and backends of images |

mod advice;
pub mod beam;
mod best;
pub mod gather;
pub mod history;
pub mod image;
pub mod insertion;
mod pace;
pub mod remesh;
mod render;
pub mod report;
#[cfg(test)]
mod tests;
pub mod tissue;

use serde::{Deserialize, Serialize};

pub use advice::{Advice, FORCE_N, GREY_LEVELS, Goal, SHIFT_MM, Way};
pub use pace::{Beat, InTime, Pace};
pub use render::RenderError;

use super::machine::Machine;

/// What tells rows apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Factor {
    /// Key in JSON and CSV.
    pub key: &'static str,
    /// Heading.
    pub label: &'static str,
}

impl Factor {
    /// A choice in words: a bare number has the label around it, as in "spacing 5 mm" of a label "spacing, mm".
    pub fn name(&self, choice: &str) -> String {
        match (choice.parse::<f64>(), self.label.rsplit_once(", ")) {
            (Ok(_), Some((what, unit))) => format!("{what} {choice} {unit}"),
            (Ok(_), None) => format!("{}: {choice}", self.label),
            (Err(_), _) => choice.to_owned(),
        }
    }
}

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Axis {
    /// Key in JSON and CSV; ends with the unit where there is one.
    pub key: &'static str,
    /// Heading of a column, short.
    pub heading: &'static str,
    /// Label of a plot's axis; where it has a unit, that stands behind the last comma.
    pub label: &'static str,
    /// Whether plots show it on a logarithmic scale.
    pub log: bool,
}

impl Axis {
    /// An axis whose plots are logarithmic.
    pub const fn log(key: &'static str, heading: &'static str, label: &'static str) -> Axis {
        Axis {
            key,
            heading,
            label,
            log: true,
        }
    }

    /// An axis whose plots are linear.
    pub const fn linear(key: &'static str, heading: &'static str, label: &'static str) -> Axis {
        Axis {
            key,
            heading,
            label,
            log: false,
        }
    }

    /// The unit; empty where there is none.
    pub fn unit(&self) -> &'static str {
        self.label.rsplit_once(", ").map_or("", |(_, unit)| unit)
    }
}

/// One way of doing a thing, and how it did.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// One for each factor.
    pub choices: Vec<String>,
    /// One for each axis; none where it was not or cannot be measured.
    pub values: Vec<Option<f64>>,
    /// Whether the others are compared with it (see [`Table::mark_gold`]).
    pub gold: bool,
    /// What is wrong with it: a promise broken.
    pub flag: Option<String>,
}

/// Rows with the same factors and axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Key in JSON, stem of the CSV file.
    pub key: &'static str,
    /// Heading.
    pub title: String,
    /// What errors are measured against; empty where there are none.
    pub gold: String,
    /// What a user wants of it; none where it shows how things are and there is nothing to choose.
    pub goal: Option<Goal>,
    /// What tells rows apart.
    pub factors: Vec<Factor>,
    /// What is measured.
    pub axes: Vec<Axis>,
    /// The rows.
    pub rows: Vec<Row>,
    /// Whether the text for people lists it: long traces are for plots and programs.
    pub listed: bool,
}

/// A plot of a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Stem of its files.
    pub file: String,
    /// Title.
    pub title: String,
    /// Key of the table.
    pub table: &'static str,
    /// Key of the horizontal axis.
    pub x: &'static str,
    /// Key of the vertical axis.
    pub y: &'static str,
    /// Key of the factor that has a colour for each of its choices.
    pub colour: &'static str,
    /// Keys of the factors that have a marker for each combination.
    pub marker: Vec<&'static str>,
    /// Only rows with these choices, by key of the factor.
    pub only: Vec<(&'static str, String)>,
    /// Whether lines join points of one colour and marker.
    pub joined: bool,
    /// Whether points are marked: of a long trace a line is enough.
    pub marked: bool,
}

impl Figure {
    /// Marked points of a table, those of a colour joined: no shapes, every row.
    pub fn new(
        file: impl Into<String>,
        title: impl Into<String>,
        table: &'static str,
        [x, y]: [&'static str; 2],
        colour: &'static str,
    ) -> Self {
        Figure {
            file: file.into(),
            title: title.into(),
            table,
            x,
            y,
            colour,
            marker: Vec::new(),
            only: Vec::new(),
            joined: true,
            marked: true,
        }
    }
}

/// Everything that one run has found out.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// Its name.
    pub name: &'static str,
    /// Heading of its page.
    pub title: &'static str,
    /// What was studied: settings, sizes.
    pub about: Vec<(&'static str, String)>,
    /// What the CPU part ran on.
    pub machine: Machine,
    /// The tables.
    pub tables: Vec<Table>,
    /// The plots to make of them.
    pub figures: Vec<Figure>,
    /// What was left out, and why.
    pub notes: Vec<String>,
}

impl Table {
    /// A table without rows.
    pub fn new(key: &'static str, title: impl Into<String>, factors: &[Factor], axes: &[Axis]) -> Self {
        Table {
            key,
            title: title.into(),
            gold: String::new(),
            goal: None,
            factors: factors.to_vec(),
            axes: axes.to_vec(),
            rows: Vec::new(),
            listed: true,
        }
    }

    /// A long trace, which the text for people leaves out.
    pub fn trace(key: &'static str, title: impl Into<String>, factors: &[Factor], axes: &[Axis]) -> Self {
        Table {
            listed: false,
            ..Table::new(key, title, factors, axes)
        }
    }

    /// Names what errors are measured against.
    pub fn against(mut self, gold: impl Into<String>) -> Self {
        self.gold = gold.into();
        self
    }

    /// Says what a user wants of it.
    ///
    /// # Panics
    /// If a key is none of the table's: that is the program's own fault.
    pub fn seeking(mut self, goal: Goal) -> Self {
        let timed = goal.every.map(|(_, key)| key);
        let axes = [goal.cost, goal.error].into_iter().chain(goal.beside.iter().copied());
        let mut axes = axes.chain(timed);
        let mut factors = goal.each.iter().chain(&goal.over);
        let known = axes.all(|key| self.axis(key).is_some()) && factors.all(|key| self.factor(key).is_some());
        assert!(known, "keys of {}: {goal:?}", self.key);
        self.goal = Some(goal);
        self
    }

    /// Marks the rows with this choice of a factor as what the others are compared with.
    pub fn mark_gold(&mut self, factor: &str, choice: &str) {
        let Some(at) = self.factor(factor) else { return };
        let own = self.rows.iter_mut().filter(|row| row.choices[at] == choice);
        own.for_each(|row| row.gold = true);
    }

    /// Adds a row. Values that are not finite count as not measured, and flag the row.
    ///
    /// # Panics
    /// If there is not one choice a factor and one value an axis: that is the program's own fault.
    pub fn push(&mut self, choices: Vec<String>, values: Vec<Option<f64>>, flag: Option<String>) {
        assert_eq!(
            (choices.len(), values.len()),
            (self.factors.len(), self.axes.len()),
            "a choice a factor and a value an axis of {}",
            self.key
        );
        let undefined = self.axes.iter().zip(&values);
        let undefined = undefined.filter(|(_, value)| value.is_some_and(|value| !value.is_finite()));
        let undefined: Vec<_> = undefined.map(|(axis, _)| axis.key).collect();
        let flag = flag.or_else(|| (!undefined.is_empty()).then(|| format!("not finite: {}", undefined.join(", "))));
        self.rows.push(Row {
            choices,
            values: values
                .into_iter()
                .map(|value| value.filter(|x| x.is_finite()))
                .collect(),
            gold: false,
            flag,
        });
    }

    /// Where an axis is among the values of a row.
    fn axis(&self, key: &str) -> Option<usize> {
        self.axes.iter().position(|axis| axis.key == key)
    }

    /// Where a factor is among the choices of a row.
    fn factor(&self, key: &str) -> Option<usize> {
        self.factors.iter().position(|factor| factor.key == key)
    }

    /// Value of a row on an axis; none where there is no such axis or nothing was measured.
    pub fn value(&self, row: &Row, key: &str) -> Option<f64> {
        row.values[self.axis(key)?]
    }
}
