//! Stiffening and creeping tissue: cost and error of solution schemes and tissue models.
//!
//! A plate comes down onto a block and stays. One table compares schemes in elastic tissue with full Newton at a
//! hundredth of their tolerance: Euler's steps as in Kobayashi et al. 2010, with the consistent tangent, and with the
//! imbalance corrected; modified Newton-Raphson, plain and accelerated; full Newton. The other compares models with the
//! finest one, viscoelastic tissue by the rate law in four times as many steps, and each model with itself in four
//! times as many: the error of the model, and the error of its steps. The third compares schemes and tolerances for
//! each law of [`tissue::law`](insonify_mechanics::tissue::law) with full Newton at a hundredth of the tightest
//! tolerance.

mod subject;
#[cfg(test)]
mod tests;

use super::entry::{About, Backends, Context, Entry, StudyOption, within};
use super::{Axis, Choice, Column, Deadline, FORCE_N, Factor, Figure, Goal, SHIFT_MM, Study, Table};
use subject::{Model, Response, Simulation, Subject};

use crate::StudyError;
use crate::stability::Effort;
use insonify::Error;
use insonify_base::machine::Machine;
use insonify_mechanics::tissue::law::{AnyLaw, Stiffening};
use insonify_mechanics::tissue::nonlinear::creep::Memory;
use insonify_mechanics::tissue::nonlinear::{Scheme, Slope};

/// Options of the study.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct TissueOptions {
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
pub(crate) const ENTRY: Entry<TissueOptions> = Entry {
    about: About {
        name: "tissue",
        title: "Tissue that stiffens and creeps",
        question: "A plate presses a block of liver: which model of the tissue is needed, and which scheme solves it?",
        help: "Stiffening and viscoelastic tissue: time against error, for Euler, modified and full Newton, and for each model",
        examples: "\
Examples:
  insonify tradeoff tissue --quick           a first look, in seconds
  insonify tradeoff tissue -o study          a block of 1,000 nodes, with plots: half a minute
  insonify tradeoff tissue --whole -o study  3,300 nodes and twice the steps: minutes
  insonify tradeoff tissue --stiffening 60 --json

A row with a star is a best choice among those with as many steps: no other is both faster and nearer to the truth.",
        backends: Backends::Cpu,
    },
    options: &[
        StudyOption::value(
            "nodes",
            "N",
            "Nodes of the block [default: 1000; with --quick 300, with --whole 3300]",
            |options, texts| within(texts, 27..=200_000).map(|value| options.nodes = value),
        ),
        StudyOption::value(
            "steps",
            "N",
            "Largest number of steps until the plate is down, doubled from 5 on [default: 20; with --quick 10, with --whole 40]",
            |options, texts| within(texts, 5..=1000).map(|value| options.steps[1] = value),
        ),
        StudyOption::number("young-kpa", "KPA", "Young's modulus below the knee, kPa", |options| {
            &mut options.young_kpa
        }),
        StudyOption::number("poisson", "NU", "Poisson's ratio, above -1 and below 0.5", |options| {
            &mut options.poisson
        }),
        StudyOption::number(
            "knee-strain",
            "E",
            "Relative strain above which tissue stiffens",
            |options| &mut options.knee_strain,
        ),
        StudyOption::number(
            "stiffening",
            "A",
            "Stiffening coefficient a in E0 (1 + a (e - knee)^2)",
            |options| &mut options.stiffening,
        ),
        StudyOption::number("order", "K", "Order of the viscosity, 0 to 1", |options| {
            &mut options.order
        }),
        StudyOption::quick("A small block and few steps"),
        StudyOption::<TissueOptions>::switch(
            "whole",
            "A block of the size in Kobayashi et al. 2010 and enough steps for errors to level off",
            |options| *options = TissueOptions::full(),
        )
        .excludes("quick"),
    ],
    settings: TissueOptions::of,
    in_report: |effort| {
        let usual = TissueOptions::of(effort);
        effort.pick(usual, TissueOptions { nodes: 1500, ..usual })
    },
    run: |options, Context { progress, .. }| study(options, progress),
};

impl TissueOptions {
    /// Returns options with as many nodes as Goksel et al. 2011 have, and enough steps for the errors to vanish.
    pub(crate) fn full() -> Self {
        let usual = TissueOptions::default();
        TissueOptions {
            nodes: 3300,
            steps: [usual.steps[0], 40],
            ..usual
        }
    }

