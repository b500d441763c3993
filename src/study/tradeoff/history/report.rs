//! Table and figures of the study.

use super::{Contender, HistoryOptions, Lengths, MAX_UNEVEN, Measured};
use crate::tradeoff::{Axis, Choice, Column, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use insonify_base::machine::Machine;
use insonify_mechanics::tissue::viscoelastic::Rule;

/// A contender with its measurement.
struct HistoryRow {
    contender: Contender,
    measured: Measured,
    flag: Option<String>,
}

const CHOICES: [Choice<HistoryRow>; 3] = [
    Factor::new("rule", "rule").of(|row| row.contender.name.to_owned()),
    Factor::new("lengths", "steps are").of(|row| match row.contender.lengths {
        Lengths::Equal => "equal".to_owned(),
        Lengths::Unequal => "unequal".to_owned(),
    }),
    Factor::new("count", "steps").of(|row| row.contender.steps.to_string()),
];

const COLUMNS: [Column<HistoryRow>; 7] = [
    Axis::log("steps", "steps", "steps").of(|row| Some(row.contender.steps as f64)),
    Axis::log("total_ms", "ms", "time of all steps, ms").of(|row| Some(row.measured.seconds * 1e3)),
    Axis::log("slowest_ms", "slowest", "time of all steps (the slowest time over), ms")
        .of(|row| Some(row.measured.slowest_s * 1e3)),
    Axis::log("step_us", "us a step", "mean time of a step, us")
        .of(|row| Some(row.measured.seconds * 1e6 / row.contender.steps as f64)),
    Axis::log("memory_kb", "kB", "memory of the history, kB").of(|row| Some(row.measured.bytes as f64 * 1e-3)),
    Axis::log("error", "error", "error relative to the exact law").of(|row| Some(row.measured.error)),
    Axis::log("error_mm", "error mm", "error where tissue gives way by 10 mm, mm")
        .of(|row| Some(INDENTED_MM * row.measured.error)),
];

/// Indentation that converts a relative error to a length, mm.
const INDENTED_MM: f64 = 10.0;

/// Report under construction.
pub(super) struct HistoryReport {
    rows: Vec<HistoryRow>,
    about: Vec<(&'static str, String)>,
    notes: Vec<String>,
}

impl HistoryReport {
    pub(super) fn new(options: &HistoryOptions) -> Self {
        let steps: Vec<String> = options.steps.iter().map(usize::to_string).collect();
        let mut notes = Vec::new();
        if options.steps.iter().any(|steps| *steps > MAX_UNEVEN) {
            notes.push(format!(
                "more than {MAX_UNEVEN} unequal steps are left to the exponentials: a full history recomputes all weights at each step"
            ));
        }
        Self {
            rows: Vec::new(),
            about: vec![("order", options.order.to_string()), ("steps", steps.join(", "))],
            notes,
        }
    }

    /// Adds a row. The error of a sum of exponentials may exceed that of the trapezoid before it by no more than its
    /// tolerance.
    pub(super) fn push(&mut self, contender: Contender, measured: Measured) {
        let mut before = self.rows.iter().rev();
        let trapezoid = before.find(|row| row.contender.rule == Rule::Trapezoid);
        let flag = match contender.rule {
            Rule::Exponentials(span) => {
                // Unequal steps are longer by their variation, and their error is of second order.
                let limit = 2.0 * (trapezoid.map_or(f64::INFINITY, |row| row.measured.error) + span.tolerance);
                (measured.error > limit)
                    .then(|| format!("error above {limit:.1e}, twice that of the trapezoid and its tolerance"))
            }
            _ => None,
        };
        self.rows.push(HistoryRow {
            contender,
            measured,
            flag,
        });
    }

    pub(super) fn finish(mut self) -> Study {
        let equal = || {
            self.rows
                .iter()
                .rev()
                .filter(|row| row.contender.lengths == Lengths::Equal)
        };
        // The longest history shows the gain best: a full sum costs as the
        // square of the steps, exponentials do not.
        if let Some(full) = equal().find(|row| row.contender.rule == Rule::Trapezoid) {
            let steps = full.contender.steps;
            let fast = equal()
                .rev()
                .filter(|row| matches!(row.contender.rule, Rule::Exponentials(_)) && row.contender.steps == steps);
            self.notes.extend(fast.map(|fast| {
                format!(
                    "{}: {:.0} times as fast as the full trapezoid over {steps} equal steps, at an error of {:.1e}",
                    fast.contender.name,
                    full.measured.seconds / fast.measured.seconds,
                    fast.measured.error
                )
            }));
        }
        let goal = Goal::new("total_ms", "error_mm", SHIFT_MM)
            .each(&["count"])
            .over(&["lengths"])
            .choosing("memory of viscoelastic tissue")
            .beside(&["slowest_ms", "memory_kb"]);
        let table = Table::of("history", "Rules of fading memory", &CHOICES, &COLUMNS, &self.rows)
            .flagged(&self.rows, |row| row.flag.clone())
            .against("the closed form of the spring-pot")
            .seeking(goal);
        let figure = |file: &str, title: &str, x: &'static str, y: &'static str| Figure {
            marker: vec!["lengths"],
            ..Figure::new(file, title, "history", [x, y], "rule")
        };
        let equal = |figure: Figure| Figure {
            only: vec![("lengths", "equal".to_owned())],
            marker: Vec::new(),
            ..figure
        };
        Study {
            name: "history",
            title: super::ENTRY.about.title,
            about: self.about,
            machine: Machine::here(),
            tables: vec![table],
            figures: vec![
                equal(figure(
                    "history-error-time",
                    "Error against time, equal steps",
                    "total_ms",
                    "error_mm",
                )),
                equal(figure(
                    "history-error-memory",
                    "Error against memory, equal steps",
                    "memory_kb",
                    "error",
                )),
                figure(
                    "history-step",
                    "Time of a step against the length of the history",
                    "steps",
                    "step_us",
                ),
            ],
            notes: self.notes,
        }
    }
}
