//! Needle insertions: cost and error of each computational choice.
//!
//! Every part drives several models along one insertion and compares what hand and image receive. Steps are computed
//! several times, the contenders of a part in turn; the time of a step is the minimum, since other load on the machine
//! only adds to it.
//!
//! | module | comparison |
//! |---|---|
//! | `levels` | remeshing levels, with a probe moved sideways midway (Goksel et al. 2011, figures 13c, 14 and 15) |
//! | `meshes` | number of mesh nodes |
//! | `patch` | radius of the patch of tissue that bears the force at the tip, and meshes: dent before a puncture |
//! | `thinning` | every n-th probe candidate |
//! | `bevel` | bevels and meshes in a block of PVC: deflection against depth (Goksel et al. 2011, section VI-A) |
//! | `pieces` | link lengths of an angular-spring needle, element lengths of a beam |
//! | `masses` | masses and springs against finite elements |
//!
//! `Course` moves the instruments and times the steps.

mod bevel;
pub(crate) mod levels;
mod masses;
pub(crate) mod meshes;
pub(crate) mod patch;
pub(crate) mod pieces;
pub(crate) mod thinning;

use std::time::Instant;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use schemars::{JsonSchema, schema_for};
use serde::Deserialize;

use super::entry::{About, Backends, Context, Entry, StudyOption, parsed, ranged};
use super::{Axis, Column, Figure, Study};
use crate::stability::Effort;
pub(crate) use crate::stability::record::largest;
use insonify::Error;
use insonify_base::machine::Machine;
use insonify_base::range::OutOfRange;
use insonify_base::statistics::percentile;
use insonify_mechanics::block;
use insonify_mechanics::insertion::finite::{Finite, Setup};
use insonify_mechanics::insertion::{Instruments, Model, ProbeContact};
use insonify_mechanics::needle::Needle;
use insonify_mechanics::tissue::material::Material;
use insonify_mesh::TetMesh;

/// Part of the study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Part {
    /// Levels of remeshing, a probe moved sideways midway.
    Levels,
    /// Bevels and meshes in a block of PVC; with --quick a single length and mesh.
    Bevel,
    /// Masses and springs against finite elements.
    Masses,
    /// Every n-th candidate of the probe.
    Thinning,
    /// Length of the needle's links.
    Links,
    /// Element length of a needle modelled as a beam.
    Elements,
    /// Nodes of the mesh.
    Mesh,
    /// Radius of the patch of tissue that bears the force at the tip.
    Patch,
}

impl Part {
    /// All parts.
    pub(crate) const ALL: [Part; 8] = [
        Part::Levels,
        Part::Mesh,
        Part::Patch,
        Part::Bevel,
        Part::Masses,
        Part::Thinning,
        Part::Links,
        Part::Elements,
    ];

    /// Runs the part and adds its results to the study.
    fn run(self, options: &InsertionOptions, study: &mut Study, progress: Progress<'_>) -> Result<(), Error> {
        match self {
            Part::Levels => levels::run(options, study, progress),
            Part::Bevel => bevel::run(options, study, progress),
            Part::Masses => masses::run(options, study, progress),
            Part::Thinning => thinning::run(options, study, progress),
            Part::Links => pieces::LINKS.run(options, study, progress),
            Part::Elements => pieces::ELEMENTS.run(options, study, progress),
            Part::Mesh => meshes::run(options, study, progress),
            Part::Patch => patch::run(options, study, progress),
        }
    }
}

/// Options of the study.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct InsertionOptions {
    /// Approximate number of nodes of the block (default 3,300: the detailed model of Goksel et al. 2011).
    pub nodes: usize,
    /// Insertion depth, mm (10 to 80, default 60).
    pub depth_mm: f64,
    /// Insertion depth in the block of PVC, mm (10 to 140, default 140).
    pub bevel_depth_mm: f64,
    /// Whether bevels of half and one and a half times the default length and finer meshes are compared too (default
    /// true).
    pub bevel_sweep: bool,
    /// Number of times that every step is computed and timed (default 3).
    pub passes: usize,
    /// Parts to run (default all).
    pub parts: Vec<Part>,
}

