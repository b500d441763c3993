//! Levels of remeshing, mesh sizes and probe candidates of an insertion.

use super::{
    Course, ENTRY_MM, InsertionOptions, Progress, Step, TIMES, UNSETTLED, largest, lines, mean_square, points, times,
    unsettled,
};
use crate::StudyError;
use crate::tradeoff::remesh::FROZEN;
use crate::tradeoff::{Axis, Deadline, FORCE_N, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use insonify::Error;
use insonify_base::memory;
use insonify_base::statistics::percentile;
use insonify_mechanics::block;
use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::needle::Stiffness;
use insonify_mechanics::tissue::remesh::{Level, Precision};
use insonify_mechanics::tissue::symmetric::Symmetric;

/// Levels compared; the first is the gold standard.
const LEVELS: [(Level, &str); 4] = [
    (Level::I, "I"),
    (Level::III, "III"),
    (Level::IV, "IV"),
    (Level::Exact, "exact condensed"),
];
/// Number of levels that use a dense inverse.
const DENSE: usize = 3;
/// Stride of the rings of probe candidates: every second one, as in Goksel et al. 2011.
const EVERY: usize = 2;
/// Number of points in a trace per level.
const POINTS: usize = 400;
/// Force difference allowed between level I and the exact condensed level, which solve the same equations: shapes are iterated until
/// nothing moves by more than 1e-5 mm, through stiffnesses of needle and tissue below 100 N/mm.
const SAME_N: f64 = 1e-3;

const FACTORS: [Factor; 2] = [Factor::new("level", "level"), Factor::new("probe", "probe")];

const DIFFERENCES: [Axis; 4] = [
    Axis::log(
        "force_before_n",
        "force before, N",
        "difference of the force at the base before the probe moves (root mean square), N",
    ),
    Axis::log(
        "force_after_n",
        "force after, N",
        "difference of the force at the base once the probe moves (root mean square), N",
    ),
    Axis::log(
        "tip_before_mm",
        "tip before, mm",
        "difference of the tip before the probe moves (root mean square), mm",
    ),
    Axis::log(
        "tip_after_mm",
        "tip after, mm",
        "difference of the tip once the probe moves (root mean square), mm",
    ),
];

const TRACE: [Axis; 6] = [
    Axis::linear("time_s", "s", "time, s"),
    Axis::linear("axial_n", "axial N", "force on the hand along the needle, N"),
    Axis::linear("across_n", "across N", "force on the hand across the needle, N"),
    Axis::linear(
        "tip_aside_mm",
        "tip mm",
        "tip beside the straight path, away from the probe, mm",
    ),
    Axis::log(
        "force_difference_n",
        "force off, N",
        "difference of the force at the base from level I, N",
    ),
    Axis::log("step_ms", "ms", "time of a step (longest of some), ms"),
];

/// Extent and quartiles of the time of steps that remesh, beside the median and the longest of [`TIMES`] (Goksel et al. 2011, figure 15).
const QUARTILES: [Axis; 3] = [
    Axis::log(
        "remesh_min_ms",
        "remesh min",
        "time of a step that remeshes (shortest), ms",
    ),
    Axis::log(
        "remesh_q1_ms",
        "remesh q1",
        "time of a step that remeshes (lower quartile), ms",
    ),
    Axis::log(
        "remesh_q3_ms",
        "remesh q3",
        "time of a step that remeshes (upper quartile), ms",
    ),
];

const SPREAD: [Axis; 2] = [
    Axis::linear("percent", "%", "steps that remesh in no more time, %"),
    Axis::log("remesh_ms", "remesh ms", "time of a step that remeshes, ms"),
];

/// Per cent of the steps that remesh whose time is read off: the shortest, the quartiles, the longest.
const PERCENT: [f64; 5] = [0.0, 25.0, 50.0, 75.0, 100.0];

/// Returns the time that each of [`PERCENT`] of the steps that remesh do not exceed, ms; `None` if there are none.
fn quartiles(steps: &[Step]) -> [Option<f64>; 5] {
    let mut ms: Vec<f64> = steps.iter().filter(|step| step.remeshed).map(|step| step.ms).collect();
    ms.sort_by(f64::total_cmp);
    PERCENT.map(|percent| percentile(&ms, percent / 100.0))
}

pub(super) fn run_levels(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    check_memory(options.nodes, memory::available())?;
    let mut table = Table::new(
        "levels",
        "Levels of remeshing along one insertion: differences from level I, times of steps",
        &FACTORS,
        &[&DIFFERENCES[..], &TIMES, &QUARTILES, &[UNSETTLED]].concat(),
    )
    .against("level I in f64, which keeps the whole inverse")
    .seeking(
        Goal::new("remesh_median_ms", "tip_after_mm", SHIFT_MM)
            .over(&["probe"])
            .choosing("level of remeshing along an insertion")
            .baseline("level", "IV", FROZEN)
            .in_every(Deadline::Step, "remesh_median_ms")
            .beside(&["median_ms", "max_ms", "force_after_n"]),
    );
    let mut spread = Table::trace("levels-remesh", "Time of steps that remesh", &FACTORS, &SPREAD);
    let mut trace = Table::trace("levels-along", "Along the insertion", &FACTORS, &TRACE);
    for (half, probe) in [true, false].into_iter().enumerate() {
        let mut told = |text: &str, share: f64| progress(text, 0.5 * (half as f64 + share));
        let course = Course {
            depth_mm: options.depth_mm,
            probe,
        };
        let mut models = Vec::new();
        for (at, (level, name)) in LEVELS.into_iter().enumerate() {
            told(&format!("level {name}: inverse"), 0.6 * at as f64 / LEVELS.len() as f64);
            models.push(model(options.nodes, level, probe)?);
        }
        if probe {
            study.about.extend(about(options, &models));
        }
        let traces = course.drive(&mut models, options.passes, &mut |share| {
            told("levels along the insertion", 0.6 + 0.4 * share);
        })?;
        for ((_, name), steps) in LEVELS.into_iter().zip(&traces) {
            let choices = vec![name.to_owned(), if probe { "with" } else { "without" }.to_owned()];
            let differences = differences(&course, &traces[0], steps);
            let force = largest(traces[0].iter().zip(steps).map(|(a, b)| (a.force_n - b.force_n).norm()));
            let same = name != "exact condensed" || force <= SAME_N;
            let flag = (!same).then(|| format!("off level I by {force:.1e} N: at most {SAME_N:.0e} is expected"));
            let own = differences.map(|it| (name != "I").then_some(it));
            let of_remeshes = quartiles(steps);
            let [shortest, lower, _, upper, _] = of_remeshes;
            let quartiles = [shortest, lower, upper];
            let values = [&own[..], &times(steps), &quartiles, &[unsettled(steps)]].concat();
            table.push(choices.clone(), values, flag);
            for (percent, ms) in PERCENT.into_iter().zip(of_remeshes) {
                spread.push(choices.clone(), vec![Some(percent), ms], None);
            }
            add_trace(&mut trace, &choices, &course, &traces[0], steps);
        }
    }
    table.mark_gold("level", LEVELS[0].1);
    study.tables.extend([table, trace, spread]);
    study.figures.extend(figures());
    Ok(())
}

fn about(options: &InsertionOptions, models: &[Finite]) -> Vec<(&'static str, String)> {
    let mesh = models[0].mesh();
    let candidates = super::probe(mesh, EVERY).candidates.len();
    vec![
        ("nodes", mesh.nodes().len().to_string()),
        ("elements", mesh.elements().len().to_string()),
        ("probe_candidates", candidates.to_string()),
        ("depth_mm", options.depth_mm.to_string()),
        ("simulated_step_ms", (1e3 * super::STEP_S).to_string()),
    ]
}

fn model(nodes: usize, level: Level, probe: bool) -> Result<Finite, Error> {
    let needle = block::springs(Stiffness::default(), block::LINK_MM, block::BEVEL)?;
    let tissue = super::tissue(nodes, needle)?;
    super::model(Setup {
        probe: probe.then(|| super::probe(&tissue.mesh, EVERY)),
        level,
        precision: Precision::Double,
        ..tissue
    })
}

/// Returns the values of [`DIFFERENCES`].
fn differences(course: &Course, first: &[Step], other: &[Step]) -> [f64; 4] {
    let force = |(a, b): (&Step, &Step)| (a.force_n - b.force_n).norm();
    let tip = |(a, b): (&Step, &Step)| (a.tip_mm - b.tip_mm).norm();
    let pairs = || first.iter().zip(other);
    let moved = course.moved();
    [
        mean_square(pairs().take(moved).map(force)),
        mean_square(pairs().skip(moved).map(force)),
        mean_square(pairs().take(moved).map(tip)),
        mean_square(pairs().skip(moved).map(tip)),
    ]
}

fn add_trace(table: &mut Table, choices: &[String], course: &Course, first: &[Step], steps: &[Step]) {
    let every = course.steps().div_ceil(POINTS);
    for (at, (these, gold)) in steps.chunks(every).zip(first.chunks(every)).enumerate() {
        let Some(last) = these.last() else { continue };
        let difference = largest(these.iter().zip(gold).map(|(a, b)| (a.force_n - b.force_n).norm()));
        table.push(
            choices.to_vec(),
            vec![
                Some(course.time_s(at * every + these.len() - 1)),
                Some(last.force_n.z),
                Some(last.force_n.y),
                Some(last.tip_mm.y - ENTRY_MM[1]),
                (choices[0] != "I").then_some(difference),
                Some(largest(these.iter().map(|step| step.ms))),
            ],
            None,
        );
    }
}

fn figures() -> Vec<Figure> {
    let with = || vec![("probe", "with".to_owned())];
    let along = |file: &str, title: &str, y: &'static str| Figure {
        only: with(),
        ..lines(file, title, "levels-along", ["time_s", y], "level")
    };
    vec![
        along(
            "insertion-force-difference",
            "Force at the needle's base: how far from level I?",
            "force_difference_n",
        ),
        along(
            "insertion-tip",
            "The needle's tip, the probe moved towards it midway",
            "tip_aside_mm",
        ),
        along("insertion-force", "Force on the hand along the needle", "axial_n"),
        Figure {
            only: vec![("level", "exact condensed".to_owned())],
            ..lines(
                "insertion-step-time",
                "Time of a step with and without the probe, exact condensed",
                "levels-along",
                ["time_s", "step_ms"],
                "probe",
            )
        },
        Figure {
            only: with(),
            marked: true,
            ..lines(
                "insertion-remesh-quartiles",
                "Time of a step that remeshes, with the probe: shortest, quartiles, longest",
                "levels-remesh",
                ["percent", "remesh_ms"],
                "level",
            )
        },
        along(
            "insertion-step-time-levels",
            "Time of a step at each level, with the probe",
            "step_ms",
        ),
    ]
}

