//! Construction of the tissue model of a scenario.

use std::sync::Arc;

use super::needle::Bending;
use super::path_pieces;
use super::resolve::Scenario;
use super::stiffened::Stiffened;
use super::tissue::ColumnsName;
use insonify_base::document::InputError;
use insonify_base::range::OutOfRange;
use insonify_mechanics::insertion::finite::{Finite, Options, Setup};
use insonify_mechanics::insertion::spring::MassSpring;
use insonify_mechanics::insertion::{InvalidSetup, Model, nonlinear};
use insonify_mechanics::needle::{Constrained, Flexible, Needle, Rigid, Shaft, Stiffness};
#[cfg(feature = "gpu")]
use insonify_mechanics::remesh_gpu::maker;
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::remesh::{Level, RemeshError};

/// Lateral deviation allowed for a needle of 18 gauge from its path in the tissue at rest, and for tissue under a
/// probe, mm.
const ASIDE_MM: f64 = 5.0;

impl Scenario {
    /// Builds the model, with tissue at rest and no instrument near. `progress` receives completed and total work of long
    /// computations.
    ///
    /// # Errors
    /// [`InputError`] with the offending key.
    pub fn model(&self, mut progress: impl FnMut(usize, usize) + Send) -> Result<Box<dyn Model>, InputError> {
        self.built(true, &mut progress)
    }

    /// Builds the model without computing in advance what remeshing will read: for a single insertion.
    pub fn unprepared_model(&self) -> Result<Box<dyn Model>, InputError> {
        self.built(false, &mut |_, _| {})
    }

    fn built(
        &self,
        prepared: bool,
        progress: &mut (dyn FnMut(usize, usize) + Send),
    ) -> Result<Box<dyn Model>, InputError> {
        let needle = self.needle_model().map_err(|error| {
            let key = format!("needle.{}", error.key);
            self.file.fault(key, error)
        })?;
        if let Some(parameters) = self.cylinder {
            let springs = MassSpring::new(parameters, Box::new(Arc::clone(&self.anatomy)), needle);
            return Ok(Box::new(springs.map_err(|error| self.file.spring_fault(error))?));
        }
        if let Some(stiffened) = &self.stiffened {
            return self.stiffened(stiffened);
        }
        let dense = self.modelling.columns == ColumnsName::Dense;
        let setup = Setup {
            mesh: (*self.mesh).clone(),
            materials: self.materials.clone(),
            fixed: self.fixed.clone(),
            interactions: self.interactions.clone(),
            anatomy: Some(Arc::clone(&self.anatomy)),
            needle,
            probe: self.contact.as_ref().map(|contact| contact.probe.clone()),
            level: self.modelling.level,
            precision: self.modelling.precision,
            options: Options {
                dense,
                spacing_mm: self.modelling.contact_spacing_mm,
                ..Options::default()
            },
        };
        let finite = match &self.gpu {
            #[cfg(feature = "gpu")]
            Some(gpu) => Finite::with_maker(setup, maker(gpu), progress),
            #[cfg(not(feature = "gpu"))]
            Some(_) => return Err(InputError::new(insonify_gpu::GpuError::Absent)),
            None => Finite::new(setup, progress),
        };
        let mut finite = finite.map_err(|error| self.blame(error))?;
        if prepared && self.modelling.level == Level::Exact {
            self.predict_remesh(&mut finite);
        }
        Ok(Box::new(finite))
    }

    fn shaft(&self) -> Shaft {
        Shaft {
            length_mm: self.needle.length_mm,
            radius_mm: self.needle.diameter_mm / 2.0,
        }
    }

    fn stiffened(&self, stiffened: &Stiffened) -> Result<Box<dyn Model>, InputError> {
        let setup = nonlinear::Setup {
            mesh: Arc::clone(&self.mesh),
            laws: stiffened.laws.clone(),
            fixed: self.fixed.clone(),
            interactions: self.interactions.clone(),
            anatomy: Some(Arc::clone(&self.anatomy)),
            shaft: self.shaft(),
            viscosity: stiffened.viscosity,
            stress: stiffened.stress,
            options: stiffened.options,
        };
        let fault = |error: InvalidSetup| self.file.fault("tissue", error);
        Ok(match &self.section {
            Some(plane) => Box::new(nonlinear::Nonlinear::of_plane(setup, plane).map_err(fault)?),
            None => Box::new(nonlinear::Nonlinear::new(setup).map_err(fault)?),
        })
    }

    fn needle_model(&self) -> Result<Box<dyn Needle>, OutOfRange> {
        let shaft = self.shaft();
        Ok(match self.needle.bending {
            Bending::None { bevel } => Box::new(Rigid::new(shaft, bevel)?),
            Bending::Constrained(constraint) => Box::new(Constrained::new(shaft, constraint)?),
            Bending::Springs {
                stiffness_nmm2,
                link_mm,
                bevel,
            } => {
                let stiffness = Stiffness::BendingNmm2(stiffness_nmm2);
                Box::new(Flexible::springs(shaft, stiffness, link_mm, bevel)?)
            }
            Bending::Beam {
                stiffness_nmm2,
                element_mm,
                bevel,
            } => {
                let stiffness = Stiffness::BendingNmm2(stiffness_nmm2);
                Box::new(Flexible::beam(shaft, stiffness, element_mm, bevel)?)
            }
        })
    }

    fn blame(&self, error: InvalidSetup) -> InputError {
        let key = match &error {
            InvalidSetup::Interaction { .. } => "tissue.material",
            InvalidSetup::Fixed { .. }
            | InvalidSetup::Linear(LinearError::LooseNodes { .. } | LinearError::FreeParts { .. }) => "tissue.fix",
            InvalidSetup::Candidate { .. } => "contact_probe",
            InvalidSetup::Remesh(RemeshError::Device(_)) => "tissue.device",
            InvalidSetup::Linear(LinearError::InverseMemory { .. } | LinearError::Column { .. })
            | InvalidSetup::Remesh(_) => "tissue.level",
            _ => "tissue",
        };
        self.file.fault(key, error)
    }

    /// Prefetches the data that remeshing along the needle's path will read, so that no step waits for it.
    fn predict_remesh(&self, finite: &mut Finite) {
        for [from, to] in path_pieces(self.path.tip()) {
            let along = to - from;
            let length = along.norm();
            finite.prefetch(&from, &(along / length), length, ASIDE_MM);
        }
    }
}