impl Default for InsertionOptions {
    fn default() -> Self {
        InsertionOptions {
            nodes: 3300,
            depth_mm: 60.0,
            bevel_depth_mm: 140.0,
            bevel_sweep: true,
            passes: 3,
            parts: Part::ALL.to_vec(),
        }
    }
}

/// Registration of this study.
pub(crate) const ENTRY: Entry<InsertionOptions> = Entry {
    about: About {
        name: "insertion",
        title: "Needle insertion",
        question: "A needle is inserted and withdrawn while a probe presses: what are the step times and the errors of force and tip position? \
                   Levels of remeshing, nodes of the mesh, the patch that bears the tip, links and elements of the needle, candidates of the probe, masses \
                   and springs.",
        help: "Needle insertions: levels of remeshing, nodes of the mesh, the patch that bears the tip, bevels, masses and springs, candidates of the probe, links and elements of the needle",
        examples: "\
Examples:
  insonify tradeoff insertion --quick                   a first look, in seconds
  insonify tradeoff insertion -o study                  everything, with plots: minutes
  insonify tradeoff insertion --only levels,links -o study
  insonify tradeoff insertion --nodes 1000 --depth-mm 40 --json

Each step is calculated several times over, the models in turn; its time is the least of these. A row with a star in a plot is
a best choice; one that violates its guarantee is marked WRONG.",
        backends: Backends::Cpu,
    },
    options: &[
        StudyOption::<InsertionOptions>::value("only", "PART,...", "What to compare [default: everything]", |options, texts| {
            let parts = serde_json::from_value(texts.into());
            parts.map(|parts| options.parts = parts).map_err(|error| error.to_string())
        })
        .list()
        .choices(|| schema_for!(Part)),
        StudyOption::value(
            "nodes",
            "N",
            "Nodes of the block of tissue [default: 3300; with --quick 500]",
            |options, texts| ranged(texts, 100..=100_000, "a number of nodes from 100 to 100000").map(|value| options.nodes = value),
        ),
        StudyOption::<InsertionOptions>::value(
            "depth-mm",
            "MM",
            "Insertion depth, mm [default: 60; with --quick 20]",
            |options, texts| parsed(texts).map(|value| options.depth_mm = value),
        )
        .signed(),
        StudyOption::<InsertionOptions>::value(
            "bevel-depth-mm",
            "MM",
            "Insertion depth of bevelled needles in the block of PVC, mm [default: 140; with --quick 60]",
            |options, texts| parsed(texts).map(|value| options.bevel_depth_mm = value),
        )
        .signed(),
        StudyOption::value(
            "passes",
            "N",
            "Number of repeated calculations of each step for timing [default: 3; with --quick 1]",
            |options, texts| parsed(texts).map(|value| options.passes = value),
        ),
        StudyOption::quick("A small block and short paths"),
    ],
    settings: InsertionOptions::of,
    // A report runs every study: its times may be those of a single pass, its errors are the same.
    in_report: |effort| InsertionOptions {
        passes: 1,
        ..InsertionOptions::of(effort)
    },
    run: |options, Context { progress, .. }| study(options, progress),
};

impl InsertionOptions {
    /// Returns the options for an effort: the default, or a small block and short insertions.
    pub(crate) fn of(effort: Effort) -> Self {
        effort.pick(
            InsertionOptions {
                nodes: 500,
                depth_mm: 20.0,
                bevel_depth_mm: 60.0,
                bevel_sweep: false,
                passes: 1,
                ..InsertionOptions::default()
            },
            InsertionOptions::default(),
        )
    }

    fn check(&self) -> Result<(), Error> {
        let numbers = [
            ("nodes", self.nodes as f64, 100.0..=100_000.0, "100 to 100000"),
            ("depth_mm", self.depth_mm, 10.0..=80.0, "10 to 80 mm"),
            ("bevel_depth_mm", self.bevel_depth_mm, 10.0..=140.0, "10 to 140 mm"),
            ("passes", self.passes as f64, 1.0..=1000.0, "1 to 1000"),
            ("parts", self.parts.len() as f64, 1.0..=f64::MAX, "1 or more"),
        ];
        match numbers
            .into_iter()
            .find(|(_, number, range, _)| !range.contains(number))
        {
            Some((key, number, _, expected)) => Err(OutOfRange::new(key, number, expected).into()),
            None => Ok(()),
        }
    }
}