/// Compares the peak memory of the dense inverses, including one more during computation, with the available memory.
pub(super) fn check_memory(nodes: usize, available: Option<usize>) -> Result<(), Error> {
    let floor = (nodes as f64).powf(2.0 / 3.0) as usize / 2;
    let size = 3 * nodes.saturating_sub(floor);
    let needed = (DENSE + 1).saturating_mul(Symmetric::<f64>::bytes_of(size));
    match available {
        Some(available) if needed > available => Err(StudyError::Memory {
            what: format!("the block of {nodes} nodes at levels I, III and IV"),
            needed,
            available,
        }
        .into()),
        _ => Ok(()),
    }
}

/// Factors on the requested number of nodes; the last and finest is the gold standard.
const SHARES: [f64; 4] = [0.25, 0.5, 1.0, 2.0];

const MESH_FACTORS: [Factor; 1] = [Factor::new("nodes", "nodes")];

const MESH_AXES: [Axis; 4] = [
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

pub(super) fn run_meshes(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let course = Course {
        depth_mm: options.depth_mm,
        probe: false,
    };
    let mut models = Vec::new();
    for (at, share) in SHARES.into_iter().enumerate() {
        progress("nodes of the mesh", 0.3 * at as f64 / SHARES.len() as f64);
        let needle = block::springs(Stiffness::default(), block::LINK_MM, block::BEVEL)?;
        let nodes = (share * options.nodes as f64).round() as usize;
        models.push(super::model(super::tissue(nodes, needle)?)?);
    }
    let traces = course.drive(&mut models, options.passes, &mut |share| {
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
        &MESH_FACTORS,
        &[&MESH_AXES[..], &TIMES, &[UNSETTLED]].concat(),
    )
    .against(format!("the same block in {finest} nodes"))
    .seeking(
        Goal::new("remesh_median_ms", "force_rms_n", FORCE_N)
            .choosing("mesh of the tissue")
            .in_every(Deadline::Step, "remesh_median_ms")
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
    study.tables.push(table);
    study.figures.push(figure);
    Ok(())
}

/// Strides of the candidate rings; the first retains all of them.
const THINNED: [usize; 5] = [1, 2, 3, 4, 6];

const THINNING_FACTORS: [Factor; 1] = [Factor::new("every", "ring stride")];

const THINNING_AXES: [Axis; 4] = [
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

pub(super) fn run_thinning(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let mut table = Table::new(
        "thinning",
        "Every n-th ring of the probe's candidates: differences from all of them",
        &THINNING_FACTORS,
        &[&THINNING_AXES[..], &TIMES, &[UNSETTLED]].concat(),
    )
    .against("every candidate kept")
    .seeking(
        Goal::new("remesh_median_ms", "tip_mm", SHIFT_MM)
            .choosing("candidates of the probe")
            .in_every(Deadline::Step, "remesh_median_ms")
            .beside(&["median_ms", "p99_ms", "candidates", "probe_percent", "force_n"]),
    );
    let course = Course {
        depth_mm: options.depth_mm,
        probe: true,
    };
    let (mut models, mut counts) = (Vec::new(), Vec::new());
    for every in THINNED {
        let needle = block::springs(Stiffness::default(), block::LINK_MM, block::BEVEL)?;
        let tissue = super::tissue(options.nodes, needle)?;
        let probe = super::probe(&tissue.mesh, every);
        counts.push(probe.candidates.len());
        models.push(super::model(Setup {
            probe: Some(probe),
            ..tissue
        })?);
    }
    let traces = course.drive(&mut models, options.passes, &mut |share| {
        progress("candidates of the probe", share)
    })?;
    let all = &traces[0];
    let strongest = largest(all.iter().map(|step| step.probe_n.norm()));
    for ((every, count), steps) in THINNED.into_iter().zip(counts).zip(&traces) {
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
    table.mark_gold("every", &THINNED[0].to_string());
    let figure = points(
        "insertion-thinning",
        "Thinning the probe's candidates",
        "thinning",
        ["remesh_median_ms", "probe_percent"],
        "every",
    );
    study.tables.push(table);
    study.figures.push(figure);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ranks as in the definition of percentiles: of 1 to 8 ms the quartiles are 2, 4 and 6 ms.
    #[test]
    fn quartiles_are_those_of_the_steps_that_remesh() {
        let step = |ms: u32| Step {
            ms: f64::from(ms),
            force_n: Default::default(),
            probe_n: Default::default(),
            tip_mm: Default::default(),
            remeshed: ms <= 8,
            converged: true,
        };
        let steps: Vec<Step> = [5, 100, 1, 8, 3, 6, 200, 2, 7, 4].map(step).to_vec();
        assert_eq!(quartiles(&steps), [1.0, 2.0, 4.0, 6.0, 8.0].map(Some));
        assert_eq!(quartiles(&steps[1..2]), [None; 5]);
    }
}
