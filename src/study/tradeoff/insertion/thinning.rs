//! Every n-th probe candidate (Goksel et al. 2011, end of section VI-C): looser coupling for less time.

use super::columns::{TIMES, UNSETTLED, factor, largest, points, times, unsettled};
use super::course::{self, Course, Step};
use super::{Findings, InsertionOptions, InsertionStudyError, Progress};
use crate::mechanics::insertion::finite::Setup;
use crate::mechanics::needle::Stiffness;
use crate::study::block;
use crate::study::tradeoff::{Axis, Beat, Factor, Goal, SHIFT_MM, Table};

/// Strides of the candidate rings; the first retains all of them.
const EVERY: [usize; 5] = [1, 2, 3, 4, 6];

const FACTORS: [Factor; 1] = [factor("every", "ring stride")];

const AXES: [Axis; 4] = [
    Axis::linear("candidates", "candidates", "candidates of the probe"),
    Axis::log(
        "probe_percent",
        "probe off, %",
        "largest difference of the force on the probe, % of the largest",
    ),
    Axis::log(
        "force_n",
        "force off, N",
        "largest difference of the force at the base, N",
    ),
    Axis::log("tip_mm", "tip off, mm", "largest difference of the tip, mm"),
];

pub(super) fn run(options: &InsertionOptions, progress: Progress<'_>) -> Result<Findings, InsertionStudyError> {
    let mut table = Table::new(
        "thinning",
        "Every n-th ring of the probe's candidates: differences from all of them",
        &FACTORS,
        &[&AXES[..], &TIMES, &[UNSETTLED]].concat(),
    )
    .against("every candidate kept")
    .seeking(
        Goal::new("remesh_median_ms", "tip_mm", SHIFT_MM)
            .choosing("candidates of the probe")
            .in_every(Beat::Step, "remesh_median_ms")
            .beside(&["median_ms", "p99_ms", "candidates", "probe_percent", "force_n"]),
    );
    let course = Course {
        depth_mm: options.depth_mm,
        probe: true,
    };
    let (mut models, mut counts) = (Vec::new(), Vec::new());
    for every in EVERY {
        let needle = block::springs(Stiffness::default(), block::LINK_MM, block::BEVEL)?;
        let tissue = course::tissue(options.nodes, needle)?;
        let probe = course::probe(&tissue.mesh, every);
        counts.push(probe.candidates.len());
        models.push(course::model(Setup {
            probe: Some(probe),
            ..tissue
        })?);
    }
    let traces = course.drive(&mut models, options.passes, |share| {
        progress("candidates of the probe", share)
    })?;
    let all = &traces[0];
    let strongest = largest(all.iter().map(|step| step.probe_n.norm()));
    for ((every, count), steps) in EVERY.into_iter().zip(counts).zip(&traces) {
        let most = |of: &dyn Fn(&Step, &Step) -> f64| {
            let difference = largest(all.iter().zip(steps).map(|(a, b)| of(a, b)));
            (every > 1).then_some(difference)
        };
        let own = [
            Some(count as f64),
            most(&|a, b| 100.0 * (a.probe_n - b.probe_n).norm() / strongest),
            most(&|a, b| (a.force_n - b.force_n).norm()),
            most(&|a, b| (a.tip_mm - b.tip_mm).norm()),
        ];
        let values = [&own[..], &times(steps), &[unsettled(steps)]].concat();
        table.push(vec![every.to_string()], values, None);
    }
    table.mark_gold("every", &EVERY[0].to_string());
    let figure = points(
        "insertion-thinning",
        "Thinning the probe's candidates",
        "thinning",
        ["remesh_median_ms", "probe_percent"],
        "every",
    );
    Ok(Findings {
        tables: vec![table],
        figures: vec![figure],
        ..Findings::default()
    })
}
