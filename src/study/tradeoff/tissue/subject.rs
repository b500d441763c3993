//! Block of liver under a plate, and the simulation of its load history.

use std::sync::Arc;
use std::time::Instant;

use super::TissueOptions;
use insonify::Error;
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
    stiffening: Arc<Solid>,
    linear: Arc<Solid>,
    supports: Supports<3>,
    /// Final displacement of each prescribed degree of freedom, mm.
    depth: Vec<f64>,
    options: TissueOptions,
}

/// Tissue model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Model {
    Linear,
    Nonlinear,
    Viscous(Memory),
}

/// Variant of the simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Variant {
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
pub(crate) struct Walked {
    /// Time of each step, ms.
    pub times_ms: Vec<f64>,
    pub iterations: usize,
    pub factorisations: usize,
    /// Final displacements, mm.
    pub displacement: Vec<f64>,
    /// Force on the plate at the end of loading and at the end of the simulation, N.
    pub force_n: [f64; 2],
    /// Step that could not be solved, with its error.
    pub flag: Option<String>,
}

impl Subject {
    pub(super) fn new(options: &TissueOptions) -> Result<Subject, Error> {
        let mesh = TetMesh::over_box([0.0; 3], EXTENT_MM, options.nodes)?;
        let material = Material::new(options.young_kpa, options.poisson)?;
        let law = Stiffening::new(material, options.knee_strain, options.stiffening)?;
        let elements = mesh.elements().len();
        let body = |law| Solid::tetrahedra(&mesh, &vec![law; elements]).map(Arc::new);
        let [x, y, top] = EXTENT_MM;
        let plate =
            |p: &[f64; 3]| p[2] == top && (p[0] - x / 2.0).abs() <= x / 6.0 && (p[1] - y / 2.0).abs() <= y / 4.0;
        let mut held = Vec::new();
        let mut pressed = vec![0.0; 3 * mesh.nodes().len()];
        for (node, p) in (0u32..).zip(mesh.nodes()) {
            if p[2] == 0.0 {
                held.extend((0..3u8).map(|axis| (node, axis)));
            } else if plate(p) {
                held.push((node, 2));
                pressed[3 * node as usize + 2] = -options.depth_mm;
            }
        }
        let supports = Supports::new(mesh.nodes().len(), held);
        let depth: Vec<f64> = supports.prescribed().iter().map(|dof| pressed[*dof as usize]).collect();
        Ok(Subject {
            stiffening: body(law)?,
            linear: body(Stiffening::linear(material))?,
            supports,
            depth,
            options: *options,
        })
    }

    /// Returns the numbers of nodes, elements and free degrees of freedom.
    pub(super) fn sizes(&self) -> [usize; 3] {
        [
            self.linear.nodes().len(),
            self.linear.elements().len(),
            self.supports.free().len(),
        ]
    }

    /// Simulates the history. A step that cannot be solved is flagged in the result and is not an error.
    pub(super) fn walk(&self, variant: &Variant) -> Result<Walked, Error> {
        let body = if variant.model == Model::Linear {
            &self.linear
        } else {
            &self.stiffening
        };
        let options = SolverOptions {
            scheme: variant.scheme,
            tolerance: variant.tolerance,
            iterations: 200,
        };
        let solver = Solver::new(Arc::clone(body), self.supports.clone(), options)?;
        let loads = vec![0.0; self.supports.all()];
        let mut structure = match variant.model {
            Model::Linear | Model::Nonlinear => Structure::Elastic(Box::new(solver)),
            Model::Viscous(memory) => {
                let creep = Creep::new(solver, memory, self.options.order, Rule::Trapezoid, &loads)?;
                Structure::Viscous(Box::new(creep))
            }
        };
        let mut walked = Walked::default();
        let step_s = 0.5 * SECONDS / f64::from(variant.steps);
        let steps = if variant.hold { 2 * variant.steps } else { variant.steps };
        for step in 1..=steps {
            let share = (f64::from(step) / f64::from(variant.steps)).min(1.0);
            let held: Vec<f64> = self.depth.iter().map(|depth| share * depth).collect();
            let started = Instant::now();
            match structure.step(step_s, &loads, &held, None) {
                Ok(progress) => {
                    walked.iterations += progress.iterations;
                    walked.factorisations += progress.factorisations;
                }
                Err(error) => {
                    walked.flag = Some(format!("step {step}: {error}"));
                    break;
                }
            }
            walked.times_ms.push(1e3 * started.elapsed().as_secs_f64());
            if step == variant.steps {
                walked.force_n[0] = self.force(&structure);
            }
        }
        walked.force_n[1] = self.force(&structure);
        walked.displacement = structure.displacement().to_vec();
        Ok(walked)
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
