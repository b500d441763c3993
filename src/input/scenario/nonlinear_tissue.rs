//! Nonlinear and viscoelastic tissue of a scenario: its tables, the instruments that it excludes, and the model built
//! from it.

use std::sync::Arc;

use nalgebra::{Point3, Unit, Vector3};

use super::file::ScenarioFile;
use super::resolve::Scenario;
use super::tissue::{PATCH_MM, TissueModel};
use super::tissue_setup::{Deforming, Insertion, ResolvedTissue, TissueSetup};
use crate::input::statics::SchemeName;
use insonify_base::document::InputError;
use insonify_base::note::Notes;
use insonify_base::range::parameters;
use insonify_mechanics::insertion::nonlinear::{
    Nonlinear, NonlinearOptions, NonlinearSetup, Plane, Viscosity, in_body, obstacle,
};
use insonify_mechanics::insertion::{InvalidSetup, Model};
use insonify_mechanics::needle::NeedleModel;
use insonify_mechanics::tissue::law::AnyLaw;
use insonify_mechanics::tissue::nonlinear::creep::Memory;
use insonify_mechanics::tissue::nonlinear::{Scheme, Solid, SolverOptions};
use insonify_tracking::trajectory::Key;

/// Largest sideways motion of a needle in tissue, mm: rounding of the numbers in a file.
const SIDEWAYS_MM: f64 = 0.05;

parameters! {
    /// Solver for the steps of stiffening tissue.
    #[derive(Copy)]
    pub struct StepSolverSpec {
        /// Solution scheme. Default `modified-newton`.
        scheme: Option<SchemeName>;
        /// Convergence tolerance: largest residual force over the largest force. Euler steps have none.
        tolerance: f64 = 1e-6, above 0..1;
        /// Maximum number of iterations of each substep.
        iterations: u32 = 400, in 1..=10000;
        /// Longest path of the tip through tissue in a substep.
        part_mm: f64 = 0.5, in 0.001..=100 "mm";
    }
}

parameters! {
    /// Viscosity of fractional order, the same for all tissue.
    #[derive(Copy)]
    pub struct TissueViscositySpec {
        /// Order k of the derivative: 0 is elastic, 1 viscous, 0.1 porcine liver. Moduli are in kPa s^k.
        order: f64 = 0.1, in 0..=1;
        /// Memory variable. Default `load-integral`, that of Kobayashi et al. 2010.
        #[serde(alias = "law")]
        memory: Memory;
        /// Bound on the relative error of the memory.
        tolerance: f64 = 1e-6, in 1e-13..=1e-2;
    }
}

/// Nonlinear tissue.
#[derive(Clone, Debug)]
pub struct NonlinearTissue {
    /// Constitutive law of each element.
    pub laws: Vec<AnyLaw>,
    /// Node and axis of each fixed degree of freedom, ascending.
    pub fixed: Vec<(u32, u8)>,
    /// Viscosity of a viscoelastic model.
    pub viscosity: Option<Viscosity>,
    /// Whether the stress of viscous tissue is followed.
    pub stress: bool,
    /// Radius of the patch of tissue that bears the force at the tip, mm.
    pub patch_mm: f64,
    /// Substep and solver options.
    pub options: NonlinearOptions,
}

impl NonlinearTissue {
    /// Builds the model, of a solid or of a plane.
    pub(super) fn model(&self, scenario: &Scenario, plane: Option<&Plane>) -> Result<Box<dyn Model>, InputError> {
        let setup = NonlinearSetup {
            mesh: Arc::clone(&scenario.mesh),
            laws: self.laws.clone(),
            fixed: self.fixed.clone(),
            interactions: scenario.interactions.clone(),
            anatomy: Some(Arc::clone(&scenario.anatomy)),
            shaft: scenario.needle.shaft(),
            viscosity: self.viscosity,
            stress: self.stress,
            patch_mm: self.patch_mm,
            options: self.options,
        };
        let fault = |error: InvalidSetup| scenario.file.fault("tissue", error);
        Ok(match plane {
            Some(plane) => Box::new(Nonlinear::of_plane(setup, plane).map_err(fault)?),
            None => Box::new(Nonlinear::new(setup).map_err(fault)?),
        })
    }
}

