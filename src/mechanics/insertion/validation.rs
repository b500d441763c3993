//! Validation of the setup and of the step inputs of insertion models.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Matrix4, Rotation3, UnitQuaternion};

use super::spring::{MAX_NODES, MIN_DIHEDRAL_DEG};
use super::{Instruments, Interaction, Outcome, StepError};
use crate::tissue::error::LinearError;
use crate::tissue::nonlinear::NonlinearError;
use crate::tissue::remesh::RemeshError;
use insonify_base::blame::Blame;
use insonify_base::matrix;
use insonify_base::range::OutOfRange;
use insonify_mesh::TetMesh;

/// Reason why a model on a mesh cannot be set up.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidSetup {
    /// A number out of range in the interaction of a region with the needle.
    #[error("region {region}: {cause}")]
    Interaction {
        /// The region.
        region: i32,
        /// The invalid number.
        cause: OutOfRange,
    },
    /// A region whose interaction is listed more than once.
    #[error("region {region} has more than one interaction with the needle; expected one")]
    Twice {
        /// The region.
        region: i32,
    },
    /// No region with an interaction is one of the mesh.
    #[error(
        "no interaction with the needle is for a region of the mesh: listed are {listed:?}, the mesh has {regions:?}"
    )]
    Elsewhere {
        /// Regions with an interaction.
        listed: Vec<i32>,
        /// Regions of the mesh, at most eight of them.
        regions: Vec<i32>,
    },
    /// A mesh at most twice as long as the needle is thick, as one in metres is.
    #[error(
        "the mesh is {longest_mm} mm long at most, the needle {diameter_mm} mm thick; expected a mesh in mm (if its \
         coordinates are metres, multiply them by 1000)"
    )]
    Small {
        /// Longest side of the mesh, mm.
        longest_mm: f64,
        /// Diameter of the needle, mm.
        diameter_mm: f64,
    },
    /// A number out of range.
    #[error(transparent)]
    Number(#[from] OutOfRange),
    /// Rings, sectors and layers of a mass-spring cylinder make elements too thin for computation.
    #[error(
        "the cylinder's least dihedral angle is {found_deg:.2} degrees; expected at least {MIN_DIHEDRAL_DEG} \
         (make radius / rings and length / layers more alike)"
    )]
    Thin {
        /// The least angle between two faces of an element, degrees.
        found_deg: f64,
    },
    /// Rings, sectors and layers of a mass-spring cylinder make more nodes than the model supports.
    #[error("the cylinder has {found} nodes; expected at most {MAX_NODES}")]
    Large {
        /// Number of nodes.
        found: usize,
    },
    /// The entry of a needle that pushes tissue lies outside the body.
    #[error("the entry {entry:?} lies outside the body")]
    Outside {
        /// The entry, mm.
        entry: Vec<f64>,
    },
    /// The direction of a needle has zero length or is not finite.
    #[error("the direction {found:?} is not a direction; expected a finite vector that is not zero")]
    Direction {
        /// The rejected direction.
        found: Vec<f64>,
    },
    /// There are no layers along a needle, or the first does not begin at the entry.
    #[error("the first layer begins at {found:?} mm; expected 0")]
    First {
        /// Start of the first layer, if there is one.
        found: Option<f64>,
    },
    /// A layer begins before the one above, or a number of it is out of range.
    #[error("layer {layer}: {cause}")]
    Layer {
        /// Index of the layer, from 0.
        layer: usize,
        /// The invalid number.
        cause: OutOfRange,
    },
    /// A fixed node or axis that does not exist.
    #[error("node {node}, axis {axis} is to be fixed, but there are {nodes} nodes (numbered from 0) with axes 0 to 2")]
    Fixed {
        /// The node.
        node: u32,
        /// The axis.
        axis: u8,
        /// Number of nodes of the mesh.
        nodes: usize,
    },
    /// A candidate node of the probe that is missing, listed twice, or fixed.
    #[error("node {node} cannot be a candidate of the probe: it {reason}")]
    Candidate {
        /// The candidate node.
        node: u32,
        /// Description of the fault.
        reason: &'static str,
    },
    /// Supports that do not prevent rigid-body motion, or a stiffness that cannot be assembled, factored or inverted.
    #[error(transparent)]
    Linear(#[from] LinearError),
    /// A remeshing level that cannot be used.
    #[error(transparent)]
    Remesh(#[from] RemeshError),
    /// A mesh that does not form a body, a stiffness matrix that cannot be factored, or an invalid viscous memory.
    #[error(transparent)]
    Solver(#[from] NonlinearError),
}

impl Blame for InvalidSetup {
    fn is_machine(&self) -> bool {
        match self {
            Self::Linear(error) => error.is_machine(),
            Self::Remesh(error) => matches!(error, RemeshError::Device(_)),
            Self::Solver(error) => error.is_machine(),
            _ => false,
        }
    }
}

/// Checks the interactions of the regions of a mesh with the needle: each region once, numbers in range, and, if there
/// are any, at least one for a region of the mesh.
pub(super) fn interactions(mesh: &TetMesh, interactions: &[(i32, Interaction)]) -> Result<(), InvalidSetup> {
    let mut listed = BTreeSet::new();
    for (region, interaction) in interactions {
        let region = *region;
        if !listed.insert(region) {
            return Err(InvalidSetup::Twice { region });
        }
        let checked = interaction.check();
        checked.map_err(|cause| InvalidSetup::Interaction { region, cause })?;
    }
    if listed.is_empty() || mesh.regions().iter().any(|region| listed.contains(region)) {
        return Ok(());
    }
    let of_mesh: BTreeSet<i32> = mesh.regions().iter().copied().collect();
    Err(InvalidSetup::Elsewhere {
        listed: listed.into_iter().collect(),
        regions: of_mesh.into_iter().take(8).collect(),
    })
}

/// Checks that a mesh is more than twice as long as a needle is thick.
pub(super) fn size(mesh: &TetMesh, radius_mm: f64) -> Result<(), InvalidSetup> {
    let [low, high] = mesh.bounds();
    let longest_mm = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
    let diameter_mm = 2.0 * radius_mm;
    if longest_mm > 2.0 * diameter_mm {
        return Ok(());
    }
    Err(InvalidSetup::Small {
        longest_mm,
        diameter_mm,
    })
}

/// Checks that fixed nodes and axes exist in a mesh with this number of nodes.
pub(super) fn fixed(supports: &[(u32, u8)], nodes: usize) -> Result<(), InvalidSetup> {
    let missing = |(node, axis): &&(u32, u8)| *node as usize >= nodes || *axis > 2;
    match supports.iter().find(missing) {
        Some(&(node, axis)) => Err(InvalidSetup::Fixed { node, axis, nodes }),
        None => Ok(()),
    }
}

/// Checks that numbers are finite and above 0.
pub(super) fn above_zero(values: &[(&'static str, f64)]) -> Result<(), InvalidSetup> {
    match values.iter().find(|(_, found)| !(found.is_finite() && *found > 0.0)) {
        Some(&(key, found)) => Err(OutOfRange::new(key, found, "a finite number above 0").into()),
        None => Ok(()),
    }
}

/// Checks that the values of a step are finite.
fn finite(what: &'static str, values: impl IntoIterator<Item = f64>) -> Result<(), StepError> {
    match values.into_iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(found) => Err(StepError::Input {
            what,
            found,
            expected: "finite numbers",
        }),
    }
}

impl Outcome {
    /// Checks that forces and the tip are finite: a device must not be given others.
    ///
    /// # Errors
    /// [`StepError::Outcome`].
    pub fn check(&self) -> Result<(), StepError> {
        let probe = self.on_probe.unwrap_or_default();
        for (what, vector) in [
            ("the force on the hand", &self.on_hand.force_n),
            ("the torque on the hand", &self.on_hand.torque_nmm),
            ("the force on the probe", &probe.force_n),
            ("the torque on the probe", &probe.torque_nmm),
            ("the position of the tip", &self.tip_mm.coords),
        ] {
            if let Some(&found) = vector.iter().find(|number| !number.is_finite()) {
                return Err(StepError::Outcome { what, found });
            }
        }
        Ok(())
    }
}

/// Checks a pose, which an error calls `what`, as matrices in files are checked.
///
/// # Errors
/// [`StepError::Input`] and [`StepError::Pose`].
pub fn check_pose(what: &'static str, pose: &Isometry3<f64>) -> Result<(), StepError> {
    let numbers = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
    finite(what, numbers.copied())?;
    let rigid = matrix::rigid(&pose.to_homogeneous());
    rigid.map(drop).map_err(|reason| StepError::Pose { what, reason })
}

impl Instruments {
    /// A needle alone, by its base frame to world.
    pub fn new(base: Isometry3<f64>) -> Self {
        Self {
            base,
            probe: None,
            guide: None,
            deposit: false,
        }
    }

    /// A needle alone, by the matrix from its base frame to the world, on column vectors, mm. Rotations with errors of
    /// up to 5e-3 per entry are orthonormalised.
    ///
    /// # Errors
    /// [`StepError::Pose`], which says what is wrong with the matrix: a scale, a mirror, a transposition.
    pub fn from_matrix(base_to_world: &Matrix4<f64>) -> Result<Self, StepError> {
        let rigid = matrix::rigid(base_to_world).map_err(|reason| StepError::Pose { what: BASE, reason })?;
        let axes = Rotation3::from_matrix_unchecked(rigid.fixed_view::<3, 3>(0, 0).into_owned());
        let position = rigid.fixed_view::<3, 1>(0, 3).into_owned();
        Ok(Self::new(Isometry3::from_parts(
            position.into(),
            UnitQuaternion::from_rotation_matrix(&axes),
        )))
    }

    /// Checks the inputs of a step, as every model of this crate does.
    ///
    /// # Errors
    /// [`StepError::Input`] and [`StepError::Pose`].
    pub fn check(&self, dt_s: f64) -> Result<(), StepError> {
        check_pose(BASE, &self.base)?;
        if let Some(probe) = &self.probe {
            check_pose("the pose of the probe", probe)?;
        }
        if let Some(guide) = &self.guide {
            finite("the guide", guide.iter().copied())?;
        }
        if dt_s.is_finite() && dt_s > 0.0 {
            return Ok(());
        }
        Err(StepError::Input {
            what: "the time",
            found: dt_s,
            expected: "a finite number of seconds above 0",
        })
    }
}

/// The needle's base in errors.
pub(super) const BASE: &str = "the pose of the needle's base";
