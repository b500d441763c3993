//! Tissue of a scenario by model: what each model alone has, and what follows from it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::file::ScenarioFile;
use super::finite_element::{FiniteElement, faulty_key};
use super::labels::Labels;
use super::mass_spring;
use super::needle::NeedleSettings;
use super::nonlinear_tissue::NonlinearTissue;
use super::probe::Contact;
use super::regions::{Region, Regions};
use super::resolve::{Scenario, Timing};
use super::section::PlaneSection;
use super::tissue::TissueModel;
use insonify_base::document::InputError;
use insonify_base::note::Notes;
use insonify_imaging::scene::Scene;
use insonify_mechanics::insertion::spring::MassSpringParameters;
use insonify_mechanics::insertion::{Anatomy, Interaction, MeshRegions, Model};
use insonify_mechanics::tissue::law::{AnyLaw, Stiffening};
use insonify_mechanics::tissue::material::Material;
use insonify_mechanics::tissue::remesh::Level;
use insonify_mesh::TetMesh;
use insonify_tracking::trajectory::Trajectory;

/// With fewer nodes in contact a probe presses on points rather than along its side.
const FEW_CANDIDATES: usize = 6;

/// Tissue of a scenario, by model.
#[derive(Clone, Debug)]
pub enum TissueSetup {
    /// Linear finite elements, remeshed at the tip of the needle.
    FiniteElement(Box<FiniteElement>),
    /// Masses and springs in a cylinder along the path: the interactions are those of the labels around it.
    MassSpring(MassSpringParameters),
    /// Nonlinear or viscoelastic finite elements.
    Nonlinear(NonlinearTissue),
    /// A section by the image plane in place of the solid.
    Plane(PlaneSection),
}

impl TissueSetup {
    pub(crate) fn finite_element(&self) -> Option<&FiniteElement> {
        match self {
            Self::FiniteElement(elements) => Some(elements),
            _ => None,
        }
    }

    /// Nonlinear tissue, in three dimensions or in a plane.
    pub(crate) fn nonlinear(&self) -> Option<&NonlinearTissue> {
        match self {
            Self::Nonlinear(tissue) => Some(tissue),
            Self::Plane(section) => Some(&section.tissue),
            Self::FiniteElement(_) | Self::MassSpring(_) => None,
        }
    }

    /// Law of each element of the mesh, if stress follows from its displacements alone.
    pub(crate) fn elastic_laws(&self) -> Option<Vec<AnyLaw>> {
        let linear = |material: &Material| Stiffening::linear(*material).into();
        match self {
            Self::FiniteElement(elements) => Some(elements.materials.iter().map(linear).collect()),
            Self::Nonlinear(tissue) if tissue.viscosity.is_none() => Some(tissue.laws.clone()),
            // Of a section, stress across its plane is not known.
            Self::Nonlinear(_) | Self::MassSpring(_) | Self::Plane(_) => None,
        }
    }
}

impl Scenario {
    /// Builds the model, with tissue at rest and no instrument near. `progress` receives completed and total work of
    /// long computations.
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
        let needle = self.needle_model()?;
        match &self.tissue {
            TissueSetup::FiniteElement(elements) => elements.model(self, needle, prepared, progress),
            TissueSetup::MassSpring(parameters) => mass_spring::model(*parameters, self, needle),
            TissueSetup::Nonlinear(tissue) => tissue.model(self, None),
            TissueSetup::Plane(section) => section.tissue.model(self, Some(&section.plane)),
        }
    }

    /// Probe in contact, if any.
    pub fn contact(&self) -> Option<&Contact> {
        self.tissue.finite_element()?.contact.as_ref()
    }

    /// Times (s, on the clock of the motions) of changes of the level of remeshing and the new levels, ascending.
    pub fn level_changes(&self) -> &[(f64, Level)] {
        self.tissue.finite_element().map_or(&[], |elements| &elements.changes)
    }

    /// Keeps the level of remeshing that the run starts with.
    pub fn keep_level(&mut self) {
        if let TissueSetup::FiniteElement(elements) = &mut self.tissue {
            elements.changes.clear();
        }
    }

    /// Has the stress of viscous tissue followed, which does not follow from displacements alone.
    pub fn follow_stress(&mut self) {
        if let TissueSetup::Nonlinear(tissue) | TissueSetup::Plane(PlaneSection { tissue, .. }) = &mut self.tissue {
            tissue.stress = true;
        }
    }

    /// Material of the elements of a region, of linear finite elements.
    pub fn linear_material(&self, region: i32) -> Option<Material> {
        let materials = &self.tissue.finite_element()?.materials;
        let mut elements = self.mesh.regions().iter().zip(materials);
        elements
            .find(|(listed, _)| **listed == region)
            .map(|(_, material)| *material)
    }

    /// Sets the material of the elements of a region, of linear finite elements.
    pub fn set_linear_material(&mut self, region: i32, material: Material) {
        let TissueSetup::FiniteElement(elements) = &mut self.tissue else {
            return;
        };
        for (of_region, of_element) in self.mesh.regions().iter().zip(&mut elements.materials) {
            if *of_region == region {
                *of_element = material;
            }
        }
    }
}

