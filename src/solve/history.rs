//! Time stepping of problems with a history.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;

use super::{Fields, Solved};
use crate::input::statics::Problem;
use crate::input::statics::course::{Model, Moment};
use insonify_base::blame::Blame;
use insonify_base::document::InputError;
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::nonlinear::creep::Creep;
use insonify_mechanics::tissue::nonlinear::{
    NonlinearBody, NonlinearError, Progress, Solid, Solver, Structure, Supports,
};
use insonify_mechanics::tissue::problem::{Reaction, Seconds, Solution};
use insonify_mechanics::tissue::viscoelastic::HistoryError;

/// Course of a solution over time: one entry per moment, starting with the initial state.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct History {
    /// Times, s.
    pub time_s: Vec<f64>,
    /// Displacements of the requested nodes, in that order, mm.
    pub displacement_mm: Vec<Vec<[f64; 3]>>,
    /// Total reaction force of each `[[fix]]` on the mesh, N.
    pub reaction_n: Vec<Vec<[f64; 3]>>,
    /// Iterations of the step that ends at each moment.
    pub iterations: Vec<usize>,
    /// Factorisations of the step that ends at each moment.
    pub factorisations: Vec<usize>,
    /// Largest residual force over the largest force.
    pub residual: Vec<f64>,
}

impl History {
    /// CSV table: one row per moment, with the displacements of `report_nodes` and the reaction forces of the
    /// fixes.
    pub fn csv(&self, report_nodes: &[u32]) -> String {
        let axes = |name: String, unit: &str| ["x", "y", "z"].map(|axis| format!(",{name}_{axis}_{unit}")).concat();
        let fixes = self.reaction_n.first().map_or(0, Vec::len);
        let mut text = "time_s,iterations,factorisations,residual".to_owned();
        text.extend(report_nodes.iter().map(|node| axes(format!("node{node}"), "mm")));
        text.extend((0..fixes).map(|fix| axes(format!("fix{fix}"), "n")));
        text.push('\n');
        for (index, time_s) in self.time_s.iter().enumerate() {
            text += &format!(
                "{time_s},{},{},{:e}",
                self.iterations[index], self.factorisations[index], self.residual[index]
            );
            let vectors = self.displacement_mm[index].iter().chain(&self.reaction_n[index]);
            text.extend(vectors.flatten().map(|value| format!(",{value}")));
            text.push('\n');
        }
        text
    }
}

impl Problem {
    /// Solves a problem with a history; returns the final state and the course up to it.
    ///
    /// # Errors
    /// [`InputError`] with the offending key and the time reached.
    pub fn run(&self, fields: bool) -> Result<Solved, InputError> {
        let started = Instant::now();
        // The linear problem at full load detects every error except those of the history.
        let linear = self.linear()?;
        let course = self.file.course();
        let moments = course.moments();
        self.check_held()?;
        let check = started.elapsed().as_secs_f64();
        let body = Arc::new(self.body()?);
        let supports = Supports::new(
            self.mesh.nodes().len(),
            self.fixes.iter().map(|fix| (fix.node, fix.axis)),
        );
        let assembled = started.elapsed().as_secs_f64();
        let prescription = Prescription {
            problem: self,
            supports: supports.clone(),
        };
        let (loads, prescribed) = prescription.at(&moments[0]);
        let at_start = |error: NonlinearError| self.fault_at(0.0, error);
        let options = self.file.solver.unwrap_or_default().options();
        let solver = Solver::new(Arc::clone(&body), supports, options).map_err(&at_start)?;
        let factored = started.elapsed().as_secs_f64();
        let mut history = History::default();
        let mut runner = self.start(solver, &moments, [&loads, &prescribed], fields, &mut history)?;
        let mut loads = loads;
        for pair in moments.windows(2) {
            let time_s = pair[1].time_s;
            let (now, prescribed) = prescription.at(&pair[1]);
            let progress = runner.step(time_s - pair[0].time_s, &now, &prescribed, None);
            let progress = progress.map_err(|error| self.fault_at(time_s, error))?.clone();
            self.note(&mut history, &runner, time_s, &now, &progress);
            loads = now;
        }
        let nodes = runner.displacement().chunks_exact(3).map(|u| [u[0], u[1], u[2]]);
        let force = |reaction: &Reaction| {
            let dof = 3 * reaction.node as usize + reaction.axis as usize;
            Reaction {
                force_n: runner.forces()[dof] - loads[dof],
                ..*reaction
            }
        };
        let solution = Solution {
            displacement_mm: nodes.collect(),
            residual: history.residual.last().copied().unwrap_or(0.0),
            reactions: linear.reactions.iter().map(force).collect(),
            seconds: Seconds {
                check,
                assembly: assembled - check,
                factor: factored - assembled,
                solve: started.elapsed().as_secs_f64() - factored,
            },
        };
        let displacement = runner.displacement();
        let fields = fields.then(|| match &runner {
            Structure::Elastic(_) => Fields::of(&body, displacement, displacement),
            Structure::Viscous(creep) => Fields::with(&body, displacement, creep.stress_kpa().unwrap_or_default()),
        });
        Ok(Solved {
            solution,
            fields,
            history: Some(history),
        })
    }