/// Callback that receives the current task and the completed fraction, increasing from 0 to 1.
pub(crate) type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// Studies insertions. `progress` receives the current task and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`Error`]; memory is checked before any large allocation.
pub(crate) fn study(options: &InsertionOptions, progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<Study, Error> {
    options.check()?;
    let mut study = Study {
        name: "tradeoff-insertion",
        title: ENTRY.about.title,
        about: vec![("passes", options.passes.to_string())],
        machine: Machine::here(),
        tables: Vec::new(),
        figures: Vec::new(),
        notes: Vec::new(),
    };
    let total = options.parts.len() as f64;
    for (index, part) in options.parts.iter().enumerate() {
        let mut part_progress = |text: &str, share: f64| progress(text, (index as f64 + share) / total);
        part.run(options, &mut study, &mut part_progress)?;
    }
    progress("done", 1.0);
    Ok(study)
}

/// Times of the steps of an insertion.
#[derive(Clone, Debug)]
pub(crate) struct StepTimes {
    median_ms: Option<f64>,
    p95_ms: Option<f64>,
    p99_ms: Option<f64>,
    max_ms: Option<f64>,
    /// Median and longest time of the steps that remesh, ms.
    pub remesh_median_ms: Option<f64>,
    remesh_max_ms: Option<f64>,
    remeshing: usize,
    /// Number of steps whose iterations did not converge.
    unsettled: usize,
}

impl StepTimes {
    fn of(steps: &[Step]) -> Self {
        let sorted = |counts: &dyn Fn(&Step) -> bool| {
            let mut ms: Vec<f64> = steps.iter().filter(|step| counts(step)).map(|step| step.ms).collect();
            ms.sort_by(f64::total_cmp);
            ms
        };
        let (every_step, remeshing) = (sorted(&|_| true), sorted(&|step| step.remeshed));
        Self {
            median_ms: percentile(&every_step, 0.5),
            p95_ms: percentile(&every_step, 0.95),
            p99_ms: percentile(&every_step, 0.99),
            max_ms: every_step.last().copied(),
            remesh_median_ms: percentile(&remeshing, 0.5),
            remesh_max_ms: remeshing.last().copied(),
            remeshing: remeshing.len(),
            unsettled: steps.iter().filter(|step| !step.converged).count(),
        }
    }
}

/// Row of an insertion.
trait Timed {
    fn times(&self) -> &StepTimes;
}

/// Columns of the step times.
fn times<R: Timed>() -> [Column<R>; 7] {
    [
        Axis::log("median_ms", "ms", "time of a step (median), ms").of(|row: &R| row.times().median_ms),
        Axis::log("p95_ms", "p95 ms", "time of a step (95th percentile), ms").of(|row: &R| row.times().p95_ms),
        Axis::log("p99_ms", "p99 ms", "time of a step (99th percentile), ms").of(|row: &R| row.times().p99_ms),
        Axis::log("max_ms", "max ms", "time of a step (longest), ms").of(|row: &R| row.times().max_ms),
        Axis::log(
            "remesh_median_ms",
            "remesh ms",
            "time of a step that remeshes (median), ms",
        )
        .of(|row: &R| row.times().remesh_median_ms),
        Axis::log(
            "remesh_max_ms",
            "remesh max",
            "time of a step that remeshes (longest), ms",
        )
        .of(|row: &R| row.times().remesh_max_ms),
        Axis::linear("remeshing", "remeshing", "steps that remesh").of(|row: &R| Some(row.times().remeshing as f64)),
    ]
}

/// Column of the steps whose iterations did not converge.
fn unsettled<R: Timed>() -> Column<R> {
    Axis::linear("unsettled", "unsettled", "steps that did not converge")
        .of(|row: &R| Some(row.times().unsettled as f64))
}

/// Returns the root mean square.
pub(crate) fn mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value * value, count + 1.0));
    (sum / count).sqrt()
}

