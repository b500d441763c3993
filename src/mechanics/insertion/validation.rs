//! Validation of the setup and of the step inputs of insertion models.

use nalgebra::Isometry3;

use super::spring::{MAX_NODES, MIN_DIHEDRAL_DEG};
use super::{Interaction, StepError};
use crate::tissue::error::LinearError;
use crate::tissue::nonlinear::NonlinearError;
use crate::tissue::remesh::RemeshError;
use insonify_base::blame::Blame;
use insonify_base::range::OutOfRange;

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
    /// An interaction with a `peak`, which the model of stiffening tissue does not support.
    #[error("region {region} has a `peak` of force near the tip, which nonlinear tissue does not support")]
    Peak {
        /// The region.
        region: i32,
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

/// Checks the interactions of regions with the needle.
pub(super) fn interactions(interactions: &[(i32, Interaction)]) -> Result<(), InvalidSetup> {
    let check = |(region, interaction): &(i32, Interaction)| {
        let region = *region;
        interaction
            .check()
            .map_err(|cause| InvalidSetup::Interaction { region, cause })
    };
    interactions.iter().try_for_each(check)
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
pub(super) fn finite(what: &'static str, values: impl IntoIterator<Item = f64>) -> Result<(), StepError> {
    match values.into_iter().find(|value| !value.is_finite()) {
        None => Ok(()),
        Some(found) => Err(StepError::Input {
            what,
            found,
            expected: "finite numbers",
        }),
    }
}

/// Returns all numbers of a pose.
pub(super) fn numbers(pose: &Isometry3<f64>) -> impl Iterator<Item = f64> {
    pose.to_homogeneous().data.0.into_iter().flatten()
}