/// Needle, scene and times for which tissue is resolved.
pub(crate) struct Insertion<'a> {
    pub scene: &'a Scene,
    /// Folder at which relative paths start.
    pub base_dir: &'a Path,
    pub needle: &'a NeedleSettings,
    /// Path of the tip.
    pub path: &'a Trajectory,
    pub timing: &'a Timing,
}

/// Result of resolving `[tissue]`.
pub(crate) struct ResolvedTissue {
    pub mesh: Arc<TetMesh>,
    pub setup: TissueSetup,
    pub interactions: Vec<(i32, Interaction)>,
    pub anatomy: Arc<dyn Anatomy>,
    pub region_names: BTreeMap<i32, String>,
}

impl ResolvedTissue {
    /// Warns of interactions and contacts that have no effect, or a coarse one.
    pub(crate) fn warn(&self, warnings: &mut Vec<String>) {
        for (region, interaction) in &self.interactions {
            if interaction.puncture_n > 0.0 && interaction.puncture_n <= interaction.cutting_n {
                warnings.push(format!(
                    "the surface of {} is not felt: its puncture_n ({} N) is not above its cutting_n ({} N); raise it or leave it out",
                    self
                        .region_names
                        .get(region)
                        .map_or_else(|| format!("region {region}"), String::clone),
                    interaction.puncture_n,
                    interaction.cutting_n
                ));
            }
        }
        let contact = self
            .setup
            .finite_element()
            .and_then(|elements| elements.contact.as_ref());
        if let Some(few @ 1..FEW_CANDIDATES) = contact.map(|contact| contact.probe.candidates.len()) {
            warnings.push(format!(
                "only {few} nodes of the mesh can touch the contact probe: its force is coarse; lower `contact_probe.thinning`, or raise \
                 `tissue.nodes`"
            ));
        }
    }
}

/// A mesh that deforms, with the properties of its regions and its fixed nodes.
pub(crate) struct Deforming {
    pub mesh: Arc<TetMesh>,
    /// Node and axis of each fixed degree of freedom, ascending.
    pub fixed: Vec<(u32, u8)>,
    /// Names of regions in a mesh file.
    pub names: BTreeMap<i32, String>,
    properties: BTreeMap<i32, Region>,
    interactions: Vec<(i32, Interaction)>,
    pub anatomy: Arc<dyn Anatomy>,
    region_names: BTreeMap<i32, String>,
}

impl Deforming {
    /// A property of each element.
    pub(crate) fn of_elements<T>(&self, property: impl Fn(&Region) -> T) -> Vec<T> {
        let regions = self.mesh.regions().iter();
        regions.map(|region| property(&self.properties[region])).collect()
    }

    pub(crate) fn modelled(self, setup: TissueSetup) -> ResolvedTissue {
        ResolvedTissue {
            mesh: self.mesh,
            setup,
            interactions: self.interactions,
            anatomy: self.anatomy,
            region_names: self.region_names,
        }
    }
}

