//! Errors of scenario files.

use super::file::ScenarioFile;
use crate::base::document::{Fault, InvalidFile, NoRegion};
use crate::gpu::GpuError;
use crate::input::scene::{Problem, SceneError};
use crate::input::statics;
use crate::mechanics::insertion::spring::InvalidParameters;
use crate::mechanics::insertion::{InvalidInteraction, InvalidSetup};
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::mesh::file::MeshFileError;
use crate::mechanics::mesh::generate::GenerateError;
use crate::mechanics::mesh::quality::UnusableMesh;
use crate::mechanics::needle::InvalidNeedleModel;
use crate::mechanics::tissue::error::LinearError;
use crate::mechanics::tissue::material::InvalidMaterial;
use crate::tracking::TrackingError;

/// Error of a scenario: the cause, the key concerned and its place in the file.
pub type ScenarioError = Fault<Wrong>;

/// Cause of a scenario error.
#[derive(Debug, thiserror::Error)]
pub enum Wrong {
    /// The file cannot be read or parsed.
    #[error(transparent)]
    Text(#[from] InvalidFile),
    /// An unknown region.
    #[error(transparent)]
    Region(#[from] NoRegion),
    /// The scene is invalid.
    #[error(transparent)]
    Scene(#[from] Problem),
    /// Nodes or axes selected by a table are invalid.
    #[error(transparent)]
    Nodes(#[from] statics::Wrong),
    /// The mesh file cannot be read.
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// The mesh can be read, but is unsuitable for computation.
    #[error(transparent)]
    Unusable(#[from] UnusableMesh),
    /// No mesh can be generated.
    #[error(transparent)]
    Generate(#[from] GenerateError),
    /// A material is invalid.
    #[error(transparent)]
    Material(#[from] InvalidMaterial),
    /// The interaction of a tissue with the needle is invalid.
    #[error(transparent)]
    Interaction(#[from] InvalidInteraction),
    /// Tissue is not sufficiently fixed.
    #[error(transparent)]
    Rigid(#[from] LinearError),
    /// The needle is invalid.
    #[error(transparent)]
    Needle(#[from] TrackingError),
    /// No model can be built for the needle.
    #[error(transparent)]
    NeedleModel(#[from] InvalidNeedleModel),
    /// No GPU is available.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// No model can be built for the tissue.
    #[error(transparent)]
    Setup(#[from] InvalidSetup),
    /// Mass-spring parameters are invalid.
    #[error(transparent)]
    Springs(#[from] InvalidParameters),
    /// The elements do not form a valid mesh.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
}

impl ScenarioError {
    /// Whether the machine is at fault rather than the input.
    pub fn is_machine(&self) -> bool {
        match self.problem() {
            Wrong::Text(error) => error.is_machine(),
            Wrong::Scene(problem) => problem.is_machine(),
            Wrong::MeshFile(error) => error.is_machine(),
            Wrong::Generate(error) => error.is_machine(),
            Wrong::Setup(error) => error.is_machine(),
            Wrong::Gpu(error) => error.is_machine(),
            _ => false,
        }
    }
}

impl ScenarioFile {
    /// Returns a number of this file if it is within its range.
    pub(super) fn number(
        &self,
        key: impl Into<String>,
        found: f64,
        holds: impl FnOnce(f64) -> bool,
        expected: &'static str,
    ) -> Result<f64, ScenarioError> {
        if found.is_finite() && holds(found) {
            Ok(found)
        } else {
            Err(self.fault(key, InvalidFile::number(found, expected)))
        }
    }

    /// Returns a direction vector of this file.
    pub(super) fn direction(
        &self,
        key: &str,
        found: [f64; 3],
    ) -> Result<nalgebra::Unit<nalgebra::Vector3<f64>>, ScenarioError> {
        let finite = found.iter().all(|x| x.is_finite());
        nalgebra::Unit::try_new(nalgebra::Vector3::from(found), 1e-9)
            .filter(|_| finite)
            .ok_or_else(|| {
                let expected = "finite numbers that are not all zero";
                self.wrong_keys(key, format!("{found:?}"), expected)
            })
    }

    /// Returns a point of this file.
    pub(super) fn place(&self, key: &str, found: [f64; 3]) -> Result<nalgebra::Point3<f64>, ScenarioError> {
        if found.iter().all(|x| x.abs() <= crate::base::matrix::FARTHEST_MM) {
            Ok(found.into())
        } else {
            let expected = "finite coordinates of at most 1e6 mm";
            Err(self.wrong_keys(key, format!("{found:?}"), expected))
        }
    }

    /// Converts an error of the scene, which lies in its own file or inline in this one.
    pub(super) fn of_scene(&self, error: SceneError, is_inline: bool) -> ScenarioError {
        let key = error.key().map(str::to_owned);
        let mut error = error.map(Wrong::Scene);
        if is_inline && key.as_deref() == Some("volume.file") && self.source.is_some() {
            let help = "the key `file` under [scene.volume] names the label file: put the path of your own there";
            error = error.with_help(Some(help.to_owned()));
        }
        match key {
            Some(key) if key.starts_with("needle") => error.at_key(key, self.source.as_ref()),
            Some(key) if is_inline => error.at_key(format!("scene.{key}"), self.source.as_ref()),
            _ => error,
        }
    }
}
