//! Block of liver under a plate, and the simulation of its load history.

use std::sync::Arc;
use std::time::Instant;

use super::TissueOptions;
use insonify::Error;
use insonify_base::statistics::Spread;
use insonify_mechanics::tissue::law::AnyLaw;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::nonlinear::creep::{Creep, Memory};
use insonify_mechanics::tissue::nonlinear::{Scheme, Solid, Solver, SolverOptions, Stiffening, Structure, Supports};
use insonify_mechanics::tissue::viscoelastic::Rule;
use insonify_mesh::TetMesh;

/// Edge lengths of the block, mm.
const EXTENT_MM: [f64; 3] = [60.0, 40.0, 40.0];

/// Duration of the history, s. The plate comes down in the first half and then stays.
const SECONDS: f64 = 4.0;

/// Block and its prescribed motion.
pub(super) struct Subject {
    mesh: TetMesh,
    /// Law of liver, which stiffens.
    pub law: Stiffening,
    supports: Supports<3>,
    /// Final displacement of each prescribed degree of freedom, mm.
    depth: Vec<f64>,
    /// Order of the viscosity.
    order: f64,
}

/// Model of the tissue: its law, and the form of its memory if it creeps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Model {
    pub law: AnyLaw,
    pub memory: Option<Memory>,
}

/// Simulation of the history.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Simulation {
    pub model: Model,
    pub scheme: Scheme,
    /// Number of steps until the plate is down.
    pub steps: u32,
    /// Whether the hold phase is simulated too.
    pub hold: bool,
    pub tolerance: f64,
}

/// Result of a simulation.
#[derive(Clone, Debug, Default)]
pub(super) struct Response {
    /// Time of each step, ms.
    times_ms: Vec<f64>,
    pub iterations: usize,
    pub factorisations: usize,
    /// Final displacements, mm.
    displacement: Vec<f64>,
    /// Force on the plate at the end of loading and at the end of the simulation, N.
    pub force_n: [f64; 2],
    /// Step that could not be solved, with its error.
    pub flag: Option<String>,
}

impl Response {
    pub(super) fn total_ms(&self) -> Option<f64> {
        (!self.times_ms.is_empty()).then(|| self.times_ms.iter().sum())
    }

    pub(super) fn spread(&self) -> Option<Spread> {
        Spread::of(self.times_ms.clone())
    }

    /// Largest difference of the displacements from others, mm.
    pub(super) fn error_mm(&self, exact: &Response) -> f64 {
        let pairs = self.displacement.iter().zip(&exact.displacement);
        pairs.fold(0.0, |a: f64, (x, y)| a.max((x - y).abs()))
    }

    /// Largest difference of the displacements from others, relative to the largest of those.
    pub(super) fn error(&self, exact: &Response) -> f64 {
        let largest = exact.displacement.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
        self.error_mm(exact) / largest
    }
}

impl Subject {
    pub(super) fn new(options: &TissueOptions) -> Result<Subject, Error> {
        let mesh = TetMesh::over_box([0.0; 3], EXTENT_MM, options.nodes)?;
        let material = Material::new(options.young_kpa, options.poisson)?;
        let law = Stiffening::new(material, options.knee_strain, options.stiffening)?;
        let [x, y, top] = EXTENT_MM;
        let plate =
            |p: &[f64; 3]| p[2] == top && (p[0] - x / 2.0).abs() <= x / 6.0 && (p[1] - y / 2.0).abs() <= y / 4.0;
        let mut fixed_dofs = Vec::new();
        let mut pressed = vec![0.0; 3 * mesh.nodes().len()];
        for (node, p) in (0u32..).zip(mesh.nodes()) {
            if p[2] == 0.0 {
                fixed_dofs.extend((0..3u8).map(|axis| (node, axis)));
            } else if plate(p) {
                fixed_dofs.push((node, 2));
                pressed[3 * node as usize + 2] = -options.depth_mm;
            }
        }
        let supports = Supports::new(mesh.nodes().len(), fixed_dofs);
        let depth: Vec<f64> = supports.prescribed().iter().map(|dof| pressed[*dof as usize]).collect();
        Ok(Subject {
            mesh,
            law,
            supports,
            depth,
            order: options.order,
        })
    }

    /// Returns the numbers of nodes, elements and free degrees of freedom.
    pub(super) fn sizes(&self) -> [usize; 3] {
        [
            self.mesh.nodes().len(),
            self.mesh.elements().len(),
            self.supports.free().len(),
        ]
    }

    /// Simulates the history. A step that cannot be solved is flagged in the result and is not an error.
    pub(super) fn simulate(&self, simulation: &Simulation) -> Result<Response, Error> {
        let Simulation { model, steps, .. } = *simulation;
        let laws = vec![model.law; self.mesh.elements().len()];
        let options = SolverOptions {
            scheme: simulation.scheme,
            tolerance: simulation.tolerance,
            iterations: 200,
        };
        let body = Arc::new(Solid::tetrahedra(&self.mesh, &laws)?);
        let solver = Solver::new(body, self.supports.clone(), options)?;
        let loads = vec![0.0; self.supports.all()];
        let mut structure = match model.memory {
            None => Structure::Elastic(Box::new(solver)),
            Some(memory) => {
                let creep = Creep::new(solver, memory, self.order, Rule::Trapezoid, &loads)?;
                Structure::Viscous(Box::new(creep))
            }
        };
        let mut response = Response::default();
        let step_s = 0.5 * SECONDS / f64::from(steps);
        let end = if simulation.hold { 2 * steps } else { steps };
        for step in 1..=end {
            let share = (f64::from(step) / f64::from(steps)).min(1.0);
            let prescribed_mm: Vec<f64> = self.depth.iter().map(|depth| share * depth).collect();
            let started = Instant::now();
            match structure.step(step_s, &loads, &prescribed_mm, None) {
                Ok(progress) => {
                    response.iterations += progress.iterations;
                    response.factorisations += progress.factorisations;
                }
                Err(error) => {
                    response.flag = Some(format!("step {step}: {error}"));
                    break;
                }
            }
            response.times_ms.push(1e3 * started.elapsed().as_secs_f64());
            // Viscous tissue relaxes under the resting plate from here on: this
            // is the peak, the last force is the rest.
            if step == steps {
                response.force_n[0] = self.force(&structure);
            }
        }
        response.force_n[1] = self.force(&structure);
        response.displacement = structure.displacement().to_vec();
        Ok(response)
    }

    /// Returns the force on the plate, N.
    fn force(&self, structure: &Structure<3, 4>) -> f64 {
        let driven = self
            .supports
            .prescribed()
            .iter()
            .zip(&self.depth)
            .filter(|(_, depth)| **depth != 0.0);
        -driven.map(|(dof, _)| structure.forces()[*dof as usize]).sum::<f64>()
    }
}
