//! Levels of remeshing along one insertion.

use super::{
    Course, ENTRY_MM, InsertionOptions, Progress, Step, StepTimes, Timed, largest, lines, mean_square, times, unsettled,
};
use crate::StudyError;
use crate::tradeoff::remesh::FROZEN;
use crate::tradeoff::{Axis, Choice, Column, Deadline, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use insonify::Error;
use insonify_base::memory;
use insonify_base::statistics::percentile;
use insonify_mechanics::block;
use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::needle::Stiffness;
use insonify_mechanics::tissue::remesh::{Level, Precision};
use insonify_mechanics::tissue::symmetric::Symmetric;

/// Levels compared; the first is the gold standard.
const LEVELS: [Level; 4] = [Level::I, Level::III, Level::IV, Level::Exact];
/// Number of levels that use a dense inverse.
const DENSE: usize = 3;
/// Stride of the rings of probe candidates: every second one, as in Goksel et al. 2011.
const EVERY: usize = 2;
/// Number of points in a trace per level.
const POINTS: usize = 400;
/// Force difference allowed between level I and the exact condensed level, which solve the same equations: shapes are
/// iterated until nothing moves by more than 1e-5 mm, through stiffnesses of needle and tissue below 100 N/mm.
const SAME_N: f64 = 1e-3;

/// Measurements at a level, with a probe or without.
pub(crate) struct AtLevel<T> {
    pub level: Level,
    pub probe: bool,
    pub measured: T,
}

/// An insertion.
pub(crate) struct Inserted {
    pub times: StepTimes,
    /// Differences from level I before and once the probe moves (root mean square), N and mm; `None` for level I.
    force_before_n: Option<f64>,
    force_after_n: Option<f64>,
    tip_before_mm: Option<f64>,
    pub tip_after_mm: Option<f64>,
    /// Time that each of [`PERCENT`] of the steps that remesh do not exceed, ms.
    quartiles: [Option<f64>; 5],
    pub flag: Option<String>,
}

/// Some steps of an insertion.
struct Moment {
    time_s: f64,
    axial_n: f64,
    across_n: f64,
    tip_aside_mm: f64,
    force_difference_n: Option<f64>,
    step_ms: f64,
}

/// Per cent of the steps that remesh, and the time that they do not exceed.
type Quartile = (f64, Option<f64>);

impl Timed for AtLevel<Inserted> {
    fn times(&self) -> &StepTimes {
        &self.measured.times
    }
}

/// Name of a level in the tables.
fn name(level: Level) -> String {
    match level {
        Level::Exact => "exact condensed".to_owned(),
        other => other.to_string(),
    }
}

const fn choices<T>() -> [Choice<AtLevel<T>>; 2] {
    [
        Factor::new("level", "level").of(|row: &AtLevel<T>| name(row.level)),
        Factor::new("probe", "probe").of(|row: &AtLevel<T>| if row.probe { "with" } else { "without" }.to_owned()),
    ]
}

const DIFFERENCES: [Column<AtLevel<Inserted>>; 4] = [
    Axis::log(
        "force_before_n",
        "force before, N",
        "difference of the force at the base before the probe moves (root mean square), N",
    )
    .of(|row| row.measured.force_before_n),
    Axis::log(
        "force_after_n",
        "force after, N",
        "difference of the force at the base once the probe moves (root mean square), N",
    )
    .of(|row| row.measured.force_after_n),
    Axis::log(
        "tip_before_mm",
        "tip before, mm",
        "difference of the tip before the probe moves (root mean square), mm",
    )
    .of(|row| row.measured.tip_before_mm),
    Axis::log(
        "tip_after_mm",
        "tip after, mm",
        "difference of the tip once the probe moves (root mean square), mm",
    )
    .of(|row| row.measured.tip_after_mm),
];

const TRACE: [Column<AtLevel<Moment>>; 6] = [
    Axis::linear("time_s", "s", "time, s").of(|row| Some(row.measured.time_s)),
    Axis::linear("axial_n", "axial N", "force on the hand along the needle, N").of(|row| Some(row.measured.axial_n)),
    Axis::linear("across_n", "across N", "force on the hand across the needle, N")
        .of(|row| Some(row.measured.across_n)),
    Axis::linear(
        "tip_aside_mm",
        "tip mm",
        "tip beside the straight path, away from the probe, mm",
    )
    .of(|row| Some(row.measured.tip_aside_mm)),
    Axis::log(
        "force_difference_n",
        "force off, N",
        "difference of the force at the base from level I, N",
    )
    .of(|row| row.measured.force_difference_n),
    Axis::log("step_ms", "ms", "time of a step (longest of some), ms").of(|row| Some(row.measured.step_ms)),
];

/// Extent and quartiles of the time of steps that remesh, beside the median and the longest (Goksel et al. 2011, figure
/// 15).
const QUARTILES: [Column<AtLevel<Inserted>>; 3] = [
    Axis::log(
        "remesh_min_ms",
        "remesh min",
        "time of a step that remeshes (shortest), ms",
    )
    .of(|row| row.measured.quartiles[0]),
    Axis::log(
        "remesh_q1_ms",
        "remesh q1",
        "time of a step that remeshes (lower quartile), ms",
    )
    .of(|row| row.measured.quartiles[1]),
    Axis::log(
        "remesh_q3_ms",
        "remesh q3",
        "time of a step that remeshes (upper quartile), ms",
    )
    .of(|row| row.measured.quartiles[3]),
];

const SPREAD: [Column<AtLevel<Quartile>>; 2] = [
    Axis::linear("percent", "%", "steps that remesh in no more time, %").of(|row| Some(row.measured.0)),
    Axis::log("remesh_ms", "remesh ms", "time of a step that remeshes, ms").of(|row| row.measured.1),
];

/// Per cent of the steps that remesh whose time is read off: the shortest, the quartiles, the longest.
const PERCENT: [f64; 5] = [0.0, 25.0, 50.0, 75.0, 100.0];

/// Returns the time that each of [`PERCENT`] of the steps that remesh do not exceed, ms; `None` if there are none.
fn quartiles(steps: &[Step]) -> [Option<f64>; 5] {
    let mut ms: Vec<f64> = steps.iter().filter(|step| step.remeshed).map(|step| step.ms).collect();
    ms.sort_by(f64::total_cmp);
    PERCENT.map(|percent| percentile(&ms, percent / 100.0))
}

/// Insertions at every level.
pub(crate) struct Levels {
    /// Nodes of the block.
    pub nodes: usize,
    pub rows: Vec<AtLevel<Inserted>>,
    moments: Vec<AtLevel<Moment>>,
    about: Vec<(&'static str, String)>,
}

/// Measures insertions at every level, with a probe and without.
pub(crate) fn measure(options: &InsertionOptions, progress: Progress<'_>) -> Result<Levels, Error> {
    check_memory(options.nodes, memory::available())?;
    let (mut rows, mut moments, mut about_block, mut nodes) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for (half, probe) in [true, false].into_iter().enumerate() {
        let mut report = |text: &str, share: f64| progress(text, 0.5 * (half as f64 + share));
        let course = Course {
            depth_mm: options.depth_mm,
            probe,
        };
        let mut models = Vec::new();
        for (index, level) in LEVELS.into_iter().enumerate() {
            let text = format!("level {}: inverse", name(level));
            report(&text, 0.6 * index as f64 / LEVELS.len() as f64);
            models.push(model(options.nodes, level, probe)?);
        }
        if probe {
            nodes = models[0].mesh().nodes().len();
            about_block = about(options, &models);
        }
        // Driven together, pass by pass in turn: a busy spell of the machine
        // then does not fall on one level alone.
        let traces = course.drive(&mut models, options.passes, &mut |share| {
            report("levels along the insertion", 0.6 + 0.4 * share);
        })?;
        let gold = &traces[0];
        for (level, steps) in LEVELS.into_iter().zip(&traces) {
            let force = largest(gold.iter().zip(steps).map(|(a, b)| (a.force_n - b.force_n).norm()));
            // Exact condensed solves the same equations as level I; the other
            // levels approximate and may be off.
            let is_wrong = level == Level::Exact && force > SAME_N;
            let [force_before_n, force_after_n, tip_before_mm, tip_after_mm] =
                differences(&course, gold, steps).map(|difference| (level != Level::I).then_some(difference));
            let inserted = Inserted {
                times: StepTimes::of(steps),
                force_before_n,
                force_after_n,
                tip_before_mm,
                tip_after_mm,
                quartiles: quartiles(steps),
                flag: is_wrong.then(|| format!("off level I by {force:.1e} N: at most {SAME_N:.0e} is expected")),
            };
            let at_level = |moment| AtLevel {
                level,
                probe,
                measured: moment,
            };
            moments.extend(along(&course, gold, steps, level != Level::I).map(at_level));
            rows.push(AtLevel {
                level,
                probe,
                measured: inserted,
            });
        }
    }
    Ok(Levels {
        nodes,
        rows,
        moments,
        about: about_block,
    })
}

pub(super) fn run(options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
    let levels = measure(options, progress)?;
    let goal = Goal::new("remesh_median_ms", "tip_after_mm", SHIFT_MM)
        .over(&["probe"])
        .choosing("level of remeshing along an insertion")
        .baseline("level", "IV", FROZEN)
        .in_every(Deadline::Step, "remesh_median_ms")
        .beside(&["median_ms", "max_ms", "force_after_n"]);
    let title = "Levels of remeshing along one insertion: differences from level I, times of steps";
    let columns: Vec<Column<AtLevel<Inserted>>> = DIFFERENCES
        .into_iter()
        .chain(times())
        .chain(QUARTILES)
        .chain([unsettled()])
        .collect();
    let table = Table::of("levels", title, &choices(), &columns, &levels.rows)
        .flagged(&levels.rows, |row| row.measured.flag.clone())
        .gold_where(&levels.rows, |row| row.level == Level::I)
        .against("level I in f64, which keeps the whole inverse")
        .seeking(goal);
    // Quartiles are columns above, but a figure plots one point per row: here each becomes a row.
    let spread = levels.rows.iter().flat_map(|row| {
        let quartiles = PERCENT.into_iter().zip(row.measured.quartiles);
        quartiles.map(|quartile| AtLevel {
            level: row.level,
            probe: row.probe,
            measured: quartile,
        })
    });
    let spread: Vec<AtLevel<Quartile>> = spread.collect();
    study.about.extend(levels.about);
    study.tables.extend([
        table,
        Table::of(
            "levels-along",
            "Along the insertion",
            &choices(),
            &TRACE,
            &levels.moments,
        )
        .unlisted(),
        Table::of(
            "levels-remesh",
            "Time of steps that remesh",
            &choices(),
            &SPREAD,
            &spread,
        )
        .unlisted(),
    ]);
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

/// Differences of forces and tips from the gold standard, before and once the probe moves (root mean square).
fn differences(course: &Course, reference: &[Step], compared: &[Step]) -> [f64; 4] {
    let force = |(a, b): (&Step, &Step)| (a.force_n - b.force_n).norm();
    let tip = |(a, b): (&Step, &Step)| (a.tip_mm - b.tip_mm).norm();
    let pairs = || reference.iter().zip(compared);
    let steps_moved = course.moved();
    [
        mean_square(pairs().take(steps_moved).map(force)),
        mean_square(pairs().skip(steps_moved).map(force)),
        mean_square(pairs().take(steps_moved).map(tip)),
        mean_square(pairs().skip(steps_moved).map(tip)),
    ]
}

/// Longest time of every few steps, and the state after them, with the difference from the gold standard if it is
/// another.
fn along<'a>(
    course: &'a Course,
    gold: &'a [Step],
    steps: &'a [Step],
    is_other: bool,
) -> impl Iterator<Item = Moment> + 'a {
    let chunk_steps = course.steps().div_ceil(POINTS);
    let chunks = steps.chunks(chunk_steps).zip(gold.chunks(chunk_steps)).enumerate();
    chunks.filter_map(move |(chunk, (these, gold))| {
        let last_step = these.last()?;
        let difference = largest(these.iter().zip(gold).map(|(a, b)| (a.force_n - b.force_n).norm()));
        Some(Moment {
            time_s: course.time_s(chunk * chunk_steps + these.len() - 1),
            axial_n: last_step.force_n.z,
            across_n: last_step.force_n.y,
            tip_aside_mm: last_step.tip_mm.y - ENTRY_MM[1],
            force_difference_n: is_other.then_some(difference),
            step_ms: largest(these.iter().map(|step| step.ms)),
        })
    })
}

fn figures() -> Vec<Figure> {
    let with_probe = || vec![("probe", "with".to_owned())];
    let plot = |file: &str, title: &str, y: &'static str| Figure {
        only: with_probe(),
        ..lines(file, title, "levels-along", ["time_s", y], "level")
    };
    vec![
        plot(
            "insertion-force-difference",
            "Force at the needle's base: how far from level I?",
            "force_difference_n",
        ),
        plot(
            "insertion-tip",
            "The needle's tip, the probe moved towards it midway",
            "tip_aside_mm",
        ),
        plot("insertion-force", "Force on the hand along the needle", "axial_n"),
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
            only: with_probe(),
            marked: true,
            ..lines(
                "insertion-remesh-quartiles",
                "Time of a step that remeshes, with the probe: shortest, quartiles, longest",
                "levels-remesh",
                ["percent", "remesh_ms"],
                "level",
            )
        },
        plot(
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
