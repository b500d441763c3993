//! Lengths of the links of a needle of angular springs: how near is the shape to that of the finest, and what does it cost?

use super::columns::{TIMES, UNSETTLED, factor, largest, points, times, unsettled};
use super::course::{self, Course, Step};
use super::{Findings, InsertionOptions, InsertionStudyError, Progress};
use crate::mechanics::needle::{Shaft, Stiffness};
use crate::study::block;
use crate::study::tradeoff::{Axis, Beat, Factor, Goal, SHIFT_MM, Table};

/// Lengths of links, mm, the finest last: the others are compared with it.
const LINKS_MM: [f64; 5] = [20.0, 10.0, 5.0, 2.5, 1.25];

const FACTORS: [Factor; 1] = [factor("link_mm", "link, mm")];

const AXES: [Axis; 4] = [
    Axis::linear("links", "links", "links"),
    Axis::linear(
        "deflection_mm",
        "aside mm",
        "tip beside the straight path at full depth, mm",
    ),
    Axis::log("tip_mm", "dtip, mm", "largest difference of the tip on the way in, mm"),
    Axis::log(
        "force_n",
        "dF base, N",
        "largest difference of the force at the base on the way in, N",
    ),
];

pub(super) fn run(options: &InsertionOptions, progress: Progress<'_>) -> Result<Findings, InsertionStudyError> {
    let finest = LINKS_MM[LINKS_MM.len() - 1];
    let mut table = Table::new(
        "links",
        format!("Links of the needle: differences from links of {finest} mm"),
        &FACTORS,
        &[&AXES[..], &TIMES, &[UNSETTLED]].concat(),
    )
    .against(format!("links of {finest} mm"))
    .seeking(
        Goal::new("median_ms", "tip_mm", SHIFT_MM)
            .choosing("links of the needle")
            .in_every(Beat::Step, "remesh_median_ms")
            .beside(&["p99_ms", "force_n"]),
    );
    let course = Course {
        depth_mm: options.depth_mm,
        probe: false,
    };
    let mut models = Vec::new();
    for link_mm in LINKS_MM {
        let needle = block::springs(Stiffness::default(), link_mm, block::BEVEL)?;
        models.push(course::model(course::tissue(options.nodes, needle)?)?);
    }
    let traces = course.drive(&mut models, options.passes, |share| {
        progress("links of the needle", share)
    })?;
    let gold = &traces[traces.len() - 1];
    let inward = course.moved();
    for (link_mm, steps) in LINKS_MM.into_iter().zip(&traces) {
        let most = |of: &dyn Fn(&Step, &Step) -> f64| {
            let pairs = gold.iter().zip(steps).take(inward);
            (link_mm != finest).then(|| largest(pairs.map(|(a, b)| of(a, b))))
        };
        let tip = steps[inward - 1].tip_mm;
        let aside = (tip.x - course::ENTRY[0]).hypot(tip.y - course::ENTRY[1]);
        let own = [
            Some((Shaft::default().length_mm / link_mm).round()),
            Some(aside),
            most(&|a, b| (a.tip_mm - b.tip_mm).norm()),
            most(&|a, b| (a.force_n - b.force_n).norm()),
        ];
        let values = [&own[..], &times(steps), &[unsettled(steps)]].concat();
        table.push(vec![link_mm.to_string()], values, None);
    }
    table.mark_gold("link_mm", &finest.to_string());
    let figure = points(
        "insertion-links",
        "Links of the needle: what accuracy costs",
        "links",
        ["median_ms", "tip_mm"],
        "link_mm",
    );
    Ok(Findings {
        tables: vec![table],
        figures: vec![figure],
        ..Findings::default()
    })
}
