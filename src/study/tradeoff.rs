//! Studies of accuracy against computing time: their common data model.
//!
//! A [`Study`] holds [`Table`]s. A row of a table is one variant: its [`Factor`]s identify it (level, backend,
//! precision, size), and for each [`Axis`] it has a value (time, error, bytes). [`Figure`]s name the axes to plot
//! against each other. A study only measures, and names the gold standard of each table and the user's [`Goal`]. Advice
//! ([`Table::advice`]) and the best rows ([`Table::best`]) are derived from the rows; text, JSON, CSV and plots are all
//! made in one place ([`Study::text`] and related methods).
//!
//! [`STUDIES`] is the only registry of studies: one that is not listed has no row, plot, advice or subcommand anywhere.
//! A study is a file with its rows, their columns, its options and an `ENTRY`, and a line of `studies!`. [`gather`]
//! runs them in sequence into one [`report`].

mod advice;
pub mod entry;
pub mod gather;
mod real_time;
mod render;
pub mod report;
#[cfg(test)]
mod tests;

use serde::Serialize;

pub use advice::{Advice, Goal, Variant};
pub(crate) use advice::{FORCE_N, GREY_LEVELS, SHIFT_MM};
pub use real_time::{Deadline, Rates, RealTimeChoice};

use entry::AnyEntry;
use insonify_base::machine::Machine;

/// Declares the studies, each a module with its `ENTRY`.
macro_rules! studies {
    ($($visibility:vis $module:ident,)+) => {
        $($visibility mod $module;)+

        /// All studies, in the order of the report.
        pub const STUDIES: &[&dyn AnyEntry] = &[$(&$module::ENTRY),+];
    };
}

studies! {
    pub(crate) image,
    pub(crate) remesh,
    pub(crate) insertion,
    tissue,
    beam,
    history,
    pub motion,
    planning,
}

/// Parameter that distinguishes the rows of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Factor {
    /// Key in JSON and CSV.
    pub key: &'static str,
    /// Column heading.
    pub label: &'static str,
}

impl Factor {
    /// Creates a factor.
    pub const fn new(key: &'static str, label: &'static str) -> Factor {
        Factor { key, label }
    }

    /// Declares the choice of a row.
    pub(crate) const fn of<R>(self, text: fn(&R) -> String) -> Choice<R> {
        Choice { factor: self, text }
    }

    /// Describes a choice in words: a bare number is put into the label, as in "spacing 5 mm" for the label "spacing,
    /// mm".
    pub fn name(&self, choice: &str) -> String {
        match (choice.parse::<f64>(), self.label.rsplit_once(", ")) {
            (Ok(_), Some((what, unit))) => format!("{what} {choice} {unit}"),
            (Ok(_), None) => format!("{}: {choice}", self.label),
            (Err(_), _) => choice.to_owned(),
        }
    }
}

/// Measured quantity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Axis {
    /// Key in JSON and CSV, ending with the unit if there is one.
    pub key: &'static str,
    /// Short column heading.
    pub heading: &'static str,
    /// Label of the plot axis, with the unit after the last comma if there is one.
    pub label: &'static str,
    /// Whether plots use a logarithmic scale.
    pub log: bool,
}

impl Axis {
    /// Creates an axis that plots on a logarithmic scale.
    pub const fn log(key: &'static str, heading: &'static str, label: &'static str) -> Axis {
        Axis {
            key,
            heading,
            label,
            log: true,
        }
    }

    /// Creates an axis that plots on a linear scale.
    pub const fn linear(key: &'static str, heading: &'static str, label: &'static str) -> Axis {
        Axis {
            key,
            heading,
            label,
            log: false,
        }
    }

    /// Declares the value of a row; `None` if it was not or cannot be measured.
    pub(crate) const fn of<R>(self, value: fn(&R) -> Option<f64>) -> Column<R> {
        Column { axis: self, value }
    }

    /// Returns the unit; empty if there is none.
    pub fn unit(&self) -> &'static str {
        self.label.rsplit_once(", ").map_or("", |(_, unit)| unit)
    }
}

/// Factor of rows of type `R`.
pub(crate) struct Choice<R> {
    factor: Factor,
    text: fn(&R) -> String,
}

/// Axis of rows of type `R`.
pub(crate) struct Column<R> {
    axis: Axis,
    value: fn(&R) -> Option<f64>,
}

/// One variant and its results, as they are written.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Choice for each factor.
    pub choices: Vec<String>,
    /// Value on each axis; `None` if it was not or cannot be measured.
    pub values: Vec<Option<f64>>,
    /// Whether this row is the gold standard of the others (errors are differences from it).
    pub gold: bool,
    /// Failure to report, such as a violated guarantee.
    pub flag: Option<String>,
}

/// Rows with common factors and axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Key in JSON and stem of the CSV file.
    pub key: &'static str,
    /// Title of the table.
    pub title: String,
    /// Gold standard that errors refer to; empty if the table has no errors.
    pub gold: String,
    /// Goal of a user who chooses from the table; `None` if the table offers no choice.
    pub goal: Option<Goal>,
    /// Factors that distinguish the rows.
    pub factors: Vec<Factor>,
    /// Measured quantities.
    pub axes: Vec<Axis>,
    /// Variants with their results.
    pub rows: Vec<Row>,
    /// Whether the text report lists the table; long traces are left to plots and programs.
    pub listed: bool,
}