impl ScenarioFile {
    /// Reads or makes the mesh of nonlinear tissue, through which the needle goes straight.
    pub(crate) fn nonlinear_tissue(
        &self,
        insertion: &Insertion<'_>,
        progress: &mut dyn FnMut(f32),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<ResolvedTissue, InputError> {
        let meshed = self.deforming(insertion, progress, notes, warnings)?;
        let laws = meshed.of_elements(|region| region.law);
        let TissueViscositySpec { order, memory, .. } = self.tissue.viscosity.unwrap_or_default();
        let creeps = self.tissue.model == TissueModel::Viscoelastic;
        self.check_straight(insertion, &meshed, &laws)?;
        let tissue = NonlinearTissue {
            laws,
            fixed: meshed.fixed.clone(),
            viscosity: creeps.then_some(Viscosity { order, memory }),
            stress: false,
            patch_mm: self.tissue.patch_mm.unwrap_or(PATCH_MM),
            options: self.solver_options(),
        };
        Ok(meshed.modelled(TissueSetup::Nonlinear(tissue)))
    }

    /// Refuses needles that nonlinear tissue does not support, and checks its tables.
    pub(crate) fn check_nonlinear(&self) -> Result<(), InputError> {
        if !self.needle_settings()?.is_straight() {
            let is_rigid = self.needle_table()?.model == NeedleModel::Rigid;
            let (key, what, expected) = if is_rigid {
                ("bevel", "a bevel", "a needle without")
            } else {
                ("model", "a flexible needle", "`model = \"rigid\"`")
            };
            let found = format!("{what} in nonlinear tissue, which supports straight paths only");
            return Err(self.wrong_keys(format!("needle.{key}"), found, expected));
        }
        self.in_ranges("tissue.solver", self.tissue.solver.as_ref())?;
        self.in_ranges("tissue.viscosity", self.tissue.viscosity.as_ref())
    }

    /// Settings of a step; with viscosity, those of its memory.
    fn solver_options(&self) -> NonlinearOptions {
        let spec = self.tissue.solver.unwrap_or_default();
        let scheme = spec.scheme.map_or(Scheme::MODIFIED, Into::into);
        NonlinearOptions {
            solving: SolverOptions {
                scheme,
                tolerance: spec.tolerance,
                iterations: spec.iterations as usize,
            },
            part_mm: spec.part_mm,
            memory_tolerance: self.tissue.viscosity.unwrap_or_default().tolerance,
            ..NonlinearOptions::default()
        }
    }

    /// Refuses a path that the needle cannot follow: sideways in tissue, or into bone.
    fn check_straight(&self, insertion: &Insertion<'_>, meshed: &Deforming, laws: &[AnyLaw]) -> Result<(), InputError> {
        let (needle, anatomy) = (insertion.needle, meshed.anatomy.as_ref());
        let body = Solid::tetrahedra(&meshed.mesh, laws);
        let body = body.map_err(|error| self.fault("tissue", InvalidSetup::Solver(error)))?;
        let tip_and_direction = |key: &Key| {
            let base = needle.base(&key.pose);
            (
                base * Point3::new(0.0, 0.0, needle.length_mm),
                base.rotation * Vector3::z_axis(),
            )
        };
        let blame = |key: &Key, found: String, expected: &str| {
            let written = self.needle.as_ref().and_then(|table| table.motion.as_ref());
            let key = match written.is_some_and(|motion| motion.keyframes.is_some()) {
                true => format!("needle.motion.keyframes[{}]", key.source),
                false if self.plan.as_ref().is_some_and(|plan| !plan.needle.is_empty()) => "plan.needle".to_owned(),
                false => "needle.motion".to_owned(),
            };
            self.wrong_keys(key, found, expected)
        };
        for pair in insertion.path.keys().windows(2) {
            let [(start, before), (end, direction)] = [&pair[0], &pair[1]].map(tip_and_direction);
            let segment = end - start;
            // A turn about the tip leaves the tip in place, and sweeps the other end along this chord.
            let turned = needle.length_mm * (*before - *direction).norm();
            let sideways = segment.cross(&direction).norm().max(turned);
            let inside = |tip: &Point3<f64>, along: &Unit<Vector3<f64>>| in_body(&body, tip, along, needle.length_mm);
            if sideways > SIDEWAYS_MM && (inside(&start, &before) || inside(&end, &direction)) {
                let found = format!(
                    "a needle in tissue that is moved {sideways:.2} mm sideways, at {} s",
                    pair[1].time_s
                );
                let expected =
                    "motion along the needle's axis until it is out: this model does not support lateral motion";
                return Err(blame(&pair[1], found, expected));
            }
            let obstacle_mm = obstacle(anatomy, &start, &direction, segment.dot(&direction));
            if let Some(at_mm) = obstacle_mm.filter(|_| sideways <= SIDEWAYS_MM) {
                let found = format!(
                    "a needle that meets bone {at_mm:.1} mm on its way, by {} s",
                    pair[1].time_s
                );
                return Err(blame(
                    &pair[1],
                    found,
                    "a path through soft tissue: this model does not support bone",
                ));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
