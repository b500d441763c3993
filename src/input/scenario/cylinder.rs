//! Mass-spring cylinder of a scenario, and the anatomy before it is placed.

use super::file::ScenarioFile;
use super::labels::Labels;
use super::tissue::TissueModel;
use insonify_base::document::InputError;
use insonify_mechanics::insertion::spring::{MassSpring, Parameters};
use insonify_mechanics::insertion::{InvalidSetup, Model, Snapshot, Tissue};
use insonify_mechanics::needle::{Rigid, Shaft};
use insonify_mesh::TetMesh;
use insonify_tracking::trajectory::Trajectory;

/// Default length of the cylinder relative to the path of the tip: its far end is fixed.
const BEYOND: f64 = 1.25;

impl ScenarioFile {
    /// Parameters of the cylinder, for the mass-spring model.
    pub(crate) fn cylinder_of(&self, path: &Trajectory) -> Result<Option<Parameters>, InputError> {
        let spec = &self.tissue;
        if spec.model != TissueModel::MassSpring {
            return Ok(None);
        }
        if self.contact_probe.is_some() {
            let found = "a probe in contact with a mass-spring model, which does not support it";
            return Err(self.wrong_keys("contact_probe", found, "`tissue.model = \"finite-element\"`"));
        }
        let mut parameters = spec.cylinder.unwrap_or_default();
        let keys = path.keys();
        let travel = keys
            .iter()
            .map(|key| (key.pose.position_mm() - keys[0].pose.position_mm()).norm());
        let travel = travel.fold(0.0, f64::max);
        parameters.length_mm.get_or_insert((BEYOND * travel).max(1.0));
        parameters.check().map_err(|error| self.spring_fault(error))?;
        Ok(Some(parameters))
    }

    /// An error of the mass-spring model, at the key of the number concerned or at `tissue.cylinder`.
    pub(crate) fn spring_fault(&self, error: InvalidSetup) -> InputError {
        let key = match &error {
            InvalidSetup::Number(error) => format!("tissue.cylinder.{}", error.key),
            _ => "tissue.cylinder".to_owned(),
        };
        self.fault(key, error)
    }

    /// Mesh of the cylinder. Its place is set when the needle enters.
    pub(crate) fn cylinder_mesh(&self, parameters: Parameters, labels: &Labels) -> Result<TetMesh, InputError> {
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