/// Plot of a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figure {
    /// Stem of the file names.
    pub file: String,
    /// Title of the plot.
    pub title: String,
    /// Key of the table.
    pub table: &'static str,
    /// Key of the horizontal axis.
    pub x: &'static str,
    /// Key of the vertical axis.
    pub y: &'static str,
    /// Key of the factor shown by colour.
    pub colour: &'static str,
    /// Keys of the factors shown by marker, one for each combination of choices.
    pub marker: Vec<&'static str>,
    /// Filter: only rows with these choices, by key of the factor.
    pub only: Vec<(&'static str, String)>,
    /// Whether lines join the points of one colour and marker.
    pub joined: bool,
    /// Whether points are marked; a line is enough for a long trace.
    pub marked: bool,
}

impl Figure {
    /// Creates a plot of all rows with marked points, joined within a colour, and no factor shown by marker.
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

/// Results of one run.
#[derive(Clone, Debug, PartialEq)]
pub struct Study {
    /// Name of the study and stem of its JSON file.
    pub name: &'static str,
    /// Title of the page.
    pub title: &'static str,
    /// Settings and sizes studied.
    pub about: Vec<(&'static str, String)>,
    /// Machine that the CPU part ran on.
    pub machine: Machine,
    /// Result tables.
    pub tables: Vec<Table>,
    /// Plots of the tables.
    pub figures: Vec<Figure>,
    /// Parts left out, with the reasons.
    pub notes: Vec<String>,
}

impl Table {
    /// Creates a table without rows.
    fn new(key: &'static str, title: impl Into<String>, factors: &[Factor], axes: &[Axis]) -> Self {
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

    /// Creates a table of typed rows.
    pub(crate) fn of<R>(
        key: &'static str,
        title: impl Into<String>,
        choices: &[Choice<R>],
        columns: &[Column<R>],
        rows: &[R],
    ) -> Self {
        let factors: Vec<Factor> = choices.iter().map(|choice| choice.factor).collect();
        let axes: Vec<Axis> = columns.iter().map(|column| column.axis).collect();
        let mut table = Table::new(key, title, &factors, &axes);
        for row in rows {
            let choices = choices.iter().map(|choice| (choice.text)(row));
            let values = columns.iter().map(|column| (column.value)(row));
            table.push(choices.collect(), values.collect(), None);
        }
        table
    }

    /// Omits the table from the text report, as a long trace.
    pub(crate) fn unlisted(mut self) -> Self {
        self.listed = false;
        self
    }

    /// Flags the rows that were made of `rows`.
    pub(crate) fn flagged<R>(mut self, rows: &[R], flag: impl Fn(&R) -> Option<String>) -> Self {
        for (written, row) in self.rows.iter_mut().zip(rows) {
            written.flag = flag(row).or(written.flag.take());
        }
        self
    }

    /// Marks the gold standard among the rows that were made of `rows`.
    pub(crate) fn gold_where<R>(mut self, rows: &[R], is_gold: impl Fn(&R) -> bool) -> Self {
        for (written, row) in self.rows.iter_mut().zip(rows) {
            written.gold = is_gold(row);
        }
        self
    }

    /// Sets the gold standard that errors refer to.
    pub fn against(mut self, gold: impl Into<String>) -> Self {
        self.gold = gold.into();
        self
    }

    /// Sets the goal of a user.
    ///
    /// # Panics
    /// If a key does not exist in the table: a programming error.
    pub(crate) fn seeking(mut self, goal: Goal) -> Self {
        let timed = goal.every.map(|(_, key)| key);
        let axes = [goal.cost, goal.error].into_iter().chain(goal.beside.iter().copied());
        let mut axes = axes.chain(timed);
        let mut factors = goal.each.iter().chain(&goal.over);
        let known = axes.all(|key| self.axis(key).is_some()) && factors.all(|key| self.factor(key).is_some());
        assert!(known, "keys of {}: {goal:?}", self.key);
        self.goal = Some(goal);
        self
    }

    /// Adds a row. Values that are not finite count as not measured, and flag the row.
    ///
    /// # Panics
    /// If the numbers of choices and factors, or of values and axes, differ: a programming error.
    fn push(&mut self, choices: Vec<String>, values: Vec<Option<f64>>, flag: Option<String>) {
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

    /// Returns the index of an axis among the values of a row.
    fn axis(&self, key: &str) -> Option<usize> {
        self.axes.iter().position(|axis| axis.key == key)
    }

    /// Returns the index of a factor among the choices of a row.
    fn factor(&self, key: &str) -> Option<usize> {
        self.factors.iter().position(|factor| factor.key == key)
    }

    /// Returns the value of a row on an axis; `None` if the axis does not exist or was not measured.
    pub fn value(&self, row: &Row, key: &str) -> Option<f64> {
        row.values[self.axis(key)?]
    }
}
