//! Choice of the element corner to move to the needle tip.

use super::adapted::{AdaptedMesh, RefusedMove};
use crate::mechanics::tissue::dofs::NONE;

/// Corner chosen to be moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Node to move.
    pub node: u32,
    /// Worst Jacobian condition among the tetrahedra around the node after the move.
    pub condition: f64,
}

/// Why a node cannot be moved to the tip.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unfit {
    /// A displacement of the node is prescribed.
    #[error("node {node} is fixed")]
    Fixed {
        /// Index of the node.
        node: u32,
    },
    /// The caller reserves the node: it is already in contact, or a candidate of the probe.
    #[error("node {node} is taken")]
    Taken {
        /// Index of the node.
        node: u32,
    },
    /// The move would spoil an element.
    #[error(transparent)]
    Refused(RefusedMove),
}

/// Why no corner was chosen.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoCorner {
    /// The element does not exist.
    #[error("element {element}, but there are only {elements} (numbered from 0)")]
    Element {
        /// Element given.
        element: u32,
        /// Number of elements.
        elements: usize,
    },
    /// None of the nodes can be moved to the tip.
    #[error("no node can be moved to the tip at {tip:?} mm (element {element}): {}", list(.unfit))]
    NoneFits {
        /// Element that the tip entered.
        element: u32,
        /// Reference position of the tip, mm.
        tip: [f64; 3],
        /// Reason for each corner, in the order tried.
        unfit: Vec<Unfit>,
    },
}

fn list(unfit: &[Unfit]) -> String {
    unfit.iter().map(Unfit::to_string).collect::<Vec<_>>().join("; ")
}

/// Chooses the corner of `element` to move to `tip` (mm, reference state: see [`AdaptedMesh::point`]). The choice is
/// the corner after whose move the worst tetrahedron around it has the best Jacobian condition; of equals, the lowest
/// node (Goksel et al. 2011, section VII). Fixed nodes and those that are `taken` (already in contact, candidates of
/// the probe) are excluded, as are moves that the mesh would refuse.
///
/// With the tip exactly on a vertex only that vertex can be moved, as every other corner would flatten an element; on
/// an edge or a face, only its corners. The result is deterministic, but may differ between the elements that share the
/// vertex, edge or face; it then depends on which of them the point location returns.
///
/// # Errors
/// [`NoCorner`], with the reason for each corner.
pub fn best_corner(
    mesh: &AdaptedMesh,
    element: u32,
    tip: [f64; 3],
    taken: impl Fn(u32) -> bool,
) -> Result<Corner, NoCorner> {
    let mut corners = corners_of(mesh, element)?;
    corners.sort_unstable();
    let mut best: Option<Corner> = None;
    let mut unfit = Vec::new();
    for node in corners {
        match try_node(mesh, node, tip, &taken) {
            Ok(corner) if best.is_none_or(|best| corner.condition < best.condition) => best = Some(corner),
            Ok(_) => {}
            Err(reason) => unfit.push(reason),
        }
    }
    best.ok_or(NoCorner::NoneFits { element, tip, unfit })
}

fn corners_of(mesh: &AdaptedMesh, element: u32) -> Result<[u32; 4], NoCorner> {
    let elements = mesh.elements();
    let corners = elements.get(element as usize).copied();
    corners.ok_or(NoCorner::Element {
        element,
        elements: elements.len(),
    })
}

fn try_node(mesh: &AdaptedMesh, node: u32, tip: [f64; 3], taken: &impl Fn(u32) -> bool) -> Result<Corner, Unfit> {
    if mesh.dofs().of(node).contains(&NONE) {
        return Err(Unfit::Fixed { node });
    }
    if taken(node) {
        return Err(Unfit::Taken { node });
    }
    let condition = mesh.assess(node, tip).map_err(Unfit::Refused)?;
    Ok(Corner { node, condition })
}

#[cfg(test)]
mod tests;
