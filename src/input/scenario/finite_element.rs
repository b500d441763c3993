//! Linear finite elements of a scenario: their settings, and the model built from them.

use std::sync::Arc;

use super::file::ScenarioFile;
use super::path_pieces;
use super::probe::Contact;
use super::resolve::{Scenario, Timing};
use super::tissue::{ColumnsName, DeviceName, PATCH_MM};
use super::tissue_setup::{Deforming, Insertion, ResolvedTissue, TissueSetup};
use insonify_base::document::InputError;
use insonify_base::note::Notes;
use insonify_gpu::{AdapterChoice, Gpu, Needs};
use insonify_imaging::scene::deform::Motion;
use insonify_mechanics::insertion::finite::{Finite, FiniteOptions, Setup};
use insonify_mechanics::insertion::{InvalidSetup, Model, TissueMotion};
use insonify_mechanics::needle::Needle;
#[cfg(feature = "gpu")]
use insonify_mechanics::remesh_gpu::maker;
use insonify_mechanics::tissue::error::LinearError;
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::remesh::{Level, Precision, RemeshError};

/// Lateral deviation allowed for a needle of 18 gauge from its path in the tissue at rest, and for tissue under a
/// probe, mm.
const ASIDE_MM: f64 = 5.0;

/// Linear finite elements, remeshed at the tip of the needle.
#[derive(Clone, Debug)]
pub struct FiniteElement {
    /// Material of each element.
    pub materials: Vec<Material>,
    /// Node and axis of each fixed degree of freedom, ascending.
    pub fixed: Vec<(u32, u8)>,
    /// Probe in contact, if any.
    pub contact: Option<Contact>,
    /// Settings of remeshing.
    pub remeshing: Remeshing,
    /// GPU that stores the dense inverse; `None` on the CPU.
    pub gpu: Option<Gpu>,
    /// Respiration and pulsation.
    pub motions: Vec<Motion>,
    /// Times (s, on the clock of the motions) of changes of the level of remeshing and the new levels, ascending.
    pub changes: Vec<(f64, Level)>,
}

/// Settings of remeshing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Remeshing {
    /// Level of remeshing.
    pub level: Level,
    /// Precision of the dense inverse.
    pub precision: Precision,
    /// Source of the compliance columns.
    pub columns: ColumnsName,
    /// Minimum distance between nodes on the needle, mm.
    pub contact_spacing_mm: f64,
    /// Radius of the patch of tissue that bears the force at the tip, mm.
    pub patch_mm: f64,
}

impl ScenarioFile {
    /// Settings of remeshing, checked against each other, with defaults for those not stated.
    pub(crate) fn remeshing(&self) -> Result<Remeshing, InputError> {
        let spec = &self.tissue;
        let level = spec.level.unwrap_or_default();
        let is_on_gpu = spec.device == Some(DeviceName::Gpu);
        let usual = if is_on_gpu {
            Precision::Single
        } else {
            Precision::Double
        };
        let precision = spec.precision.unwrap_or(usual);
        let usual = match level {
            Level::Exact => ColumnsName::OnDemand,
            _ => ColumnsName::Dense,
        };
        let columns = spec.columns.unwrap_or(usual);
        if is_on_gpu && level == Level::Exact {
            let key = if spec.level.is_some() {
                "tissue.level"
            } else {
                "tissue.device"
            };
            let found = "the exact level on a GPU, which does not support it";
            return Err(self.wrong_keys(key, found, "`level` I, II, III or IV, or `device = \"cpu\"`"));
        }
        if is_on_gpu && precision == Precision::Double {
            let expected = "`f32`, or `device = \"cpu\"`";
            return Err(self.wrong_keys(
                "tissue.precision",
                "f64 on a GPU, which keeps the inverse in f32",
                expected,
            ));
        }
        // Precision is that of the dense inverse: at the exact level it has a use only if a later change
        // makes one.
        let changes_to_dense = self.run.change.iter().any(|change| change.level != Level::Exact);
        if level == Level::Exact && precision == Precision::Single && !changes_to_dense {
            return Err(self.wrong_keys("tissue.precision", "f32 at the exact level", "`f64`, or another level"));
        }
        if level != Level::Exact && columns == ColumnsName::OnDemand {
            let found = format!("columns on demand at level {level}, which keeps a dense inverse");
            return Err(self.wrong_keys("tissue.columns", found, "`dense`, or the exact level"));
        }
        Ok(Remeshing {
            level,
            precision,
            columns,
            contact_spacing_mm: spec.contact_spacing_mm.unwrap_or(1.0),
            patch_mm: spec.patch_mm.unwrap_or(PATCH_MM),
        })
    }

