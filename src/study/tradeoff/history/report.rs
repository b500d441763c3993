//! Table and figures of the study.

use super::{Contender, HistoryOptions, Lengths, MAX_UNEVEN, Measured};
use crate::tradeoff::{Axis, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use insonify_base::machine::Machine;
use insonify_mechanics::tissue::viscoelastic::Rule;

const FACTORS: [Factor; 3] = [
    Factor::new("rule", "rule"),
    Factor::new("lengths", "steps are"),
    Factor::new("count", "steps"),
];

const AXES: [Axis; 7] = [
    Axis::log("steps", "steps", "steps"),
    Axis::log("total_ms", "ms", "time of all steps, ms"),
    Axis::log("slowest_ms", "slowest", "time of all steps (the slowest time over), ms"),
    Axis::log("step_us", "us a step", "mean time of a step, us"),
    Axis::log("memory_kb", "kB", "memory of the history, kB"),
    Axis::log("error", "error", "error relative to the exact law"),
    Axis::log("error_mm", "error mm", "error where tissue gives way by 10 mm, mm"),
];

/// Indentation that converts a relative error to a length, mm.
const INDENTED_MM: f64 = 10.0;

/// Report under construction.
pub(super) struct Report {
    table: Table,
    about: Vec<(&'static str, String)>,
    notes: Vec<String>,
    /// Number of steps and measurement of the trapezoid's longest equal history, and the same of the exponentials.
    full: Option<(usize, Measured)>,
    fast: Vec<(&'static str, usize, Measured)>,
    /// Error of the last trapezoidal rule.
    trapezoid: f64,
}

impl Report {
    pub(super) fn new(options: &HistoryOptions) -> Report {
        let steps: Vec<String> = options.steps.iter().map(usize::to_string).collect();
        let mut notes = Vec::new();
        if options.steps.iter().any(|steps| *steps > MAX_UNEVEN) {
            notes.push(format!(
                "more than {MAX_UNEVEN} unequal steps are left to the exponentials: a full history recomputes all weights at each step"
            ));
        }
        Report {
            table: Table::new("history", "Rules of fading memory", &FACTORS, &AXES)
                .against("the closed form of the spring-pot")
                .seeking(
                    Goal::new("total_ms", "error_mm", SHIFT_MM)
                        .each(&["count"])
                        .over(&["lengths"])
                        .choosing("memory of viscoelastic tissue")
                        .beside(&["slowest_ms", "memory_kb"]),
                ),
            about: vec![("order", options.order.to_string()), ("steps", steps.join(", "))],
            notes,
            full: None,
            fast: Vec::new(),
            trapezoid: f64::INFINITY,
        }
    }

    /// Adds a row. The error of a sum of exponentials may exceed that of the trapezoid in as many steps by no more than its tolerance.
    pub(super) fn push(&mut self, contender: &Contender, measured: &Measured) {
        let flag = match contender.rule {
            Rule::Exponentials(span) => {
                // Unequal steps are longer by their variation, and their error is of second order.
                let most = 2.0 * (self.trapezoid + span.tolerance);
                (measured.error > most)
                    .then(|| format!("error above {most:.1e}, twice that of the trapezoid and its tolerance"))
            }
            _ => None,
        };
        if contender.rule == Rule::Trapezoid {
            self.trapezoid = measured.error;
        }
        if contender.lengths == Lengths::Equal {
            match contender.rule {
                Rule::Trapezoid => self.full = Some((contender.steps, *measured)),
                Rule::Exponentials(_) => self.fast.push((contender.name, contender.steps, *measured)),
                _ => {}
            }
        }
        let steps = contender.steps as f64;
        let lengths = match contender.lengths {
            Lengths::Equal => "equal",
            Lengths::Unequal => "unequal",
        };
        self.table.push(
            vec![
                contender.name.to_owned(),
                lengths.to_owned(),
                contender.steps.to_string(),
            ],
            vec![
                Some(steps),
                Some(measured.seconds * 1e3),
                Some(measured.slowest_s * 1e3),
                Some(measured.seconds * 1e6 / steps),
                Some(measured.bytes as f64 * 1e-3),
                Some(measured.error),
                Some(INDENTED_MM * measured.error),
            ],
            flag,
        );
    }

    pub(super) fn finish(mut self) -> Study {
        if let Some((steps, full)) = self.full {
            for (name, count, fast) in &self.fast {
                if *count == steps {
                    self.notes.push(format!(
                        "{name}: {:.0} times as fast as the full trapezoid over {steps} equal steps, at an error of {:.1e}",
                        full.seconds / fast.seconds,
                        fast.error
                    ));
                }
            }
        }
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
            title: super::ENTRY.title,
            about: self.about,
            machine: Machine::here(),
            tables: vec![self.table],
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
