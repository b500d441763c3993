//! Candidates of the probe.

use super::{Course, InsertionOptions, Progress, Step, StepTimes, Timed, largest, points, times, unsettled};
use crate::tradeoff::{Axis, Choice, Column, Deadline, Factor, Goal, SHIFT_MM, Study, Table};
use insonify::Error;
use insonify_mechanics::block;
use insonify_mechanics::insertion::finite::Setup;
use insonify_mechanics::needle::Stiffness;

/// Strides of the candidate rings; the first retains all of them.
const THINNED: [usize; 5] = [1, 2, 3, 4, 6];

/// An insertion with every n-th ring of candidates.
pub(crate) struct ThinningRow {
    pub stride: usize,
    candidates: usize,
    pub times: StepTimes,
    /// Largest differences from all candidates, %, N and mm; `None` for all of them.
    probe_percent: Option<f64>,
    force_n: Option<f64>,
    pub tip_mm: Option<f64>,
}

impl Timed for ThinningRow {
    fn times(&self) -> &StepTimes {
        &self.times
    }
}

const CHOICES: [Choice<ThinningRow>; 1] = [Factor::new("every", "ring stride").of(|row| row.stride.to_string())];

const COLUMNS: [Column<ThinningRow>; 4] = [
    Axis::linear("candidates", "candidates", "candidates of the probe").of(|row| Some(row.candidates as f64)),
    Axis::log(
        "probe_percent",
        "probe off, %",
        "largest difference of the force on the probe, % of the largest",
    )
    .of(|row| row.probe_percent),
    Axis::log(
        "force_n",
        "force off, N",
        "largest difference of the force at the base, N",
    )
    .of(|row| row.force_n),
    Axis::log("tip_mm", "tip off, mm", "largest difference of the tip, mm").of(|row| row.tip_mm),
];

/// Measures one insertion with every n-th ring of candidates.
pub(crate) fn measure(options: &InsertionOptions, progress: Progress<'_>) -> Result<Vec<ThinningRow>, Error> {
    let course = Course {
        depth_mm: options.depth_mm,
        probe: true,
    };
    let (mut models, mut counts) = (Vec::new(), Vec::new());
    for stride in THINNED {
        let needle = block::springs(Stiffness::default(), block::LINK_MM, block::BEVEL)?;
        let tissue = super::tissue(options.nodes, needle)?;
        let probe = super::probe(&tissue.mesh, stride);
        counts.push(probe.candidates.len());
        models.push(super::model(Setup {
            probe: Some(probe),
            ..tissue
        })?);
    }
    let traces = course.drive(&mut models, options.passes, &mut |share| {
        progress("candidates of the probe", share)
    })?;
    let reference = &traces[0];
    // Relative to the strongest force of the insertion: step by step the ratio
    // would explode where the probe hardly presses.
    let strongest = largest(reference.iter().map(|step| step.probe_n.norm()));
    let rows = THINNED.into_iter().zip(counts).zip(&traces);
    let rows = rows.map(|((stride, candidates), steps)| {
        let largest_change = |change: &dyn Fn(&Step, &Step) -> f64| {
            let difference = largest(reference.iter().zip(steps).map(|(a, b)| change(a, b)));
            (stride > 1).then_some(difference)
        };
        ThinningRow {
            stride,
            candidates,
            times: StepTimes::of(steps),
            probe_percent: largest_change(&|a, b| 100.0 * (a.probe_n - b.probe_n).norm() / strongest),
            force_n: largest_change(&|a, b| (a.force_n - b.force_n).norm()),
            tip_mm: largest_change(&|a, b| (a.tip_mm - b.tip_mm).norm()),
        }
    });
    Ok(rows.collect())
}

pub(super) fn run(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let rows = measure(options, progress)?;
    let goal = Goal::new("remesh_median_ms", "tip_mm", SHIFT_MM)
        .choosing("candidates of the probe")
        .in_every(Deadline::Step, "remesh_median_ms")
        .beside(&["median_ms", "p99_ms", "candidates", "probe_percent", "force_n"]);
    let title = "Every n-th ring of the probe's candidates: differences from all of them";
    let columns: Vec<_> = COLUMNS.into_iter().chain(times()).chain([unsettled()]).collect();
    let table = Table::of("thinning", title, &CHOICES, &columns, &rows)
        .gold_where(&rows, |row| row.stride == THINNED[0])
        .against("every candidate kept")
        .seeking(goal);
    study.tables.push(table);
    study.figures.push(points(
        "insertion-thinning",
        "Thinning the probe's candidates",
        "thinning",
        ["remesh_median_ms", "probe_percent"],
        "every",
    ));
    Ok(())
}
