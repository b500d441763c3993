//! Mass-spring cylinder of a scenario: its parameters, the anatomy before it is placed, and the model built from it.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::file::ScenarioFile;
use super::labels::Labels;
use super::regions::Regions;
use super::resolve::Scenario;
use super::tissue_setup::{Insertion, ResolvedTissue, TissueSetup};
use insonify_base::document::InputError;
use insonify_mechanics::insertion::spring::{MassSpring, MassSpringParameters};
use insonify_mechanics::insertion::{InvalidSetup, Model, Snapshot, Tissue};
use insonify_mechanics::needle::{Needle, Rigid, Shaft};
use insonify_mesh::TetMesh;
use insonify_tracking::trajectory::Trajectory;

/// Default length of the cylinder relative to the path of the tip: its far end is fixed.
const BEYOND: f64 = 1.25;

impl ScenarioFile {
    /// Makes the cylinder; its interactions are those of the labels that it will lie in.
    pub(crate) fn mass_spring(&self, insertion: &Insertion<'_>) -> Result<ResolvedTissue, InputError> {
        let parameters = self.cylinder_parameters(insertion.path)?;
        let unnamed = BTreeMap::new();
        let regions = Regions::new(self, insertion.scene, &unnamed);
        let present = self.labelled(&regions)?;
        let properties = regions.properties(&present)?;
        let interactions: Vec<_> = properties
            .iter()
            .map(|(region, properties)| (*region, properties.interaction))
            .collect();
        let labels = Labels::new(regions.volume(), &interactions, None);
        Ok(ResolvedTissue {
            mesh: Arc::new(self.cylinder_mesh(parameters, &labels)?),
            setup: TissueSetup::MassSpring(parameters),
            interactions,
            anatomy: Arc::new(labels),
            region_names: present.iter().map(|region| (*region, regions.name(*region))).collect(),
        })
    }

    /// Parameters of the cylinder, which reaches beyond the path unless its length is stated.
    fn cylinder_parameters(&self, path: &Trajectory) -> Result<MassSpringParameters, InputError> {
        let mut parameters = self.tissue.cylinder.unwrap_or_default();
        let keys = path.keys();
        let travel = keys
            .iter()
            .map(|key| (key.pose.position_mm() - keys[0].pose.position_mm()).norm());
        let travel = travel.fold(0.0, f64::max);
        parameters.length_mm.get_or_insert((BEYOND * travel).max(1.0));
        parameters.check().map_err(|error| self.spring_fault(error))?;
        Ok(parameters)
    }

    /// An error of the mass-spring model, at the key of the number concerned or at `tissue.cylinder`.
    fn spring_fault(&self, error: InvalidSetup) -> InputError {
        let key = match &error {
            InvalidSetup::Number(error) => format!("tissue.cylinder.{}", error.key),
            _ => "tissue.cylinder".to_owned(),
        };
        self.fault(key, error)
    }

    /// Mesh of the cylinder. Its place is set when the needle enters.
    fn cylinder_mesh(&self, parameters: MassSpringParameters, labels: &Labels) -> Result<TetMesh, InputError> {
        let needle = Rigid::new(Shaft::default(), None).map_err(|error| self.fault("needle", error))?;
        let mut model = MassSpring::new(parameters, Box::new(labels.clone()), Box::new(needle))
            .map_err(|error| self.spring_fault(error))?;
        let (mut snapshot, mut tissue, mut imager) = (Snapshot::default(), Tissue::default(), model.imager());
        model.snapshot(&mut snapshot);
        imager.tissue(&snapshot, &mut tissue);
        let elements = imager.elements().to_vec();
        let regions = vec![0; elements.len()];
        TetMesh::new(tissue.reference, elements, regions).map_err(|error| self.fault("tissue.cylinder", error))
    }
}

/// Builds the model of a cylinder.
pub(super) fn model(
    parameters: MassSpringParameters,
    scenario: &Scenario,
    needle: Box<dyn Needle>,
) -> Result<Box<dyn Model>, InputError> {
    let springs = MassSpring::new(parameters, Box::new(Arc::clone(&scenario.anatomy)), needle);
    Ok(Box::new(springs.map_err(|error| scenario.file.spring_fault(error))?))
}