/// Creates a line plot of a trace, with a colour for each choice of a factor.
pub(crate) fn lines(
    file: &str,
    title: &str,
    table: &'static str,
    [x, y]: [&'static str; 2],
    colour: &'static str,
) -> Figure {
    Figure {
        marked: false,
        ..Figure::new(file, title, table, [x, y], colour)
    }
}

/// Creates a scatter plot with a colour for each choice of a factor, the best points marked.
pub(crate) fn points(
    file: &str,
    title: &str,
    table: &'static str,
    axes: [&'static str; 2],
    colour: &'static str,
) -> Figure {
    Figure {
        joined: false,
        marked: true,
        ..lines(file, title, table, axes, colour)
    }
}

/// Extent of the block of tissue, mm.
pub(crate) const EXTENT: [f64; 3] = [60.0, 60.0, 90.0];
/// Entry point of the needle, mm: off all lattice planes, beside the probe.
pub(crate) const ENTRY_MM: [f64; 2] = [31.3, 20.9];
/// Simulated time of a step, s.
pub(crate) const STEP_S: f64 = 1e-3;
/// Travel of an instrument per step, mm: 20 mm/s.
const ADVANCE_MM: f64 = 0.02;
/// Initial depth of the tip, mm.
const START_MM: f64 = -2.0;
/// Sideways travel of the probe, towards the needle, mm.
const ASIDE_MM: f64 = 6.0;
/// Half-width of the band of nodes that the probe can touch, and its distance from the skin, mm.
const BAND_MM: [f64; 2] = [8.0, 10.0];

/// Course of an insertion: needle in, probe sideways towards it, needle out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Course {
    /// Final depth of the tip, mm.
    pub depth_mm: f64,
    /// Whether a probe is present.
    pub probe: bool,
}

/// Result of a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Step {
    /// Minimum time over the passes, ms.
    pub ms: f64,
    /// Force on the hand, N.
    pub force_n: Vector3<f64>,
    /// Force on the probe, N.
    pub probe_n: Vector3<f64>,
    /// Tip position, mm.
    pub tip_mm: Point3<f64>,
    /// Whether a node was moved.
    pub remeshed: bool,
    /// Whether the iterations converged.
    pub converged: bool,
}

impl Course {
    /// Returns the number of steps of the insertion, and equally of the withdrawal.
    fn steps_in(&self) -> usize {
        ((self.depth_mm - START_MM) / ADVANCE_MM).round() as usize
    }

    /// Returns the first step in which the probe moves.
    pub(crate) fn moved(&self) -> usize {
        self.steps_in() + 1
    }

    /// Returns the number of steps of the probe's motion.
    fn aside(&self) -> usize {
        (ASIDE_MM / ADVANCE_MM).round() as usize
    }

    /// Returns the first step of the withdrawal.
    pub(crate) fn withdrawn(&self) -> usize {
        self.moved() + self.aside()
    }

    /// Returns the total number of steps.
    pub(crate) fn steps(&self) -> usize {
        self.withdrawn() + self.steps_in()
    }

    /// Returns the poses of the instruments at a step.
    fn instruments(&self, step: usize) -> Instruments {
        let travelled = |steps: usize, count: usize, steps_in: f64| steps_in * steps.min(count) as f64 / count as f64;
        let (steps_in, length) = (self.steps_in(), self.depth_mm - START_MM);
        let withdrawn_mm = travelled(step.saturating_sub(self.withdrawn() - 1), steps_in, length);
        let depth = START_MM + travelled(step, steps_in, length) - withdrawn_mm;
        let aside = travelled(step.saturating_sub(self.moved() - 1), self.aside(), ASIDE_MM);
        Instruments {
            probe: self.probe.then(|| probe_at(aside)),
            ..block::guided([ENTRY_MM[0], ENTRY_MM[1], depth])
        }
    }

