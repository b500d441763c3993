//! Stiffening and creeping tissue: cost and error of solution schemes and tissue models.
//!
//! A plate comes down onto a block and stays. One table compares schemes in elastic tissue with full Newton at a hundredth of their
//! tolerance: Euler's steps as in Kobayashi et al. 2010, with the consistent tangent, and with the imbalance corrected; modified
//! Newton-Raphson, plain and accelerated; full Newton. The other compares models with the finest one, viscoelastic tissue by the rate law
//! in four times as many steps, and each model with itself in four times as many: the error of the model, and the error of its steps.

mod subject;
#[cfg(test)]
mod tests;

use super::gather::Entry;
use super::{Axis, Deadline, FORCE_N, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use subject::{Model, Subject, Variant, Walked};

use crate::StudyError;
use crate::stability::Effort;
use insonify::Error;
use insonify_base::machine::Machine;
use insonify_base::statistics::Spread;
use insonify_mechanics::tissue::nonlinear::creep::Memory;
use insonify_mechanics::tissue::nonlinear::{Scheme, Slope};

/// Options of the study.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TissueOptions {
    /// Nodes of the block (default 1,000).
    pub nodes: usize,
    /// Young's modulus below the knee, kPa (default 1.16, porcine liver).
    pub young_kpa: f64,
    /// Poisson's ratio (default 0.45).
    pub poisson: f64,
    /// Relative strain above which the tissue stiffens (default 0.303).
    pub knee_strain: f64,
    /// Rate of stiffening above the knee (default 20).
    pub stiffening: f64,
    /// Order of the viscosity (default 0.1).
    pub order: f64,
    /// Final displacement of the plate, mm (default 12).
    pub depth_mm: f64,
    /// Smallest and largest number of loading steps, doubled in between (default 5 to 20).
    pub steps: [u32; 2],
}

impl Default for TissueOptions {
    fn default() -> Self {
        TissueOptions {
            nodes: 1000,
            young_kpa: 1.16,
            poisson: 0.45,
            knee_strain: 0.303,
            stiffening: 20.0,
            order: 0.1,
            depth_mm: 12.0,
            steps: [5, 20],
        }
    }
}

/// Registration of this study.
pub const ENTRY: Entry = Entry {
    name: "tissue",
    title: "Tissue that stiffens and creeps",
    question: "A plate presses a block of liver: which model of the tissue is needed, and which scheme solves it?",
    run: |_, effort, progress| {
        let usual = TissueOptions::of(effort);
        let whole = TissueOptions { nodes: 1500, ..usual };
        Ok(study(&effort.pick(usual, whole), progress)?)
    },
};

impl TissueOptions {
    /// Returns options with as many nodes as Goksel et al. 2011 have, and enough steps for the errors to vanish.
    pub fn full() -> Self {
        let usual = TissueOptions::default();
        TissueOptions {
            nodes: 3300,
            steps: [usual.steps[0], 40],
            ..usual
        }
    }

    /// Returns the options for an effort: the default, or a small block and few steps.
    pub fn of(effort: Effort) -> Self {
        let usual = TissueOptions::default();
        let quick = TissueOptions {
            nodes: 300,
            steps: [usual.steps[0], 10],
            ..usual
        };
        effort.pick(quick, usual)
    }
}

const FACTORS: [Factor; 2] = [Factor::new("scheme", "scheme"), Factor::new("steps", "steps")];

const MODELS: [Factor; 2] = [Factor::new("model", "model"), FACTORS[1]];

const MEDIAN: Axis = Axis::log("median_ms", "ms", "time of a step (median), ms");
const P95: Axis = Axis::log("p95_ms", "p95 ms", "time of a step (95th percentile), ms");
const TOTAL: Axis = Axis::log("total_ms", "total ms", "time of all steps, ms");
const ERROR: Axis = Axis::log("error", "err u", "relative error of displacements");
const ERROR_MM: Axis = Axis::log("error_mm", "err mm", "largest error of displacements, mm");
const ITERATIONS: Axis = Axis::linear("iterations", "iterations", "iterations of a step");
const FACTORISATIONS: Axis = Axis::linear("factorisations", "factorisations", "factorisations of a step");
const FORCE: Axis = Axis::linear("force_n", "force N", "force on the plate when it is down, N");
const RELAXED: Axis = Axis::linear("relaxed_n", "end N", "force on the plate at the end, N");
const ERROR_FORCE: Axis = Axis::log(
    "error_force",
    "err force",
    "relative error of the force when the plate is down",
);
const ERROR_N: Axis = Axis::log("error_n", "err N", "error of the force when the plate is down, N");
const OWN: Axis = Axis::log(
    "error_own",
    "err steps",
    "relative error of that force against four times as many steps",
);

