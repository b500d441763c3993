//! Number of nodes of the mesh.

use super::{
    Course, InsertionOptions, Progress, Step, StepTimes, Timed, largest, mean_square, points, times, unsettled,
};
use crate::tradeoff::{Axis, Choice, Column, Deadline, FORCE_N, Factor, Goal, Study, Table};
use insonify::Error;
use insonify_mechanics::block;
use insonify_mechanics::needle::Stiffness;

/// Factors on the requested number of nodes; the last and finest is the gold standard.
const SHARES: [f64; 4] = [0.25, 0.5, 1.0, 2.0];

/// An insertion into a mesh.
pub(crate) struct MeshRow {
    pub nodes: usize,
    elements: usize,
    pub times: StepTimes,
    /// Differences from the finest mesh on the way in, N and mm; `None` for the finest.
    force_rms_n: Option<f64>,
    force_n: Option<f64>,
    pub tip_mm: Option<f64>,
}

impl Timed for MeshRow {
    fn times(&self) -> &StepTimes {
        &self.times
    }
}

const CHOICES: [Choice<MeshRow>; 1] = [Factor::new("nodes", "nodes").of(|row| row.nodes.to_string())];

const COLUMNS: [Column<MeshRow>; 4] = [
    Axis::log("elements", "elements", "elements of the mesh").of(|row| Some(row.elements as f64)),
    Axis::log(
        "force_rms_n",
        "force off, N",
        "difference of the force at the base on the way in (root mean square), N",
    )
    .of(|row| row.force_rms_n),
    Axis::log(
        "force_n",
        "force off at most, N",
        "largest difference of the force at the base on the way in, N",
    )
    .of(|row| row.force_n),
    Axis::log(
        "tip_mm",
        "tip off, mm",
        "largest difference of the tip on the way in, mm",
    )
    .of(|row| row.tip_mm),
];

/// Measures one insertion into several meshes.
pub(crate) fn measure(options: &InsertionOptions, progress: Progress<'_>) -> Result<Vec<MeshRow>, Error> {
    let course = Course {
        depth_mm: options.depth_mm,
        probe: false,
    };
    let mut models = Vec::new();
    for (index, share) in SHARES.into_iter().enumerate() {
        progress("nodes of the mesh", 0.3 * index as f64 / SHARES.len() as f64);
        let needle = block::springs(Stiffness::default(), block::LINK_MM, block::BEVEL)?;
        let nodes = (share * options.nodes as f64).round() as usize;
        models.push(super::model(super::tissue(nodes, needle)?)?);
    }
    let traces = course.drive(&mut models, options.passes, &mut |share| {
        progress("nodes of the mesh", 0.3 + 0.7 * share);
    })?;
    let gold = &traces[traces.len() - 1];
    let rows = models.iter().zip(&traces).enumerate().map(|(index, (model, steps))| {
        let is_coarser = (index + 1 < models.len()).then_some(());
        let pairs = || gold.iter().zip(steps).take(course.moved());
        let force = |(a, b): (&Step, &Step)| (a.force_n - b.force_n).norm();
        MeshRow {
            nodes: model.mesh().nodes().len(),
            elements: model.mesh().elements().len(),
            times: StepTimes::of(steps),
            force_rms_n: is_coarser.map(|()| mean_square(pairs().map(force))),
            force_n: is_coarser.map(|()| largest(pairs().map(force))),
            tip_mm: is_coarser.map(|()| largest(pairs().map(|(a, b)| (a.tip_mm - b.tip_mm).norm()))),
        }
    });
    Ok(rows.collect())
}

pub(super) fn run(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let rows = measure(options, progress)?;
    let finest = rows.last().map_or(0, |row| row.nodes);
    let goal = Goal::new("remesh_median_ms", "force_rms_n", FORCE_N)
        .choosing("mesh of the tissue")
        .in_every(Deadline::Step, "remesh_median_ms")
        .beside(&["median_ms", "p99_ms", "tip_mm", "elements"]);
    let title = "Nodes of the mesh along one insertion: differences from the finest mesh";
    let columns: Vec<_> = COLUMNS.into_iter().chain(times()).chain([unsettled()]).collect();
    let table = Table::of("mesh", title, &CHOICES, &columns, &rows)
        .gold_where(&rows, |row| row.nodes == finest)
        .against(format!("the same block in {finest} nodes"))
        .seeking(goal);
    study.tables.push(table);
    study.figures.push(points(
        "insertion-mesh",
        "Nodes of the mesh: what accuracy costs",
        "mesh",
        ["remesh_median_ms", "force_rms_n"],
        "nodes",
    ));
    Ok(())
}