    /// State at the start of a history, which receives it.
    fn start(
        &self,
        solver: Solver<3, 4>,
        moments: &[Moment],
        [loads, prescribed]: [&[f64]; 2],
        fields: bool,
        history: &mut History,
    ) -> Result<Structure<3, 4>, InputError> {
        let at_start = |error: NonlinearError| self.fault_at(0.0, error);
        let (runner, progress) = match self.file.model {
            Model::Viscoelastic => {
                let viscosity = self.file.viscosity.unwrap_or_default();
                let (memory, rule) = (viscosity.memory, viscosity.rule(moments));
                let mut creep = Creep::new(solver, memory, viscosity.order, rule, loads).map_err(at_start)?;
                if fields {
                    creep.follow_stress(viscosity.order, rule).map_err(at_start)?;
                }
                (Structure::Viscous(Box::new(creep)), Progress::default())
            }
            Model::Linear | Model::Nonlinear => {
                let mut runner = Structure::Elastic(Box::new(solver));
                let progress = runner.step(0.0, loads, prescribed, None).map_err(at_start)?.clone();
                (runner, progress)
            }
        };
        self.note(history, &runner, 0.0, loads, &progress);
        Ok(runner)
    }

    /// Body of the mesh, with the constitutive laws of its regions.
    pub fn body(&self) -> Result<Solid, InputError> {
        // Every region has a material.
        let laws = self
            .mesh
            .regions()
            .iter()
            .filter_map(|region| self.materials.get(region));
        let laws: Vec<_> = laws.map(|material| material.law).collect();
        NonlinearBody::tetrahedra(&self.mesh, &laws).map_err(|error| self.file.fault("mesh", error))
    }

    /// Checks that displacements prescribed by several tables agree at all times, and start at 0 for viscous
    /// tissue.
    fn check_held(&self) -> Result<(), InputError> {
        let course = self.file.course();
        let mut displacements_mm: BTreeMap<(u32, u8), Vec<f64>> = BTreeMap::new();
        for (fix, &table) in self.fixes.iter().zip(&self.tables) {
            let factors = self.file.fix[table].factor.as_ref().unwrap_or(&course.factor);
            let values: Vec<f64> = factors.iter().map(|factor| factor * fix.displacement_mm).collect();
            if self.file.model == Model::Viscoelastic && values[0] != 0.0 {
                let found = format!("a displacement of {} mm at the start", values[0]);
                let expected = "0 at the start: a jump would need infinite force in viscous tissue; use a short ramp";
                return Err(self.file.wrong_keys(format!("fix[{table}]"), found, expected));
            }
            let first_mm = displacements_mm
                .entry((fix.node, fix.axis))
                .or_insert_with(|| values.clone());
            if let Some((first, other)) = first_mm.iter().zip(&values).find(|(a, b)| a != b) {
                let error = LinearError::Contradiction {
                    node: fix.node,
                    axis: fix.axis,
                    displacements_mm: [*first, *other],
                };
                return Err(self.file.fault(format!("fix[{table}]"), error));
            }
        }
        Ok(())
    }

    fn note(&self, history: &mut History, runner: &Structure<3, 4>, time_s: f64, loads: &[f64], progress: &Progress) {
        let vector = |node: &u32| {
            let first_dof = 3 * *node as usize;
            std::array::from_fn(|axis| runner.displacement()[first_dof + axis])
        };
        let force = |node: u32, axis: u8| {
            let dof = 3 * node as usize + axis as usize;
            runner.forces()[dof] - loads[dof]
        };
        history.time_s.push(time_s);
        history
            .displacement_mm
            .push(self.report_nodes.iter().map(vector).collect());
        history.reaction_n.push(self.held_by(force));
        history.iterations.push(progress.iterations);
        history.factorisations.push(progress.factorisations);
        history.residual.push(progress.residual());
    }

    fn fault_at(&self, time_s: f64, cause: NonlinearError) -> InputError {
        let key = match &cause {
            NonlinearError::History(HistoryError::Order { .. }) => "viscosity.order",
            NonlinearError::History(HistoryError::Uneven { .. }) => "viscosity.rule",
            NonlinearError::History(_) | NonlinearError::Displaced => "history",
            _ if self.file.solver.is_some() => "solver",
            _ if self.file.history.is_some() => "history.step_s",
            _ => "model",
        };
        self.file.fault(key, StepFailed { time_s, cause })
    }
}

/// A step of a history that failed.
#[derive(Debug, thiserror::Error)]
#[error("at {time_s} s: {cause}")]
struct StepFailed {
    /// The end of the step, s.
    time_s: f64,
    cause: NonlinearError,
}

impl Blame for StepFailed {
    fn is_machine(&self) -> bool {
        self.cause.is_machine()
    }
}

/// Loads and prescribed displacements over time.
struct Prescription<'a> {
    problem: &'a Problem,
    supports: Supports<3>,
}

impl Prescription<'_> {
    fn at(&self, moment: &Moment) -> (Vec<f64>, Vec<f64>) {
        let Problem {
            file,
            fixes,
            tables,
            loads,
            ..
        } = self.problem;
        let course = file.course();
        let factor = |of_table: Option<&Vec<f64>>| moment.factor(of_table.unwrap_or(&course.factor));
        let mut forces = vec![0.0; self.supports.all()];
        for applied in &loads.forces {
            let factor = factor(applied.table.and_then(|table| file.load[table].factor.as_ref()));
            for (axis, force) in applied.load.force_n.iter().enumerate() {
                forces[3 * applied.load.node as usize + axis] += factor * force;
            }
        }
        let mut places = vec![0.0; self.supports.all()];
        for (fix, &table) in fixes.iter().zip(tables) {
            places[3 * fix.node as usize + fix.axis as usize] =
                factor(file.fix[table].factor.as_ref()) * fix.displacement_mm;
        }
        let prescribed = self
            .supports
            .prescribed()
            .iter()
            .map(|dof| places[*dof as usize])
            .collect();
        (forces, prescribed)
    }
}