/// Tolerance of the schemes; the gold standard uses a hundredth of it.
const TOLERANCE: f64 = 1e-8;

fn schemes() -> [(&'static str, Scheme); 6] {
    let euler = |slope, corrected| Scheme::Euler { slope, corrected };
    [
        ("Euler (Kobayashi 2010)", euler(Slope::Scalar, false)),
        ("Euler, consistent", euler(Slope::Consistent, false)),
        ("Euler, corrected", euler(Slope::Scalar, true)),
        ("modified (Kobayashi 2010)", Scheme::Modified { memory: 0 }),
        ("modified, accelerated", Scheme::MODIFIED),
        ("full Newton", Scheme::Newton),
    ]
}

const ALL_MODELS: [(&str, Model); 4] = [
    ("linear", Model::Linear),
    ("nonlinear", Model::Nonlinear),
    ("viscoelastic, load integral", Model::Viscous(Memory::LoadIntegral)),
    ("viscoelastic, rate", Model::Viscous(Memory::Rate)),
];

/// Runs the study. `progress` receives the current task and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`Error`] if the block cannot be created or the gold standard cannot be solved.
pub fn study(options: &TissueOptions, progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<Study, Error> {
    let subject = Subject::new(options)?;
    let counts: Vec<u32> = std::iter::successors(Some(options.steps[0].max(1)), |steps| steps.checked_mul(2))
        .take_while(|steps| *steps <= options.steps[1].max(1))
        .collect();
    let total = ((schemes().len() + ALL_MODELS.len()) * counts.len() + 2) as f64;
    let mut done = 0.0;
    let mut next = |what: &str| {
        progress(what, (done / total).min(1.0));
        done += 1.0;
    };

    let table = schemes_table(&subject, &counts, &mut next)?;
    let models = models_table(&subject, &counts, &mut next)?;
    progress("done", 1.0);
    Ok(finish(options, &subject, vec![table, models]))
}

fn schemes_table(subject: &Subject, counts: &[u32], next: &mut dyn FnMut(&str)) -> Result<Table, Error> {
    next("the gold standard");
    let gold = truth(subject, Model::Nonlinear, 1, false)?;
    let axes = [TOTAL, MEDIAN, P95, ERROR, ERROR_MM, ITERATIONS, FACTORISATIONS];
    let mut table = Table::new("schemes", "Schemes in elastic tissue that stiffens", &FACTORS, &axes)
        .against("full Newton to a hundredth of the tolerance")
        .seeking(
            Goal::new("total_ms", "error_mm", SHIFT_MM)
                .choosing("scheme of tissue that stiffens")
                .beside(&["median_ms", "p95_ms", "iterations"]),
        );
    for (name, scheme) in schemes() {
        for &steps in counts {
            next(&format!("{name}, {steps} steps"));
            let variant = Variant {
                model: Model::Nonlinear,
                scheme,
                steps,
                hold: false,
                tolerance: TOLERANCE,
            };
            let walked = subject.walk(&variant)?;
            let each = |count: usize| Some(count as f64 / f64::from(steps));
            let error = relative(&walked.displacement, &gold.displacement);
            let values = vec![
                total_ms(&walked),
                median_ms(&walked),
                p95_ms(&walked),
                Some(error),
                Some(off_mm(&walked.displacement, &gold.displacement)),
                each(walked.iterations),
                each(walked.factorisations),
            ];
            table.push(vec![name.to_owned(), steps.to_string()], values, walked.flag);
        }
    }
    Ok(table)
}

fn models_table(subject: &Subject, counts: &[u32], next: &mut dyn FnMut(&str)) -> Result<Table, Error> {
    let finest_steps = 4 * counts.last().copied().unwrap_or(1);
    next("the finest model");
    let finest = truth(subject, Model::Viscous(Memory::Rate), finest_steps, true)?;
    let axes = [TOTAL, P95, FORCE, RELAXED, ERROR_FORCE, ERROR_N, OWN, ERROR, ERROR_MM];
    let mut models = Table::new(
        "models",
        "Models against viscoelastic tissue in the finest steps",
        &MODELS,
        &axes,
    )
    .against("viscoelastic tissue by the law of rates in four times as many steps")
    .seeking(
        Goal::new("total_ms", "error_n", FORCE_N)
            .choosing("model of tissue")
            .in_every(Deadline::Step, "p95_ms")
            .beside(&["p95_ms", "error_mm", "relaxed_n"]),
    );
    for (name, model) in ALL_MODELS {
        let own = match model {
            Model::Linear | Model::Nonlinear => None,
            Model::Viscous(_) => Some(truth(subject, model, finest_steps, true)?),
        };
        for &steps in counts {
            next(&format!("{name}, {steps} steps"));
            let variant = Variant {
                model,
                scheme: Scheme::MODIFIED,
                steps,
                hold: true,
                tolerance: TOLERANCE,
            };
            let walked = subject.walk(&variant)?;
            let off = |other: &Walked| (walked.force_n[0] / other.force_n[0] - 1.0).abs();
            let values = vec![
                total_ms(&walked),
                p95_ms(&walked),
                Some(walked.force_n[0]),
                Some(walked.force_n[1]),
                Some(off(&finest)),
                Some((walked.force_n[0] - finest.force_n[0]).abs()),
                own.as_ref().map(off),
                Some(relative(&walked.displacement, &finest.displacement)),
                Some(off_mm(&walked.displacement, &finest.displacement)),
            ];
            models.push(vec![name.to_owned(), steps.to_string()], values, walked.flag);
        }
    }
    Ok(models)
}

/// Solves by full Newton to a hundredth of the tolerance.
fn truth(subject: &Subject, model: Model, steps: u32, hold: bool) -> Result<Walked, Error> {
    // An elastic body is path-independent; large steps may not converge.
    let least = if hold { steps } else { steps.max(8) };
    let tolerance = 1e-2 * TOLERANCE;
    let walked = subject.walk(&Variant {
        model,
        scheme: Scheme::Newton,
        steps: least,
        hold,
        tolerance,
    })?;
    match walked.flag {
        Some(flag) => Err(StudyError::refused(format!(
            "the gold standard cannot be solved: {flag}"
        ))),
        None => Ok(walked),
    }
}

fn total_ms(walked: &Walked) -> Option<f64> {
    (!walked.times_ms.is_empty()).then(|| walked.times_ms.iter().sum())
}

fn median_ms(walked: &Walked) -> Option<f64> {
    Spread::of(walked.times_ms.clone()).map(|spread| spread.median_ms)
}

fn p95_ms(walked: &Walked) -> Option<f64> {
    Spread::of(walked.times_ms.clone()).map(|spread| spread.p95_ms)
}

fn relative(found: &[f64], expected: &[f64]) -> f64 {
    let largest = expected.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
    off_mm(found, expected) / largest
}

/// Returns the largest difference, mm.
fn off_mm(found: &[f64], expected: &[f64]) -> f64 {
    let pairs = found.iter().zip(expected);
    pairs.fold(0.0, |a: f64, (x, y)| a.max((x - y).abs()))
}

fn finish(options: &TissueOptions, subject: &Subject, tables: Vec<Table>) -> Study {
    let [nodes, elements, free] = subject.sizes();
    let figure = |file: &str, title: &str, table, x, y, colour| Figure {
        marker: vec!["steps"],
        joined: false,
        ..Figure::new(file, title, table, [x, y], colour)
    };
    Study {
        name: "tissue",
        title: ENTRY.title,
        about: vec![
            ("nodes", nodes.to_string()),
            ("elements", elements.to_string()),
            ("degrees_of_freedom", free.to_string()),
            ("young_kpa", options.young_kpa.to_string()),
            ("poisson", options.poisson.to_string()),
            ("knee_strain", options.knee_strain.to_string()),
            ("stiffening", options.stiffening.to_string()),
            ("order", options.order.to_string()),
            ("depth_mm", options.depth_mm.to_string()),
        ],
        machine: Machine::here(),
        figures: vec![
            figure(
                "schemes",
                "Schemes: time against error",
                "schemes",
                "total_ms",
                "error",
                "scheme",
            ),
            figure(
                "models",
                "Models: time against the finest",
                "models",
                "total_ms",
                "error_force",
                "model",
            ),
        ],
        tables,
        notes: Vec::new(),
    }
}
