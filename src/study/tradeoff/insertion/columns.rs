//! Columns common to the insertion tables.

use super::course::Step;
use crate::base::report::statistics::percentile;
use crate::study::tradeoff::{Axis, Factor, Figure};

/// Axes for the step times of an insertion.
pub const TIMES: [Axis; 7] = [
    Axis::log("median_ms", "ms", "time of a step (median), ms"),
    Axis::log("p95_ms", "p95 ms", "time of a step (95th percentile), ms"),
    Axis::log("p99_ms", "p99 ms", "time of a step (99th percentile), ms"),
    Axis::log("max_ms", "max ms", "time of a step (longest), ms"),
    Axis::log(
        "remesh_median_ms",
        "remesh ms",
        "time of a step that remeshes (median), ms",
    ),
    Axis::log(
        "remesh_max_ms",
        "remesh max",
        "time of a step that remeshes (longest), ms",
    ),
    Axis::linear("remeshing", "remeshing", "steps that remesh"),
];

/// Axis for the number of steps whose iterations did not converge.
pub const UNSETTLED: Axis = Axis::linear("unsettled", "unsettled", "steps that did not converge");

/// Returns the values of [`TIMES`].
pub fn times(steps: &[Step]) -> [Option<f64>; 7] {
    let sorted = |keep: &dyn Fn(&Step) -> bool| {
        let mut ms: Vec<f64> = steps.iter().filter(|step| keep(step)).map(|step| step.ms).collect();
        ms.sort_by(f64::total_cmp);
        ms
    };
    let (all, remeshing) = (sorted(&|_| true), sorted(&|step| step.remeshed));
    [
        percentile(&all, 0.5),
        percentile(&all, 0.95),
        percentile(&all, 0.99),
        all.last().copied(),
        percentile(&remeshing, 0.5),
        remeshing.last().copied(),
        Some(remeshing.len() as f64),
    ]
}

/// Returns the value of [`UNSETTLED`].
pub fn unsettled(steps: &[Step]) -> Option<f64> {
    Some(steps.iter().filter(|step| !step.converged).count() as f64)
}

/// Returns the largest magnitude; NaN if any value is NaN.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    crate::study::stability::record::largest(values)
}

/// Returns the root mean square.
pub fn mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), it| (sum + it * it, count + 1.0));
    (sum / count).sqrt()
}

/// Creates a factor.
pub const fn factor(key: &'static str, label: &'static str) -> Factor {
    Factor { key, label }
}

/// Creates a line plot of a trace, with a colour for each choice of a factor.
pub fn lines(file: &str, title: &str, table: &'static str, [x, y]: [&'static str; 2], colour: &'static str) -> Figure {
    Figure {
        marked: false,
        ..Figure::new(file, title, table, [x, y], colour)
    }
}

/// Creates a scatter plot with a colour for each choice of a factor, the best points marked.
pub fn points(file: &str, title: &str, table: &'static str, axes: [&'static str; 2], colour: &'static str) -> Figure {
    Figure {
        joined: false,
        marked: true,
        ..lines(file, title, table, axes, colour)
    }
}