    /// Returns the options for an effort: the default, or a small block and few steps.
    pub(crate) fn of(effort: Effort) -> Self {
        let usual = TissueOptions::default();
        let quick = TissueOptions {
            nodes: 300,
            steps: [usual.steps[0], 10],
            ..usual
        };
        effort.pick(quick, usual)
    }
}

/// A simulation, compared with its gold standard.
struct Run {
    law: &'static str,
    scheme: &'static str,
    /// Tolerance as a factor of [`TOLERANCE`]; `None` if the scheme has none.
    tolerance: Option<f64>,
    steps: u32,
    response: Response,
    error: f64,
    error_mm: f64,
}

impl Run {
    fn per_step(&self, count: usize) -> Option<f64> {
        Some(count as f64 / f64::from(self.steps))
    }
}

const SCHEME: Factor = Factor::new("scheme", "scheme");
const STEPS: Factor = Factor::new("steps", "steps");
const MEDIAN: Axis = Axis::log("median_ms", "ms", "time of a step (median), ms");
const P95: Axis = Axis::log("p95_ms", "p95 ms", "time of a step (95th percentile), ms");
const TOTAL: Axis = Axis::log("total_ms", "total ms", "time of all steps, ms");
const ERROR: Axis = Axis::log("error", "err u", "relative error of displacements");
const ERROR_MM: Axis = Axis::log("error_mm", "err mm", "largest error of displacements, mm");

const RUN: [Column<Run>; 7] = [
    TOTAL.of(|run| run.response.total_ms()),
    MEDIAN.of(|run| Some(run.response.spread()?.median_ms)),
    P95.of(|run| Some(run.response.spread()?.p95_ms)),
    ERROR.of(|run| Some(run.error)),
    ERROR_MM.of(|run| Some(run.error_mm)),
    Axis::linear("iterations", "iterations", "iterations of a step").of(|run| run.per_step(run.response.iterations)),
    Axis::linear("factorisations", "factorisations", "factorisations of a step")
        .of(|run| run.per_step(run.response.factorisations)),
];

const SCHEMES: [Choice<Run>; 2] = [
    SCHEME.of(|run| run.scheme.to_owned()),
    STEPS.of(|run| run.steps.to_string()),
];

const LAWS: [Choice<Run>; 3] = [
    Factor::new("law", "law").of(|run| run.law.to_owned()),
    SCHEME.of(|run| run.scheme.to_owned()),
    Factor::new("tolerance", "tolerance").of(|run| match run.tolerance {
        Some(tolerance) => format!("{tolerance:.0e}"),
        None => "none".to_owned(),
    }),
];

/// A model, compared with the finest one and with itself in the finest steps.
struct Modelled {
    model: &'static str,
    steps: u32,
    response: Response,
    error: f64,
    error_mm: f64,
    error_force: f64,
    error_n: f64,
    error_own: Option<f64>,
}

const MODELS: [Choice<Modelled>; 2] = [
    Factor::new("model", "model").of(|row| row.model.to_owned()),
    STEPS.of(|row| row.steps.to_string()),
];

const MODELLED: [Column<Modelled>; 9] = [
    TOTAL.of(|row| row.response.total_ms()),
    P95.of(|row| Some(row.response.spread()?.p95_ms)),
    Axis::linear("force_n", "force N", "force on the plate when it is down, N").of(|row| Some(row.response.force_n[0])),
    Axis::linear("relaxed_n", "end N", "force on the plate at the end, N").of(|row| Some(row.response.force_n[1])),
    Axis::log(
        "error_force",
        "err force",
        "relative error of the force when the plate is down",
    )
    .of(|row| Some(row.error_force)),
    Axis::log("error_n", "err N", "error of the force when the plate is down, N").of(|row| Some(row.error_n)),
    Axis::log(
        "error_own",
        "err steps",
        "relative error of that force against four times as many steps",
    )
    .of(|row| row.error_own),
    ERROR.of(|row| Some(row.error)),
    ERROR_MM.of(|row| Some(row.error_mm)),
];

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

