//! Setup of an insertion into stiffening tissue.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::{Frame, Nonlinear};
use crate::insertion::pushing::Pushing;
use crate::insertion::{Anatomy, Interaction, InvalidSetup, MeshRegions, Outcome, validation};
use crate::needle::{CentreLine, Shaft};
use crate::tissue::law::AnyLaw;
use crate::tissue::nonlinear::creep::{Creep, Memory};
use crate::tissue::nonlinear::{NonlinearBody, Scheme, Sheet, Solid, Solver, SolverOptions, Structure, Supports};
use crate::tissue::viscoelastic::{Rule, Span};
use insonify_base::range::OutOfRange;
use insonify_mesh::TetMesh;

/// Options for the subdivision and solution of steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonlinearOptions {
    /// Solver of an increment. Default: modified Newton-Raphson to 1e-6 of the largest force, in 400 iterations at
    /// most.
    pub solving: SolverOptions,
    /// Maximum advance of the tip through tissue in one substep, mm (above 0). Default 0.5.
    pub part_mm: f64,
    /// Maximum number of substeps (1 or more); for longer motions each substep is longer. Default 1000.
    pub most_parts: usize,
    /// Bound of the relative error of a viscous body's memory (1e-13 to 1e-2). Default 1e-6.
    pub memory_tolerance: f64,
    /// Shortest substep and longest time that a viscous body remembers, s. Default 1e-6 and 1e5.
    pub memory_s: [f64; 2],
}

impl Default for NonlinearOptions {
    fn default() -> Self {
        NonlinearOptions {
            solving: SolverOptions {
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

impl NonlinearOptions {
    /// Returns all options as text: part of the identity of saved states, so it must not change.
    fn fingerprint(&self) -> String {
        let NonlinearOptions {
            solving,
            part_mm,
            most_parts,
            memory_tolerance,
            memory_s,
        } = self;
        let SolverOptions {
            scheme,
            tolerance,
            iterations,
        } = solving;
        format!(
            "Options {{ solving: Options {{ scheme: {scheme:?}, tolerance: {tolerance:?}, iterations: {iterations} }}, part_mm: \
             {part_mm:?}, most_parts: {most_parts}, memory_tolerance: {memory_tolerance:?}, memory_s: {memory_s:?} }}"
        )
    }
}

/// Fractional viscosity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viscosity {
    /// Order of the fractional derivative, from 0 (elastic) to 1 (viscous). Moduli are then in kPa s^order.
    pub order: f64,
    /// Method for the memory of the tissue.
    pub memory: Memory,
}

/// Tissue and needle.
#[derive(Clone, Debug)]
pub struct NonlinearSetup {
    /// The tissue at rest, mm.
    pub mesh: Arc<TetMesh>,
    /// Material law of each element.
    pub laws: Vec<AnyLaw>,
    /// Nodes and axes (0 to 2) that are fixed.
    pub fixed: Vec<(u32, u8)>,
    /// Interactions of the regions of the mesh with the needle; those not listed exert no force. Bone is not met.
    pub interactions: Vec<(i32, Interaction)>,
    /// Regions met by the needle, in place of those of the mesh; `interactions` are checked all the same.
    pub anatomy: Option<Arc<dyn Anatomy>>,
    /// The needle, which is rigid.
    pub shaft: Shaft,
    /// Radius of the patch of tissue that bears the force at the tip, mm (0 or more; 0: a point).
    pub patch_mm: f64,
    /// Viscosity of all tissue; `None` for elastic tissue.
    pub viscosity: Option<Viscosity>,
    /// Whether the stress of viscous tissue is followed: see
    /// [`Model::stress_kpa`](crate::insertion::Model::stress_kpa).
    pub stress: bool,
    /// Options for the subdivision and solution of steps.
    pub options: NonlinearOptions,
}

/// Tissue in a plane: a sheet in plane strain.
#[derive(Clone, Debug)]
pub struct Plane {
    /// Origin of the coordinates of the sheet in the world, mm.
    pub origin: Point3<f64>,
    /// Axes of the sheet in the world, of unit length and square to each other.
    pub axes: [Vector3<f64>; 2],
    /// Triangles, with their thickness. The mesh of the [`NonlinearSetup`] is a slab with each node on both faces, all
    /// nodes of the first face before those of the other; `laws` are those of the triangles, and `fixed` has nodes of
    /// the sheet and its two axes.
    pub sheet: Arc<Sheet>,
}

impl Nonlinear {
    /// Builds a model at rest, with no needle near.
    ///
    /// # Errors
    /// [`InvalidSetup`].
    pub fn new(setup: NonlinearSetup) -> Result<Nonlinear, InvalidSetup> {
        validation::fixed(&setup.fixed, setup.mesh.nodes().len())?;
        let body = Arc::new(Solid::tetrahedra(&setup.mesh, &setup.laws)?);
        Self::of(setup, body, Frame::world())
    }
}

impl Nonlinear<2, 3> {
    /// Builds a model of a plane at rest, with no needle near.
    ///
    /// # Errors
    /// [`InvalidSetup`].
    pub fn of_plane(setup: NonlinearSetup, plane: &Plane) -> Result<Self, InvalidSetup> {
        let frame = Frame {
            origin: plane.origin,
            axes: plane.axes,
        };
        Self::of(setup, Arc::clone(&plane.sheet), frame)
    }
}

impl<const D: usize, const N: usize> Nonlinear<D, N> {
    fn of(setup: NonlinearSetup, body: Arc<NonlinearBody<D, N>>, frame: Frame<D>) -> Result<Self, InvalidSetup> {
        let options = setup.options;
        let nodes = body.nodes().len();
        validation::interactions(&setup.mesh, &setup.interactions)?;
        setup.shaft.check()?;
        validation::size(&setup.mesh, setup.shaft.radius_mm)?;
        if !(setup.patch_mm.is_finite() && setup.patch_mm >= 0.0) {
            return Err(OutOfRange::new("patch_mm", setup.patch_mm, "a finite number, 0 or more").into());
        }
        validation::above_zero(&[
            ("part_mm", options.part_mm),
            ("most_parts", options.most_parts as f64),
            ("tolerance", options.solving.tolerance),
        ])?;
        // A saved state is taken back only by a model of this name: everything that the state depends on is in it.
        let name = format!(
            "{nodes} nodes, {:?}, patch {:?} mm, {:?}, {}",
            setup.shaft,
            setup.patch_mm,
            setup.viscosity,
            options.fingerprint()
        );
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
                let rule = Rule::Exponentials(span);
                let mut creep = Creep::new(solver, memory, order, rule, &loads)?;
                if setup.stress {
                    creep.follow_stress(order, rule)?;
                }
                Structure::Viscous(Box::new(creep))
            }
        };
        Ok(Nonlinear {
            anatomy: match setup.anatomy {
                Some(anatomy) => anatomy,
                None => Arc::new(MeshRegions::new(&setup.mesh, &setup.interactions)?),
            },
            mesh: setup.mesh,
            frame,
            shaft: setup.shaft,
            options,
            name,
            needle: Pushing::away(structure, setup.patch_mm),
            axis: None,
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