impl ScenarioFile {
    /// Refuses what the tissue model does not have, and checks its settings, before anything is read.
    pub(crate) fn check_tissue(&self) -> Result<(), InputError> {
        let (spec, model) = (&self.tissue, self.tissue.model);
        let linear = "`tissue.model = \"finite-element\"`";
        if !self.run.change.is_empty() && !model.is_remeshed() {
            let found = "a change of level of a model that has none";
            return Err(self.wrong_keys("run.change", found, linear));
        }
        self.of_kind("tissue", spec, model)?;
        for (index, material) in spec.material.iter().enumerate() {
            self.of_kind(&format!("tissue.material[{index}]"), material, model)?;
        }
        if self.contact_probe.is_some() && !model.is_remeshed() {
            let tissue = if model.is_meshed() {
                "nonlinear tissue"
            } else {
                "a mass-spring model"
            };
            let found = format!("a probe in contact with {tissue}, which does not support it");
            return Err(self.wrong_keys("contact_probe", found, linear));
        }
        match model {
            TissueModel::FiniteElement => self.remeshing().map(drop),
            TissueModel::MassSpring => Ok(()),
            TissueModel::Nonlinear | TissueModel::Viscoelastic => self.check_nonlinear(),
        }
    }

    /// Reads or makes the tissue. `progress` receives the completed fraction of mesh generation.
    pub(crate) fn tissue_of(
        &self,
        insertion: &Insertion<'_>,
        progress: &mut dyn FnMut(f32),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<ResolvedTissue, InputError> {
        match self.tissue.model {
            TissueModel::FiniteElement => self.finite_element(insertion, progress, notes, warnings),
            TissueModel::MassSpring => self.mass_spring(insertion),
            TissueModel::Nonlinear | TissueModel::Viscoelastic => {
                self.nonlinear_tissue(insertion, progress, notes, warnings)
            }
        }
    }

    /// Reads or makes the mesh of tissue that deforms.
    pub(crate) fn deforming(
        &self,
        insertion: &Insertion<'_>,
        progress: &mut dyn FnMut(f32),
        notes: &mut Notes,
        warnings: &mut Vec<String>,
    ) -> Result<Deforming, InputError> {
        let meshed = self.mesh(
            insertion.scene,
            insertion.base_dir,
            insertion.path,
            progress,
            notes,
            warnings,
        )?;
        let regions = Regions::new(self, insertion.scene, &meshed.names).with_hint(meshed.region_hint.as_deref());
        let mut present = meshed.mesh.regions().to_vec();
        if self.tissue.mesh.is_none() {
            // A needle also meets labels too thin for an element.
            present.extend(self.labelled(&regions)?);
        }
        present.sort_unstable();
        present.dedup();
        let properties = regions.properties(&present)?;
        let interactions: Vec<_> = properties
            .iter()
            .map(|(region, properties)| (*region, properties.interaction))
            .collect();
        let mesh = Arc::new(meshed.mesh);
        let anatomy: Arc<dyn Anatomy> = match self.tissue.mesh {
            Some(_) => {
                let regions = MeshRegions::new(&mesh, &interactions);
                Arc::new(regions.map_err(|error| self.fault(faulty_key(&error), error))?)
            }
            None => {
                let materials = properties.iter();
                let materials = materials.map(|(region, properties)| (*region, properties.material));
                let labels = Labels::new(regions.volume(), &interactions, self.tissue.box_mm);
                Arc::new(labels.with_materials(materials))
            }
        };
        let fixed = self.fixed(&mesh, &regions, &properties, notes, warnings)?;
        let region_names = present.iter().map(|region| (*region, regions.name(*region))).collect();
        Ok(Deforming {
            mesh,
            fixed,
            names: meshed.names,
            properties,
            interactions,
            anatomy,
            region_names,
        })
    }

    /// Regions of the labels present in the volume, without the excluded ones.
    pub(crate) fn labelled(&self, regions: &Regions<'_>) -> Result<Vec<i32>, InputError> {
        let (outside, volume) = (self.outside(regions)?, regions.volume());
        let labels = volume.labels().iter().enumerate().skip(1);
        let present = labels.filter(|(index, _)| volume.holds(*index));
        let numbers = present.filter_map(|(_, label)| i32::try_from(label.value).ok());
        Ok(numbers.filter(|region| !outside.contains(region)).collect())
    }
}
