//! Which corner of the element at the needle's tip is moved to the tip.

use super::adapted::{AdaptedMesh, RefusedMove};
use crate::mechanics::tissue::dofs::NONE;

/// The corner chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// The node to move.
    pub node: u32,
    /// The worst Jacobian condition among the tetrahedra around it after the move.
    pub condition: f64,
}

/// Why a node cannot be taken.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unfit {
    /// A displacement of it is prescribed.
    #[error("node {node} is fixed")]
    Fixed {
        /// The node.
        node: u32,
    },
    /// The caller keeps it: already in contact, or a candidate of the probe.
    #[error("node {node} is taken")]
    Taken {
        /// The node.
        node: u32,
    },
    /// The move would spoil an element.
    #[error(transparent)]
    Refused(RefusedMove),
}

/// Why no corner is chosen.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoCorner {
    /// There is no such element.
    #[error("element {element}, but there are only {elements} (numbered from 0)")]
    Element {
        /// The element given.
        element: u32,
        /// How many there are.
        elements: usize,
    },
    /// None of the nodes can be moved to the tip.
    #[error("no node can be moved to the tip at {tip:?} mm (element {element}): {}", list(.unfit))]
    NoneFits {
        /// The element entered.
        element: u32,
        /// Reference position of the tip, mm.
        tip: [f64; 3],
        /// What is wrong with each, in the order tried.
        unfit: Vec<Unfit>,
    },
}

fn list(unfit: &[Unfit]) -> String {
    unfit.iter().map(Unfit::to_string).collect::<Vec<_>>().join("; ")
}

/// The corner of `element` to move to `tip` (mm, reference state: see [`AdaptedMesh::point`]): each is tried, and the one whose
/// tetrahedra come out best, by the Jacobian condition of the worst of them, is taken; of equals, the lowest node (Goksel et
/// al. 2011, section VII). Fixed nodes and those that are `taken` (already in contact, candidates of the probe) are not
/// tried, and moves that the mesh would refuse do not count.
///
/// With the tip exactly on a vertex only that vertex can be moved, as every other corner would flatten an element; on an edge
/// or a face, its corners. The answer is the same every time, though it may differ between the elements that share the
/// vertex, edge or face: a locator that names the element decides.
///
/// # Errors
/// [`NoCorner`], with what is wrong with each corner.
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
