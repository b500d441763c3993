//! Mass-spring cylinder of a scenario, and the anatomy before it is placed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::file::ScenarioFile;
use super::labels::Labels;
use super::tissue::TissueModel;
use crate::input::{Cause, InputError};
use crate::mechanics::insertion::InvalidSetup;
use crate::mechanics::insertion::spring::{MassSpring, Parameters};
use crate::mechanics::insertion::{Model, Snapshot, Tissue};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::needle::{Rigid, Shaft};
use crate::tracking::trajectory::Trajectory;

/// Default length of the cylinder relative to the path of the tip: its far end is fixed.
const BEYOND: f64 = 1.25;

/// Cylinder of masses and springs around the path of the needle (Zhu et al. 2007, section 2.2). Its side and its far end are
/// fixed; its tissue is a single material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CylinderSpec {
    /// Young's modulus, kPa (above 0). Default 10.
    pub young_kpa: Option<f64>,
    /// Density, kg/m^3 (above 0). Default 1000.
    pub density_kg_per_m3: Option<f64>,
    /// Rate at which a free node loses its velocity, 1/s (0 or more). Default 200.
    pub damping_per_s: Option<f64>,
    /// Damping of each spring over its stiffness, s (0 or more). Default 1e-4.
    pub spring_damping_s: Option<f64>,
    /// Radius, mm (above 0). Default 25.
    pub radius_mm: Option<f64>,
    /// Length below the skin, mm (above 0). Default: 1.25 times the path of the tip.
    pub length_mm: Option<f64>,
    /// Number of rings of nodes around the axis (1 to 64). Default 5.
    pub rings: Option<u32>,
    /// Number of nodes of the first ring (3 to 12). Default 6.
    pub sectors: Option<u32>,
    /// Number of layers of elements along the axis (2 to 1000). Default: layers as thick as rings are wide.
    pub layers: Option<u32>,
    /// The tip node is penetrated when the far face is nearer than this fraction of its circumference (0.005 to 0.2). Default
    /// 0.05.
    pub lambda: Option<f64>,
    /// Maximum number of substeps of a step (1 to 4096). Default 100.
    pub most_substeps: Option<u32>,
}

impl ScenarioFile {
    /// Parameters of the cylinder, for the mass-spring model.
    pub(super) fn cylinder_of(&self, path: &Trajectory) -> Result<Option<Parameters>, InputError> {
        let spec = &self.tissue;
        if spec.model != TissueModel::MassSpring {
            return match spec.cylinder {
                None => Ok(None),
                Some(_) => {
                    let found = "`cylinder` of a model of elements";
                    Err(self.wrong_keys("tissue.cylinder", found, "`model = \"mass-spring\"`"))
                }
            };
        }
        let of_elements = [
            ("level", spec.level.is_some()),
            ("device", spec.device.is_some()),
            ("precision", spec.precision.is_some()),
            ("columns", spec.columns.is_some()),
            ("contact_spacing_mm", spec.contact_spacing_mm.is_some()),
            ("mesh", spec.mesh.is_some()),
            ("region_array", spec.region_array.is_some()),
            ("nodes", spec.nodes.is_some()),
            ("along_path", spec.along_path.is_some()),
            ("box_mm", spec.box_mm.is_some()),
            ("fix", !spec.fix.is_empty()),
        ];
        if let Some((key, _)) = of_elements.iter().find(|(_, given)| *given) {
            let found = format!("`{key}` of a mass-spring model");
            return Err(self.wrong_keys(format!("tissue.{key}"), found, "`model = \"finite-element\"`"));
        }
        if self.contact_probe.is_some() {
            let found = "a probe in contact with a mass-spring model, which has no part for it";
            return Err(self.wrong_keys("contact_probe", found, "`tissue.model = \"finite-element\"`"));
        }
        let parameters = parameters(&spec.cylinder.unwrap_or_default(), path);
        parameters.check().map_err(|error| self.spring_fault(error))?;
        Ok(Some(parameters))
    }

    pub(super) fn spring_fault(&self, error: InvalidSetup) -> InputError {
        let key = match &error {
            InvalidSetup::Number(error) => format!("tissue.cylinder.{}", error.key),
            _ => "tissue.cylinder".to_owned(),
        };
        self.fault(key, Cause::Setup(error))
    }

    /// Mesh of the cylinder. Its place is set when the needle enters.
    pub(super) fn cylinder_mesh(&self, parameters: Parameters, labels: &Labels) -> Result<TetMesh, InputError> {
        let needle = Rigid::new(Shaft::default(), None).map_err(|error| self.fault("needle", Cause::Number(error)))?;
        let mut model = MassSpring::new(parameters, Box::new(labels.clone()), Box::new(needle))
            .map_err(|error| self.spring_fault(error))?;
        let (mut snapshot, mut tissue, mut imager) = (Snapshot::default(), Tissue::default(), model.imager());
        model.snapshot(&mut snapshot);
        imager.tissue(&snapshot, &mut tissue);
        let elements = imager.elements().to_vec();
        let regions = vec![0; elements.len()];
        TetMesh::new(tissue.reference, elements, regions)
            .map_err(|error| self.fault("tissue.cylinder", Cause::Mesh(error)))
    }
}

fn parameters(spec: &CylinderSpec, path: &Trajectory) -> Parameters {
    let usual = Parameters::default();
    let keys = path.keys();
    let way = keys
        .iter()
        .map(|key| (key.pose.position_mm() - keys[0].pose.position_mm()).norm());
    let way = way.fold(0.0, f64::max);
    let length_mm = spec.length_mm.unwrap_or((BEYOND * way).max(1.0));
    let radius_mm = spec.radius_mm.unwrap_or(usual.radius_mm);
    let rings = spec.rings.map_or(usual.rings, |rings| rings as usize);
    let layers = (length_mm * rings as f64 / radius_mm).round().clamp(2.0, 1000.0) as usize;
    Parameters {
        young_kpa: spec.young_kpa.unwrap_or(usual.young_kpa),
        density_kg_per_m3: spec.density_kg_per_m3.unwrap_or(usual.density_kg_per_m3),
        damping_per_s: spec.damping_per_s.unwrap_or(usual.damping_per_s),
        spring_damping_s: spec.spring_damping_s.unwrap_or(usual.spring_damping_s),
        radius_mm,
        length_mm,
        rings,
        sectors: spec.sectors.map_or(usual.sectors, |sectors| sectors as usize),
        layers: spec.layers.map_or(layers, |layers| layers as usize),
        lambda: spec.lambda.unwrap_or(usual.lambda),
        most_substeps: spec.most_substeps.map_or(usual.most_substeps, |most| most as usize),
    }
}
