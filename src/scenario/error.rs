//! What can be wrong with a scenario file.

use super::file::ScenarioFile;
use crate::document::{Fault, NoRegion, Unreadable};
use crate::gpu::GpuError;
use crate::mechanics::insertion::finite::InvalidSetup;
use crate::mechanics::insertion::spring::InvalidParameters;
use crate::mechanics::insertion::{InvalidInteraction, nonlinear};
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::mesh::file::MeshFileError;
use crate::mechanics::mesh::generate::GenerateError;
use crate::mechanics::mesh::quality::UnusableMesh;
use crate::mechanics::needle::InvalidNeedleModel;
use crate::mechanics::tissue::material::InvalidMaterial;
use crate::mechanics::tissue::nonlinear::InvalidStiffening;
use crate::mechanics::tissue::rigid::RigidError;
use crate::scene::{Problem, SceneError};
use crate::statics;
use crate::tracking::needle::InvalidNeedle;

/// Why a scenario cannot be run: what is wrong, the key that it is about and where that stands in the file.
pub type ScenarioError = Fault<Wrong>;

/// What is wrong with a scenario.
#[derive(Debug, thiserror::Error)]
pub enum Wrong {
    /// The file cannot be read, or says what no scenario says.
    #[error(transparent)]
    Text(#[from] Unreadable),
    /// Keys that contradict each other, or do not say enough.
    #[error("found {found}; expected {expected}")]
    Keys {
        /// What is there.
        found: String,
        /// What should be.
        expected: String,
    },
    /// A number outside its range.
    #[error("found {found}; expected {expected}")]
    Number {
        /// The number.
        found: f64,
        /// The range.
        expected: &'static str,
    },
    /// A region that is not there.
    #[error(transparent)]
    Region(#[from] NoRegion),
    /// The scene is wrong.
    #[error(transparent)]
    Scene(#[from] Problem),
    /// Nodes that a table means, or axes.
    #[error(transparent)]
    Nodes(#[from] statics::Wrong),
    /// The mesh cannot be read.
    #[error(transparent)]
    MeshFile(#[from] MeshFileError),
    /// The mesh can be read, but not calculated on.
    #[error(transparent)]
    Unusable(#[from] UnusableMesh),
    /// No mesh can be made.
    #[error(transparent)]
    Generate(#[from] GenerateError),
    /// A material is none.
    #[error(transparent)]
    Material(#[from] InvalidMaterial),
    /// A tissue cannot act on a needle so.
    #[error(transparent)]
    Interaction(#[from] InvalidInteraction),
    /// Tissue that nothing holds.
    #[error(transparent)]
    Rigid(#[from] RigidError),
    /// The needle is wrong.
    #[error(transparent)]
    Needle(#[from] InvalidNeedle),
    /// No model can be made of the needle.
    #[error(transparent)]
    NeedleModel(#[from] InvalidNeedleModel),
    /// No GPU can be had.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// No model can be made of the tissue.
    #[error(transparent)]
    Setup(#[from] InvalidSetup),
    /// No model can be made of tissue that stiffens.
    #[error(transparent)]
    Stiffened(#[from] nonlinear::InvalidSetup),
    /// Tissue stiffens as none can.
    #[error(transparent)]
    Stiffening(#[from] InvalidStiffening),
    /// No masses and springs can be made.
    #[error(transparent)]
    Springs(#[from] InvalidParameters),
    /// Elements that make no mesh.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
}

impl ScenarioError {
    /// Whether the machine failed rather than the input.
    pub fn is_machine(&self) -> bool {
        match self.problem() {
            Wrong::Text(error) => error.is_machine(),
            Wrong::Scene(problem) => problem.is_machine(),
            Wrong::MeshFile(error) => error.is_machine(),
            Wrong::Generate(error) => error.is_machine(),
            Wrong::Setup(error) => error.is_machine(),
            Wrong::Gpu(error) => error.is_machine(),
            Wrong::Stiffened(error) => error.is_machine(),
            _ => false,
        }
    }
}

impl ScenarioFile {
    /// An error about a key of this file.
    pub(super) fn fault(&self, key: impl Into<String>, wrong: impl Into<Wrong>) -> ScenarioError {
        ScenarioError::new(wrong).at_key(key, self.source.as_ref())
    }

    /// As [`ScenarioFile::fault`], for keys that contradict each other or do not say enough.
    pub(super) fn wrong_keys(
        &self,
        key: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> ScenarioError {
        let (found, expected) = (found.into(), expected.into());
        self.fault(key, Wrong::Keys { found, expected })
    }

    /// A number of this file, which must hold what is expected of it.
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
            Err(self.fault(key, Wrong::Number { found, expected }))
        }
    }

    /// A vector of this file that gives a direction.
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

    /// A place of this file.
    pub(super) fn place(&self, key: &str, found: [f64; 3]) -> Result<nalgebra::Point3<f64>, ScenarioError> {
        if found.iter().all(|x| x.abs() <= crate::tracking::matrix::FARTHEST_MM) {
            Ok(found.into())
        } else {
            let expected = "finite coordinates of at most 1e6 mm";
            Err(self.wrong_keys(key, format!("{found:?}"), expected))
        }
    }

    /// An error of the scene: of its own file, or of the part of this one that it was made from.
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
