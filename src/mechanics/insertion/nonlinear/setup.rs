//! What an insertion into tissue that stiffens is made of.

use std::sync::Arc;

use nalgebra::Point3;

use super::Nonlinear;
use crate::mechanics::insertion::pushing::Pushing;
use crate::mechanics::insertion::{Anatomy, Interaction, InvalidPart, MeshRegions, Outcome, parts};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::needle::{CentreLine, InvalidNeedleModel, Shaft};
use crate::mechanics::tissue::nonlinear::creep::{Creep, CreepError, Memory};
use crate::mechanics::tissue::nonlinear::{
    InvalidBody, NonlinearError, Options as Solving, Scheme, Solid, Solver, Stiffening, Structure, Supports,
};
use crate::mechanics::tissue::viscoelastic::{Rule, Span};

/// How steps are cut and solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// How an increment is solved. Default: modified Newton-Raphson to 1e-6 of the largest force, in 400 iterations at most.
    pub solving: Solving,
    /// The farthest that the tip goes through tissue in one part of a step, mm (above 0). Default 0.5.
    pub part_mm: f64,
    /// The most parts of a step (1 or more); of a longer way each part is longer. Default 1000.
    pub most_parts: usize,
    /// Bound of the relative error of a viscous body's memory (1e-13 to 1e-2). Default 1e-6.
    pub memory_tolerance: f64,
    /// The shortest part of a step and the longest time that a viscous body remembers, s. Default 1e-6 and 1e5.
    pub memory_s: [f64; 2],
}

impl Default for Options {
    fn default() -> Self {
        Options {
            solving: Solving {
                scheme: Scheme::MODIFIED,
                tolerance: 1e-6,
                iterations: 400,
            },
            part_mm: 0.5,
            most_parts: 1000,
            memory_tolerance: 1e-6,
            memory_s: [1e-6, 1e5],
        }
    }
}

/// Fractional viscosity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viscosity {
    /// From 0, elastic, to 1, viscous. Moduli are then in kPa s^order.
    pub order: f64,
    /// What remembers.
    pub memory: Memory,
}

/// Tissue and needle.
#[derive(Clone, Debug)]
pub struct Setup {
    /// The tissue at rest, mm.
    pub mesh: Arc<TetMesh>,
    /// One an element.
    pub laws: Vec<Stiffening>,
    /// Nodes and axes (0 to 2) that do not move.
    pub fixed: Vec<(u32, u8)>,
    /// What the regions of the mesh do to the needle; those not named do nothing. No `peak`, and no bone is met.
    pub interactions: Vec<(i32, Interaction)>,
    /// Regions met by the needle, in place of those of the mesh; `interactions` are checked all the same.
    pub anatomy: Option<Arc<dyn Anatomy>>,
    /// The needle, which nothing bends.
    pub shaft: Shaft,
    /// Of all tissue; none where it is elastic.
    pub viscosity: Option<Viscosity>,
    /// How steps are cut and solved.
    pub options: Options,
}

/// Why there is no model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidSetup {
    /// Something that every model on a mesh is given cannot be used.
    #[error(transparent)]
    Part(#[from] InvalidPart),
    /// A region does to the needle what this model has no part for.
    #[error("region {region} has a `peak` of force near the tip, which tissue that stiffens has no part for")]
    Peak {
        /// The region.
        region: i32,
    },
    /// The needle is none.
    #[error(transparent)]
    Needle(#[from] InvalidNeedleModel),
    /// The mesh makes no body.
    #[error(transparent)]
    Body(#[from] InvalidBody),
    /// The stiffness cannot be factored.
    #[error(transparent)]
    Solver(#[from] NonlinearError),
    /// The memory is none.
    #[error(transparent)]
    Memory(#[from] CreepError),
}

impl InvalidSetup {
    /// Whether memory ran out, rather than the setup being wrong.
    pub fn is_machine(&self) -> bool {
        matches!(self, Self::Solver(error) | Self::Memory(CreepError::Nonlinear(error)) if error.is_machine())
    }
}

impl Nonlinear {
    /// A model at rest, no needle near.
    ///
    /// # Errors
    /// [`InvalidSetup`].
    pub fn new(setup: Setup) -> Result<Nonlinear, InvalidSetup> {
        let options = setup.options;
        let nodes = setup.mesh.nodes().len();
        parts::interactions(&setup.interactions)?;
        parts::fixed(&setup.fixed, nodes)?;
        parts::above_zero(&[
            ("part_mm", options.part_mm),
            ("most_parts", options.most_parts as f64),
            ("tolerance", options.solving.tolerance),
        ])?;
        setup.shaft.check()?;
        if let Some(&(region, _)) = setup.interactions.iter().find(|(_, of)| of.peak.is_some()) {
            return Err(InvalidSetup::Peak { region });
        }
        let name = format!("{nodes} nodes, {:?}, {:?}, {:?}", setup.shaft, setup.viscosity, options);
        let body = Arc::new(Solid::tetrahedra(&setup.mesh, &setup.laws)?);
        let solver = Solver::new(body, Supports::new(nodes, setup.fixed), options.solving)?;
        let structure = match setup.viscosity {
            None => Structure::Elastic(Box::new(solver)),
            Some(Viscosity { order, memory }) => {
                let [shortest_s, longest_s] = options.memory_s;
                let span = Span {
                    shortest_s,
                    longest_s,
                    tolerance: options.memory_tolerance,
                };
                let loads = vec![0.0; solver.supports().all()];
                let creep = Creep::new(solver, memory, order, Rule::Exponentials(span), &loads)?;
                Structure::Viscous(Box::new(creep))
            }
        };
        Ok(Nonlinear {
            anatomy: setup
                .anatomy
                .unwrap_or_else(|| Arc::new(MeshRegions::new(&setup.mesh, &setup.interactions))),
            mesh: setup.mesh,
            shaft: setup.shaft,
            options,
            name,
            needle: Pushing::away(structure),
            way: None,
            steps: 0,
            time_s: 0.0,
            behind_s: 0.0,
            travel_mm: 0.0,
            region: None,
            line: CentreLine::default(),
            seeds: Vec::<Point3<f64>>::new(),
            outcome: Outcome::default(),
        })
    }
}
