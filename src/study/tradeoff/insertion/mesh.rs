//! Number of mesh nodes: error along an insertion against a fine mesh, and cost of a step.

use super::columns::{TIMES, UNSETTLED, factor, largest, mean_square, points, times, unsettled};
use super::course::{self, Course, Step};
use super::{Findings, InsertionOptions, InsertionStudyError, Progress};
use crate::mechanics::needle::Stiffness;
use crate::study::block;
use crate::study::tradeoff::{Axis, Beat, FORCE_N, Factor, Goal, Table};

/// Factors on the requested number of nodes; the last and finest is the gold standard.
const SHARES: [f64; 4] = [0.25, 0.5, 1.0, 2.0];

const FACTORS: [Factor; 1] = [factor("nodes", "nodes")];

const AXES: [Axis; 4] = [
    Axis::log("elements", "elements", "elements of the mesh"),
    Axis::log(
        "force_rms_n",
        "force off, N",
        "difference of the force at the base on the way in (root mean square), N",
    ),
    Axis::log(
        "force_n",
        "force off at most, N",
        "largest difference of the force at the base on the way in, N",
    ),
    Axis::log(
        "tip_mm",
        "tip off, mm",
        "largest difference of the tip on the way in, mm",
    ),
];

pub(super) fn run(options: &InsertionOptions, progress: Progress<'_>) -> Result<Findings, InsertionStudyError> {
    let course = Course {
        depth_mm: options.depth_mm,
        probe: false,
    };
    let mut models = Vec::new();
    for (at, share) in SHARES.into_iter().enumerate() {
        progress("nodes of the mesh", 0.3 * at as f64 / SHARES.len() as f64);
        let needle = block::springs(Stiffness::default(), block::LINK_MM, block::BEVEL)?;
        let nodes = (share * options.nodes as f64).round() as usize;
        models.push(course::model(course::tissue(nodes, needle)?)?);
    }
    let traces = course.drive(&mut models, options.passes, |share| {
        progress("nodes of the mesh", 0.3 + 0.7 * share);
    })?;
    let sizes: Vec<[usize; 2]> = models
        .iter()
        .map(|model| [model.mesh().nodes().len(), model.mesh().elements().len()])
        .collect();
    let (finest, gold) = (sizes[sizes.len() - 1][0], &traces[traces.len() - 1]);
    let mut table = Table::new(
        "mesh",
        "Nodes of the mesh along one insertion: differences from the finest mesh",
        &FACTORS,
        &[&AXES[..], &TIMES, &[UNSETTLED]].concat(),
    )
    .against(format!("the same block in {finest} nodes"))
    .seeking(
        Goal::new("remesh_median_ms", "force_rms_n", FORCE_N)
            .choosing("mesh of the tissue")
            .in_every(Beat::Step, "remesh_median_ms")
            .beside(&["median_ms", "p99_ms", "tip_mm", "elements"]),
    );
    let inward = course.moved();
    for (size, steps) in sizes.iter().zip(&traces) {
        let other = (size[0] != finest).then_some(());
        let pairs = || gold.iter().zip(steps).take(inward);
        let force = |(a, b): (&Step, &Step)| (a.force_n - b.force_n).norm();
        let own = [
            Some(size[1] as f64),
            other.map(|()| mean_square(pairs().map(force))),
            other.map(|()| largest(pairs().map(force))),
            other.map(|()| largest(pairs().map(|(a, b)| (a.tip_mm - b.tip_mm).norm()))),
        ];
        let values = [&own[..], &times(steps), &[unsettled(steps)]].concat();
        table.push(vec![size[0].to_string()], values, None);
    }
    table.mark_gold("nodes", &finest.to_string());
    let title = "Nodes of the mesh: what accuracy costs";
    let figure = points(
        "insertion-mesh",
        title,
        "mesh",
        ["remesh_median_ms", "force_rms_n"],
        "nodes",
    );
    Ok(Findings {
        tables: vec![table],
        figures: vec![figure],
        ..Findings::default()
    })
}
