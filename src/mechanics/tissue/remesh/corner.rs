//! Choice of the element corner to move to the needle tip.

use super::adapted::AdaptedMesh;
use crate::tissue::dofs::NO_DOF;
use crate::tissue::remesh::RemeshError;

/// Corner chosen to be moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    /// Node to move.
    pub node: u32,
    /// Worst Jacobian condition among the tetrahedra around the node after the move.
    pub condition: f64,
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
/// [`RemeshError`], with the reason for each corner.
pub fn best_corner(
    mesh: &AdaptedMesh,
    element: u32,
    tip: [f64; 3],
    is_taken: impl Fn(u32) -> bool,
) -> Result<Corner, RemeshError> {
    let mut corners = corners_of(mesh, element)?;
    corners.sort_unstable();
    let mut best: Option<Corner> = None;
    let mut unfit = Vec::new();
    for node in corners {
        match try_node(mesh, node, tip, &is_taken) {
            Ok(corner) if best.is_none_or(|best| corner.condition < best.condition) => best = Some(corner),
            Ok(_) => {}
            Err(reason) => unfit.push(reason),
        }
    }
    best.ok_or(RemeshError::NoCorner { element, tip, unfit })
}

fn corners_of(mesh: &AdaptedMesh, element: u32) -> Result<[u32; 4], RemeshError> {
    let elements = mesh.elements();
    let corners = elements.get(element as usize).copied();
    corners.ok_or(RemeshError::NoElement {
        element,
        elements: elements.len(),
    })
}

fn try_node(
    mesh: &AdaptedMesh,
    node: u32,
    tip: [f64; 3],
    is_taken: &impl Fn(u32) -> bool,
) -> Result<Corner, RemeshError> {
    if mesh.dofs().of(node).contains(&NO_DOF) {
        return Err(RemeshError::Fixed { node });
    }
    if is_taken(node) {
        return Err(RemeshError::Taken { node });
    }
    let condition = mesh.assess(node, tip)?;
    Ok(Corner { node, condition })
}

#[cfg(test)]
mod tests;
