//! Stiffening and viscoelastic tissue: its tables, and the features that it excludes.

use nalgebra::{Point3, Unit, Vector3};

use super::file::ScenarioFile;
use super::instruments::NeedleModel;
use super::needle::NeedleSettings;
use super::tissue::TissueModel;
use crate::input::statics::SchemeName;
use insonify_base::document::InputError;
use insonify_base::range::parameters;
use insonify_mechanics::insertion::nonlinear::{Options, Viscosity, in_body, obstacle};
use insonify_mechanics::insertion::{Anatomy, InvalidSetup};
use insonify_mechanics::tissue::law::AnyLaw;
use insonify_mechanics::tissue::nonlinear::creep::Memory;
use insonify_mechanics::tissue::nonlinear::{Options as SolverOptions, Scheme, Solid};
use insonify_mesh::TetMesh;
use insonify_tracking::trajectory::{Key, Trajectory};

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

/// Stiffening tissue.
#[derive(Clone, Debug, PartialEq)]
pub struct Stiffened {
    /// Constitutive law of each element.
    pub laws: Vec<AnyLaw>,
    /// Viscosity of a viscoelastic model.
    pub viscosity: Option<Viscosity>,
    /// Whether the stress of viscous tissue is followed.
    pub stress: bool,
    /// Substep and solver options.
    pub options: Options,
}

/// Whether the tissue of a model stiffens.
pub fn stiffens(model: TissueModel) -> bool {
    matches!(model, TissueModel::Nonlinear | TissueModel::Viscoelastic)
}

impl ScenarioFile {
    /// Returns the viscosity and solver options of stiffening tissue; unsupported features are refused.
    pub(crate) fn stiffening(&self) -> Result<Option<(Option<Viscosity>, Options)>, InputError> {
        let spec = &self.tissue;
        let (stiffens, creeps) = (stiffens(spec.model), spec.model == TissueModel::Viscoelastic);
        for (at, material) in spec.material.iter().enumerate() {
            self.of_kind(&format!("tissue.material[{at}]"), material, spec.model)?;
        }
        if !stiffens {
            return Ok(None);
        }
        self.no_others()?;
        self.in_ranges("tissue.solver", spec.solver.as_ref())?;
        self.in_ranges("tissue.viscosity", spec.viscosity.as_ref())?;
        let TissueViscositySpec { order, memory, .. } = spec.viscosity.unwrap_or_default();
        Ok(Some((creeps.then_some(Viscosity { order, memory }), self.steps())))
    }

    /// Refuses instruments that nonlinear tissue does not support.
    fn no_others(&self) -> Result<(), InputError> {
        if self.contact_probe.is_some() {
            let found = "a probe in contact with nonlinear tissue, which does not support it";
            return Err(self.wrong_keys("contact_probe", found, "`tissue.model = \"finite-element\"`"));
        }
        let Some(needle) = &self.needle else { return Ok(()) };
        if needle.model != NeedleModel::Rigid {
            let found = "a flexible needle in nonlinear tissue, which supports straight paths only";
            return Err(self.wrong_keys("needle.model", found, "`model = \"rigid\"`"));
        }
        if needle.bevel.is_some() {
            let found = "a bevel in nonlinear tissue, which supports straight paths only";
            return Err(self.wrong_keys("needle.bevel", found, "a needle without"));
        }
        Ok(())
    }

    /// Settings of a step; with viscosity, those of its memory.
    fn steps(&self) -> Options {
        let spec = self.tissue.solver.unwrap_or_default();
        let scheme = spec.scheme.map_or(Scheme::MODIFIED, Into::into);
        Options {
            solving: SolverOptions {
                scheme,
                tolerance: spec.tolerance,
                iterations: spec.iterations as usize,
            },
            part_mm: spec.part_mm,
            memory_tolerance: self.tissue.viscosity.unwrap_or_default().tolerance,
            ..Options::default()
        }
    }

    /// Refuses a path that the needle cannot follow: sideways in tissue, or into bone.
    pub(crate) fn is_straight(
        &self,
        path: &Trajectory,
        needle: &NeedleSettings,
        mesh: &TetMesh,
        laws: &[AnyLaw],
        anatomy: &dyn Anatomy,
    ) -> Result<(), InputError> {
        let body = Solid::tetrahedra(mesh, laws).map_err(|error| self.fault("tissue", InvalidSetup::Solver(error)))?;
        let place = |key: &Key| {
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
        for pair in path.keys().windows(2) {
            let [(from, before), (to, direction)] = [&pair[0], &pair[1]].map(place);
            let segment = to - from;
            let turned = needle.length_mm * (*before - *direction).norm();
            let sideways = segment.cross(&direction).norm().max(turned);
            let inside = |tip: &Point3<f64>, along: &Unit<Vector3<f64>>| in_body(&body, tip, along, needle.length_mm);
            if sideways > SIDEWAYS_MM && (inside(&from, &before) || inside(&to, &direction)) {
                let found = format!(
                    "a needle in tissue that is moved {sideways:.2} mm sideways, at {} s",
                    pair[1].time_s
                );
                let expected =
                    "motion along the needle's axis until it is out: this model does not support lateral motion";
                return Err(blame(&pair[1], found, expected));
            }
            let met = obstacle(anatomy, &from, &direction, segment.dot(&direction));
            if let Some(at_mm) = met.filter(|_| sideways <= SIDEWAYS_MM) {
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