    /// Reads or makes the mesh of linear tissue, and finds the nodes that a probe can touch.
    pub(crate) fn finite_element(
        &self,
        insertion: &Insertion<'_>,
        progress: &mut dyn FnMut(f32),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<ResolvedTissue, InputError> {
        let remeshing = self.remeshing()?;
        let changes = self.changes(insertion.timing)?;
        // Opened before the mesh is made, which takes longer.
        let gpu = self.gpu()?;
        notes.extend(
            gpu.iter()
                .map(|gpu| format!("remeshing works on '{}'", gpu.report().name)),
        );
        let meshed = self.deforming(insertion, progress, notes, warnings)?;
        let elements = FiniteElement {
            motions: self.living(insertion, &meshed, notes, warnings)?,
            materials: meshed.of_elements(|region| region.material),
            contact: self.contact(insertion.scene, &meshed)?,
            fixed: meshed.fixed.clone(),
            remeshing,
            gpu,
            changes,
        };
        Ok(meshed.modelled(TissueSetup::FiniteElement(Box::new(elements))))
    }

    /// Respiration and pulsation of the scene on the mesh, whose fixed nodes rest.
    fn living(
        &self,
        insertion: &Insertion<'_>,
        meshed: &Deforming,
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Vec<Motion>, InputError> {
        let (scene, _, is_inline) = self.scene_file(insertion.base_dir)?;
        let mut held: Vec<u32> = meshed.fixed.iter().map(|(node, _)| *node).collect();
        held.dedup();
        let finer = match &self.tissue.mesh {
            Some(_) => "a finer `tissue.mesh` has one".to_owned(),
            None => format!(
                "`tissue.nodes` = {} or more gives finer ones",
                8 * meshed.mesh.nodes().len()
            ),
        };
        scene
            .living(
                Vec::new(),
                &meshed.mesh,
                &insertion.scene.body(),
                (&held, &finer),
                notes,
                warnings,
            )
            .map_err(|error| self.of_scene(error, is_inline))
    }

    /// Opens the GPU, if requested.
    fn gpu(&self) -> Result<Option<Gpu>, InputError> {
        if self.tissue.device != Some(DeviceName::Gpu) {
            return Ok(None);
        }
        let choice = self.adapter.clone().unwrap_or_else(|| AdapterChoice::from_flag(None));
        let gpu = Gpu::open(&choice, &Needs::default());
        gpu.map(Some).map_err(|error| self.fault("tissue.device", error))
    }

    /// Times of changes of the level, and the new levels.
    fn changes(&self, timing: &Timing) -> Result<Vec<(f64, Level)>, InputError> {
        let mut changes: Vec<(f64, Level)> = Vec::new();
        for (index, change) in self.run.change.iter().enumerate() {
            let key = format!("run.change[{index}].at_s");
            let at_s = self.number(
                key.as_str(),
                change.at_s,
                |at_s| self.during(timing, at_s),
                "a time within the run, s",
            )?;
            if let Some((before, _)) = changes
                .last()
                .filter(|(before, _)| timing.step_at(*before) >= timing.step_at(at_s))
            {
                let found = format!("a change at {at_s} s after one at {before} s");
                return Err(self.wrong_keys(key, found, "ascending times, in a step each"));
            }
            changes.push((at_s, change.level));
        }
        Ok(changes)
    }
}

impl FiniteElement {
    /// Builds the model; `prepared` computes in advance what remeshing along the path will read.
    pub(super) fn model(
        &self,
        scenario: &Scenario,
        needle: Box<dyn Needle>,
        prepared: bool,
        progress: &mut (dyn FnMut(usize, usize) + Send),
    ) -> Result<Box<dyn Model>, InputError> {
        let setup = Setup {
            mesh: (*scenario.mesh).clone(),
            materials: self.materials.clone(),
            fixed: self.fixed.clone(),
            interactions: scenario.interactions.clone(),
            anatomy: Some(Arc::clone(&scenario.anatomy)),
            needle,
            probe: self.contact.as_ref().map(|contact| contact.probe.clone()),
            level: self.remeshing.level,
            precision: self.remeshing.precision,
            options: FiniteOptions {
                dense: self.remeshing.columns == ColumnsName::Dense,
                spacing_mm: self.remeshing.contact_spacing_mm,
                patch_mm: self.remeshing.patch_mm,
                ..FiniteOptions::default()
            },
        };
        let finite = match &self.gpu {
            #[cfg(feature = "gpu")]
            Some(gpu) => Finite::with_maker(setup, maker(gpu), progress),
            #[cfg(not(feature = "gpu"))]
            Some(_) => return Err(InputError::new(insonify_gpu::GpuError::Absent)),
            None => Finite::new(setup, progress),
        };
        let mut finite = finite.map_err(|error| scenario.file.fault(faulty_key(&error), error))?;
        finite.live(self.motions.iter().cloned().map(tissue_motion).collect());
        // The other levels keep a whole inverse, of which nothing remains to be read on the way.
        if prepared && self.remeshing.level == Level::Exact {
            prefetch(scenario, &mut finite);
        }
        Ok(Box::new(finite))
    }
}

fn tissue_motion(motion: Motion) -> TissueMotion {
    TissueMotion {
        displacements: motion.displacements.clone(),
        share_at: Arc::new(move |time_s| motion.at(time_s)),
    }
}

/// Key of a scenario that an error of the setup is about.
pub(super) fn faulty_key(error: &InvalidSetup) -> &'static str {
    match error {
        InvalidSetup::Interaction { .. } | InvalidSetup::Twice { .. } | InvalidSetup::Elsewhere { .. } => {
            "tissue.material"
        }
        InvalidSetup::Fixed { .. }
        | InvalidSetup::Linear(LinearError::LooseNodes { .. } | LinearError::FreeParts { .. }) => "tissue.fix",
        InvalidSetup::Candidate { .. } => "contact_probe",
        InvalidSetup::Remesh(RemeshError::Device(_)) => "tissue.device",
        InvalidSetup::Linear(LinearError::InverseMemory { .. } | LinearError::Column { .. })
        | InvalidSetup::Remesh(_) => "tissue.level",
        _ => "tissue",
    }
}

/// Prefetches the data that remeshing along the needle's path will read, so that no step waits for it.
fn prefetch(scenario: &Scenario, finite: &mut Finite) {
    for [start, end] in path_pieces(scenario.path.tip()) {
        let along = end - start;
        let length = along.norm();
        finite.prefetch(&start, &(along / length), length, ASIDE_MM);
    }
}