/// Schemes that solve every law, each with its tolerances.
const GENERAL_SCHEMES: [(&str, Scheme, &[Option<f64>]); 3] = [
    (
        "Euler, consistent",
        Scheme::Euler {
            slope: Slope::Consistent,
            corrected: false,
        },
        &[None],
    ),
    ("modified, accelerated", Scheme::MODIFIED, &TOLERANCES),
    ("full Newton", Scheme::Newton, &TOLERANCES),
];
const TOLERANCES: [Option<f64>; 2] = [Some(1e-3), Some(TOLERANCE)];

/// Models of a law of liver, from the simplest to the finest.
fn models(law: Stiffening) -> [(&'static str, Model); 4] {
    let elastic = |law: Stiffening| Model {
        law: law.into(),
        memory: None,
    };
    let viscous = |memory| Model {
        memory: Some(memory),
        ..elastic(law)
    };
    [
        ("linear", elastic(Stiffening::linear(*law.material()))),
        ("nonlinear", elastic(law)),
        ("viscoelastic, load integral", viscous(Memory::LoadIntegral)),
        ("viscoelastic, rate", viscous(Memory::Rate)),
    ]
}

/// Runs the study. `progress` receives the current task and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`Error`] if the block cannot be created or the gold standard cannot be solved.
pub(crate) fn study(options: &TissueOptions, progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<Study, Error> {
    let subject = Subject::new(options)?;
    let counts: Vec<u32> = std::iter::successors(Some(options.steps[0].max(1)), |steps| steps.checked_mul(2))
        .take_while(|steps| *steps <= options.steps[1].max(1))
        .collect();
    let laws = AnyLaw::examples(*subject.law.material())?;
    let runs = (schemes().len() + models(subject.law).len()) * counts.len() + 2;
    let total = (runs + laws.len() * (1 + GENERAL_SCHEMES.len())) as f64;
    let mut done = 0.0;
    let mut next = |step: &str| {
        progress(step, (done / total).min(1.0));
        done += 1.0;
    };
    // Laws of finite strain need small steps.
    let law_steps = options.steps[0].max(8);
    let tables = vec![
        schemes_table(&subject, &counts, &mut next)?,
        models_table(&subject, &counts, &mut next)?,
        laws_table(&subject, &laws, law_steps, &mut next)?,
    ];
    progress("done", 1.0);
    Ok(finish(options, &subject, tables))
}

/// Compares the schemes in liver.
fn schemes_table(subject: &Subject, counts: &[u32], next: &mut dyn FnMut(&str)) -> Result<Table, Error> {
    next("the gold standard");
    let [_, (_, model), ..] = models(subject.law);
    // Elastic tissue has no memory: its last state does not depend on the number of steps.
    let exact = exact(subject, model, 1, false)?;
    let mut runs = Vec::new();
    for (name, scheme) in schemes() {
        for &steps in counts {
            next(&format!("{name}, {steps} steps"));
            let response = subject.simulate(&Simulation {
                model,
                scheme,
                steps,
                hold: false,
                tolerance: TOLERANCE,
            })?;
            runs.push(Run {
                law: "knee",
                scheme: name,
                tolerance: Some(TOLERANCE),
                steps,
                error: response.error(&exact),
                error_mm: response.error_mm(&exact),
                response,
            });
        }
    }
    let goal = Goal::new("total_ms", "error_mm", SHIFT_MM)
        .choosing("scheme of tissue that stiffens")
        .beside(&["median_ms", "p95_ms", "iterations"]);
    let title = "Schemes in elastic tissue that stiffens";
    Ok(Table::of("schemes", title, &SCHEMES, &RUN, &runs)
        .flagged(&runs, |run| run.response.flag.clone())
        .against("full Newton to a hundredth of the tolerance")
        .seeking(goal))
}

/// Compares the models of liver.
fn models_table(subject: &Subject, counts: &[u32], next: &mut dyn FnMut(&str)) -> Result<Table, Error> {
    let finest_steps = 4 * counts.last().copied().unwrap_or(1);
    next("the finest model");
    let models = models(subject.law);
    let finest = exact(subject, models[models.len() - 1].1, finest_steps, true)?;
    let mut rows = Vec::new();
    for (name, model) in models {
        // The same model in fine steps tells the error of the steps from that of the model. Elastic tissue
        // has no memory, so that steps add no error.
        let fine_steps = match model.memory {
            None => None,
            Some(_) => Some(exact(subject, model, finest_steps, true)?),
        };
        for &steps in counts {
            next(&format!("{name}, {steps} steps"));
            let response = subject.simulate(&Simulation {
                model,
                scheme: Scheme::MODIFIED,
                steps,
                hold: true,
                tolerance: TOLERANCE,
            })?;
            let error_force = |exact: &Response| (response.force_n[0] / exact.force_n[0] - 1.0).abs();
            rows.push(Modelled {
                model: name,
                steps,
                error: response.error(&finest),
                error_mm: response.error_mm(&finest),
                error_force: error_force(&finest),
                error_n: (response.force_n[0] - finest.force_n[0]).abs(),
                error_own: fine_steps.as_ref().map(error_force),
                response,
            });
        }
    }
    let goal = Goal::new("total_ms", "error_n", FORCE_N)
        .choosing("model of tissue")
        .in_every(Deadline::Step, "p95_ms")
        .beside(&["p95_ms", "error_mm", "relaxed_n"]);
    let title = "Models against viscoelastic tissue in the finest steps";
    Ok(Table::of("models", title, &MODELS, &MODELLED, &rows)
        .flagged(&rows, |row| row.response.flag.clone())
        .against("viscoelastic tissue by the law of rates in four times as many steps")
        .seeking(goal))
}

/// Compares schemes and tolerances in every law.
fn laws_table(
    subject: &Subject,
    laws: &[(&'static str, AnyLaw)],
    steps: u32,
    next: &mut dyn FnMut(&str),
) -> Result<Table, Error> {
    let mut runs = Vec::new();
    for &(law, any_law) in laws {
        next(&format!("law `{law}`: the gold standard"));
        let model = Model {
            law: any_law,
            memory: None,
        };
        // A law that this block defeats is flagged; the others are measured.
        let exact = subject.simulate(&gold(model, steps, false))?;
        for (scheme, solver, tolerances) in GENERAL_SCHEMES {
            next(&format!("law `{law}`: {scheme}"));
            for &tolerance in tolerances {
                let mut response = subject.simulate(&Simulation {
                    model,
                    scheme: solver,
                    steps,
                    hold: false,
                    tolerance: tolerance.unwrap_or(TOLERANCE),
                })?;
                let unsolved = exact.flag.as_ref().map(|flag| format!("{UNSOLVED}: {flag}"));
                response.flag = response.flag.take().or(unsolved);
                runs.push(Run {
                    law,
                    scheme,
                    tolerance,
                    steps,
                    error: response.error(&exact),
                    error_mm: response.error_mm(&exact),
                    response,
                });
            }
        }
    }
    let goal = Goal::new("total_ms", "error_mm", SHIFT_MM)
        .choosing("scheme of a tissue law")
        .each(&["law"])
        .beside(&["median_ms", "p95_ms", "iterations"]);
    let title = format!("Schemes and tolerances in each law of tissue, {steps} steps");
    Ok(Table::of("laws", title, &LAWS, &RUN, &runs)
        .flagged(&runs, |run| run.response.flag.clone())
        .against("full Newton to a hundredth of the tightest tolerance, in each law")
        .seeking(goal))
}

/// Why there is nothing to compare with.
const UNSOLVED: &str = "the gold standard cannot be solved";

/// Full Newton to a hundredth of the tolerance.
fn gold(model: Model, steps: u32, hold: bool) -> Simulation {
    Simulation {
        model,
        scheme: Scheme::Newton,
        // An elastic body is path-independent; large steps may not converge.
        steps: if hold { steps } else { steps.max(8) },
        hold,
        tolerance: 1e-2 * TOLERANCE,
    }
}

/// Solves the gold standard.
fn exact(subject: &Subject, model: Model, steps: u32, hold: bool) -> Result<Response, Error> {
    let response = subject.simulate(&gold(model, steps, hold))?;
    match response.flag {
        Some(flag) => Err(StudyError::refused(format!("{UNSOLVED}: {flag}"))),
        None => Ok(response),
    }
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
        title: ENTRY.about.title,
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
            Figure {
                marker: vec!["scheme", "tolerance"],
                ..figure(
                    "laws",
                    "Laws: time against error",
                    "laws",
                    "total_ms",
                    "error_mm",
                    "law",
                )
            },
        ],
        tables,
        notes: Vec::new(),
    }
}
