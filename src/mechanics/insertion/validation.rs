//! Validation of the inputs common to all models on a mesh.

use nalgebra::Isometry3;

use super::{Interaction, InvalidInteraction, StepError};

/// Reason why an input common to all models on a mesh cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidPart {
    /// A number out of range in the interaction of a region with the needle.
    #[error("region {region}: {cause}")]
    Interaction {
        /// The region.
        region: i32,
        /// The invalid number.
        cause: InvalidInteraction,
    },
    /// A number out of range.
    #[error("`{key}` is {found}; expected {expected}")]
    Number {
        /// Name of the number.
        key: &'static str,
        /// The rejected value.
        found: f64,
        /// Permitted range.
        expected: &'static str,
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
}

/// Checks the interactions of regions with the needle.
pub(super) fn interactions(given: &[(i32, Interaction)]) -> Result<(), InvalidPart> {
    let check = |(region, interaction): &(i32, Interaction)| {
        let region = *region;
        interaction
            .check()
            .map_err(|cause| InvalidPart::Interaction { region, cause })
    };
    given.iter().try_for_each(check)
}

/// Checks that fixed nodes and axes exist in a mesh of so many nodes.
pub(super) fn fixed(given: &[(u32, u8)], nodes: usize) -> Result<(), InvalidPart> {
    let missing = |(node, axis): &&(u32, u8)| *node as usize >= nodes || *axis > 2;
    match given.iter().find(missing) {
        Some(&(node, axis)) => Err(InvalidPart::Fixed { node, axis, nodes }),
        None => Ok(()),
    }
}

/// Checks that numbers are finite and above 0.
pub(super) fn above_zero(given: &[(&'static str, f64)]) -> Result<(), InvalidPart> {
    match given.iter().find(|(_, found)| !(found.is_finite() && *found > 0.0)) {
        Some(&(key, found)) => Err(InvalidPart::Number {
            key,
            found,
            expected: "a finite number above 0",
        }),
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
