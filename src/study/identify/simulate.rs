//! Insertions simulated with given parameters of the layers: force over depth, and displacements of measured points.

use std::sync::Arc;

use nalgebra::Point3;
use serde::Serialize;

use super::data::MeasuredMotion;
use crate::identification::IdentificationCase;
use insonify::Error;
use insonify::input::scenario::{Scenario, TissueSetup};
use insonify_mechanics::insertion::{Anatomy, Instruments, Interaction, Peak, Snapshot, Tissue};
use insonify_mechanics::tissue::assembly::Stiffness;
use insonify_mechanics::tissue::dofs::Dofs;
use insonify_mechanics::tissue::law::{AnyLaw, LawSpec};
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::nonlinear::{Solid, Solver, SolverOptions, Supports, Target};
use insonify_mesh::{Locator, NO_ELEMENT, TetMesh};

/// Longest step of the needle, mm.
const STEP_MM: f64 = 0.1;
/// Way of the tip to the tissue before the first step, mm.
const OUTSIDE_MM: f64 = 1.0;

/// Residual force in tissue of another law, as a share of the largest.
const FORCE_TOLERANCE: f64 = 1e-6;

/// Parameters of a layer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LayerParameters {
    /// Number of the region.
    #[serde(skip)]
    pub region: i32,
    /// Name of the region.
    pub region_name: String,
    /// Young's modulus, kPa.
    pub young_kpa: f64,
    /// Whether the modulus was known.
    pub young_known: bool,
    /// Poisson's ratio.
    pub poisson: f64,
    /// Force density near the tip, f_p, N/mm.
    pub peak_n_per_mm: f64,
    /// Force density behind that, f_s, N/mm.
    pub shaft_n_per_mm: f64,
    /// Length from the tip over which the peak acts, w, mm.
    pub width_mm: f64,
}

/// A simulated insertion.
#[derive(Clone, Debug, Default)]
pub(super) struct SimulatedInsertion {
    /// Depth of the tip (mm) and force (N).
    pub force: Vec<[f64; 2]>,
    /// Displacements as those measured, mm; empty if they were not asked for.
    pub moved_mm: Vec<Vec<f64>>,
    /// Steps that did not converge, and shapes of tissue that were not found.
    pub unsettled: usize,
}

/// The anatomy of a scenario with other interactions in some regions.
#[derive(Debug)]
struct ReplacedInteractions {
    anatomy: Arc<dyn Anatomy>,
    interactions: Vec<(i32, Interaction)>,
}

impl Anatomy for ReplacedInteractions {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        self.anatomy.region(at_rest_mm)
    }

    fn interaction(&self, region: i32) -> Interaction {
        let replacement = self.interactions.iter().find(|(changed, _)| *changed == region);
        replacement.map_or_else(|| self.anatomy.interaction(region), |(_, replacement)| *replacement)
    }
}

/// Simulates insertions along the line of a case.
pub(super) struct Simulator<'a> {
    case: &'a IdentificationCase,
    motion: Option<&'a MeasuredMotion>,
    scenario: Scenario,
    /// Depths of the tip (mm), with the measured depth there, if any.
    stops: Vec<(f64, Option<usize>)>,
    locator: Locator<f64>,
    /// Number of simulations so far.
    pub runs: usize,
}

impl<'a> Simulator<'a> {
    /// Prepares simulations to a depth (mm).
    pub(super) fn new(case: &'a IdentificationCase, motion: Option<&'a MeasuredMotion>, deepest_mm: f64) -> Self {
        let depths = motion
            .iter()
            .flat_map(|motion| motion.depths_mm.iter().copied().enumerate());
        let mut stops: Vec<(f64, Option<usize>)> = depths.map(|(index, depth)| (depth, Some(index))).collect();
        let steps = (deepest_mm / STEP_MM).ceil() as usize;
        stops.extend((1..=steps).map(|step| (deepest_mm * step as f64 / steps as f64, None)));
        stops.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self {
            case,
            motion,
            scenario: case.scenario.clone(),
            stops,
            locator: Locator::new(&case.scenario.mesh),
            runs: 0,
        }
    }

    /// Pushes the needle in; displacements are computed if `observed`.
    ///
    /// # Errors
    /// [`Error`] for parameters out of range.
    pub(super) fn run(&mut self, layers: &[LayerParameters], observed: bool) -> Result<SimulatedInsertion, Error> {
        self.runs += 1;
        self.set(layers)?;
        let mut model = self.scenario.unprepared_model()?;
        let (case, probe) = (self.case, self.scenario.instruments(0).probe);
        let instruments = |depth: f64| Instruments {
            base: case.base_at(depth),
            probe,
            guide: None,
            deposit: false,
        };
        model.start(&instruments(-OUTSIDE_MM));
        let mut imager = model.imager();
        let (mut snapshot, mut tissue) = (Snapshot::default(), Tissue::default());
        let mut course = SimulatedInsertion::default();
        for (depth, measured) in self.stops.clone() {
            let outcome = model.step(&instruments(depth), 1.0)?;
            course.unsettled += usize::from(!outcome.converged);
            course
                .force
                .push([depth, -outcome.on_hand.force_n.dot(&case.direction)]);
            if measured.is_some() && observed {
                model.snapshot(&mut snapshot);
                imager.tissue(&snapshot, &mut tissue);
                if let Some(law) = &self.case.law {
                    course.unsettled += usize::from(!deform(&self.scenario, law, &mut tissue)?);
                }
                course.moved_mm.push(self.moved(&tissue)?);
            }
        }
        Ok(course)
    }