    /// Returns the time at the end of a step, s.
    pub(crate) fn time_s(&self, step: usize) -> f64 {
        (step + 1) as f64 * STEP_S
    }

    /// Drives the models along the course `passes` times, in turn. `progress` receives the completed fraction.
    ///
    /// # Errors
    /// [`StepError`](insonify_mechanics::insertion::StepError) if a step cannot be computed.
    pub(crate) fn drive(
        &self,
        models: &mut [Finite],
        passes: usize,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Vec<Vec<Step>>, Error> {
        let mut traces = vec![Vec::with_capacity(self.steps()); models.len()];
        let count = models.len();
        let runs = (passes * count) as f64;
        // Models in turn within each pass: a load that comes and goes meets all of them, and the least time of each is
        // free of it.
        for pass in 0..passes {
            for (index, (model, trace)) in models.iter_mut().zip(&mut traces).enumerate() {
                progress((pass * count + index) as f64 / runs);
                for step in 0..self.steps() {
                    let timed_step = timed(model, &self.instruments(step))?;
                    match pass {
                        0 => trace.push(timed_step),
                        _ => trace[step].ms = trace[step].ms.min(timed_step.ms),
                    }
                }
            }
        }
        Ok(traces)
    }
}

/// Computes and times one step.
///
/// # Errors
/// [`StepError`](insonify_mechanics::insertion::StepError) if the step cannot be computed.
pub(crate) fn timed(model: &mut dyn Model, instruments: &Instruments) -> Result<Step, Error> {
    let start = Instant::now();
    let outcome = model.step(instruments, STEP_S)?;
    let ms = start.elapsed().as_secs_f64() * 1e3;
    Ok(Step {
        ms,
        force_n: outcome.on_hand.force_n,
        probe_n: outcome.on_probe.map_or_else(Vector3::zeros, |wrench| wrench.force_n),
        tip_mm: outcome.tip_mm,
        remeshed: outcome.remeshes > 0,
        converged: outcome.converged,
    })
}

/// Creates the block with approximately the given number of nodes.
///
/// # Errors
/// [`Error`] if the mesh or the material is invalid.
pub(crate) fn tissue(nodes: usize, needle: Box<dyn Needle>) -> Result<Setup, Error> {
    let mesh = TetMesh::over_box([0.0; 3], EXTENT, nodes)?;
    Ok(block::on_table(mesh, Material::new(10.0, 0.45)?, block::USUAL, needle))
}

/// Creates a model with the data for remeshing along the needle's path prefetched.
///
/// # Errors
/// [`InvalidSetup`](insonify_mechanics::insertion::InvalidSetup) if the setup is invalid.
pub(crate) fn model(setup: Setup) -> Result<Finite, Error> {
    let mut finite = Finite::new(setup, |_, _| {})?;
    // A step that reads the base at the first contact of a node would time the reading, not the remeshing.
    finite.prefetch(
        &Point3::new(ENTRY_MM[0], ENTRY_MM[1], 0.0),
        &Vector3::z(),
        EXTENT[2],
        5.0,
    );
    Ok(finite)
}

fn probe_at(aside: f64) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(0.5 * EXTENT[0], aside - 10.0, EXTENT[2] - 5.0),
        UnitQuaternion::identity(),
    )
}

/// Creates a probe along z under the face y = 0 that can touch every `stride`-th ring of nodes along its axis.
pub(crate) fn probe(mesh: &TetMesh, stride: usize) -> ProbeContact {
    let [width, low] = BAND_MM;
    let high = EXTENT[2] - 5.0;
    let in_band = |p: &[f64; 3]| p[1] == 0.0 && (p[0] - 0.5 * EXTENT[0]).abs() < width && (low..high).contains(&p[2]);
    let band = (0..).zip(mesh.nodes()).filter(|(_, p)| in_band(p));
    let mut probe = ProbeContact {
        nominal: probe_at(0.0),
        length_mm: EXTENT[2],
        candidates: band.map(|(node, _)| node).collect(),
        driven_at_mm: None,
    };
    probe.thin(mesh.nodes(), stride);
    probe
}

#[cfg(test)]
mod tests;
