//! What every model on a mesh is given, and whether it can be used.

use super::{Interaction, InvalidInteraction};

/// Why a model cannot be made of what it is given.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidPart {
    /// What a region does to the needle has a number out of range.
    #[error("region {region}: {cause}")]
    Interaction {
        /// The region.
        region: i32,
        /// The number.
        cause: InvalidInteraction,
    },
    /// A number out of range.
    #[error("`{key}` is {found}; expected {expected}")]
    Number {
        /// Which.
        key: &'static str,
        /// As given.
        found: f64,
        /// Its range.
        expected: &'static str,
    },
    /// A fixed node or axis that is not there.
    #[error("node {node}, axis {axis} is to be fixed, but there are {nodes} nodes (numbered from 0) with axes 0 to 2")]
    Fixed {
        /// The node.
        node: u32,
        /// The axis.
        axis: u8,
        /// How many nodes there are.
        nodes: usize,
    },
}

/// Checks what regions do to the needle.
pub(super) fn interactions(given: &[(i32, Interaction)]) -> Result<(), InvalidPart> {
    let check = |(region, interaction): &(i32, Interaction)| {
        let region = *region;
        interaction
            .check()
            .map_err(|cause| InvalidPart::Interaction { region, cause })
    };
    given.iter().try_for_each(check)
}

/// Checks that what is fixed is there, among so many nodes.
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