    fn set(&mut self, layers: &[LayerParameters]) -> Result<(), Error> {
        let scenario = &mut self.scenario;
        let mut interactions = Vec::new();
        for layer in layers {
            scenario.set_linear_material(layer.region, Material::new(layer.young_kpa, layer.poisson)?);
            let interaction = Interaction {
                friction_n_per_mm: layer.shaft_n_per_mm,
                peak: Some(Peak {
                    density_n_per_mm: layer.peak_n_per_mm,
                    width_mm: layer.width_mm,
                }),
                ..self.case.scenario.anatomy.interaction(layer.region)
            };
            interactions.push((layer.region, interaction));
        }
        for (region, interaction) in &mut scenario.interactions {
            if let Some((_, replacement)) = interactions.iter().find(|(changed, _)| changed == region) {
                *interaction = *replacement;
            }
        }
        scenario.anatomy = Arc::new(ReplacedInteractions {
            anatomy: Arc::clone(&self.case.scenario.anatomy),
            interactions,
        });
        Ok(())
    }

    /// Displacements of the measured points along their directions, mm.
    fn moved(&mut self, tissue: &Tissue) -> Result<Vec<f64>, Error> {
        // Points are sought in the reference state, whose nodes near the needle were moved.
        self.locator.update(&tissue.reference)?;
        let points = self.motion.iter().flat_map(|motion| &motion.points);
        let displacements = points.map(|(point, direction)| {
            let hit = self.locator.locate((*point).into(), NO_ELEMENT);
            if hit.element == NO_ELEMENT {
                return f64::NAN;
            }
            let corners = self.scenario.mesh.elements()[hit.element as usize];
            let parts = corners.iter().zip(hit.bary).map(|(node, share)| {
                let [rest_mm, moved_mm] =
                    [&tissue.reference, &tissue.current].map(|nodes| Point3::from(nodes[*node as usize]));
                share * (moved_mm - rest_mm).dot(direction)
            });
            parts.sum()
        });
        Ok(displacements.collect())
    }
}

/// Deforms tissue of another law by the forces under which the linear tissue has its shape. Returns whether such a shape
/// was found; otherwise it stays that of linear tissue.
fn deform(scenario: &Scenario, law: &LawSpec, tissue: &mut Tissue) -> Result<bool, Error> {
    let TissueSetup::FiniteElement(linear) = &scenario.tissue else {
        return Ok(true);
    };
    let mesh = &scenario.mesh;
    // Nodes at the needle were moved.
    let mesh = TetMesh::new(
        tissue.reference.clone(),
        mesh.elements().to_vec(),
        mesh.regions().to_vec(),
    )?;
    let pairs = tissue.reference.iter().zip(&tissue.current);
    let displacement: Vec<[f64; 3]> = pairs
        .map(|(from, to)| [0, 1, 2].map(|axis| to[axis] - from[axis]))
        .collect();
    let dofs = Dofs::new(mesh.nodes().len(), linear.fixed.iter().copied());
    let forces = Stiffness::assemble(&mesh, &linear.materials, &dofs)?.nodal_forces(&displacement);
    let laws: Vec<AnyLaw> = linear
        .materials
        .iter()
        .map(|material| law.law(*material))
        .collect::<Result<_, _>>()?;
    let body = Arc::new(Solid::tetrahedra(&mesh, &laws)?);
    let supports = Supports::new(mesh.nodes().len(), linear.fixed.iter().copied());
    let options = SolverOptions {
        tolerance: FORCE_TOLERANCE,
        ..SolverOptions::default()
    };
    let prescribed = vec![0.0; supports.prescribed().len()];
    // Large loads may need to be put on in parts.
    for parts in [1, 4, 16] {
        let mut solver = Solver::new(Arc::clone(&body), supports.clone(), options)?;
        let is_solved = (1..=parts).all(|part| {
            let share = f64::from(part) / f64::from(parts);
            let loads: Vec<f64> = forces.iter().flatten().map(|force_n| force_n * share).collect();
            let target = Target {
                loads: &loads,
                prescribed: &prescribed,
                contact: None,
                offset: None,
            };
            solver.step(&target).is_ok()
        });
        if is_solved {
            let moved = solver.displacement().chunks_exact(3);
            for ((current, from), by_mm) in tissue.current.iter_mut().zip(&tissue.reference).zip(moved) {
                *current = [0, 1, 2].map(|axis| from[axis] + by_mm[axis]);
            }
            return Ok(true);
        }
    }
    Ok(false)
}
