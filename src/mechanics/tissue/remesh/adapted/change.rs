//! Stiffness change due to the move of one node.

use crate::mechanics::tissue::remesh::RemeshError;
use faer::Mat;

use super::AdaptedMesh;
use crate::mechanics::tissue::element::Shape;

/// Effects of the move of one node.
#[derive(Clone, Debug)]
pub struct Change {
    /// Moved node.
    pub node: u32,
    /// Position before the move, mm.
    pub from: [f64; 3],
    /// Position after the move, mm.
    pub to: [f64; 3],
    /// Free degrees of freedom of the node and its neighbours, ascending; the stiffness changes only in these rows and
    /// columns.
    pub support: Vec<u32>,
    /// K(now) - K(before) at the rows and columns of the support, N/mm; exactly symmetric.
    pub stiffness: Mat<f64>,
    /// Number of this change: steps of the mesh up to it.
    pub step: u64,
}

impl Change {
    /// Returns an empty change without memory.
    pub(super) fn none() -> Change {
        Change {
            node: 0,
            from: [0.0; 3],
            to: [0.0; 3],
            support: Vec::new(),
            stiffness: Mat::new(),
            step: 0,
        }
    }

    /// Computes the effects of moving `node` to `to` from the elements around it, reusing the memory of `self`.
    pub(super) fn fill(mut self, mesh: &AdaptedMesh, node: u32, to: [f64; 3]) -> Result<Change, RemeshError> {
        let dofs = mesh.dofs();
        self.support.clear();
        self.support.extend(mesh.support_of(node));
        let (support, size) = (&self.support, self.support.len());
        let stiffness = &mut self.stiffness;
        stiffness.truncate(0, 0);
        stiffness.resize_with(size, size, |_, _| 0.0);
        for (element, place) in mesh.elements_around(node) {
            let corners = mesh.elements()[element as usize];
            let mut positions = mesh.positions(element, mesh.nodes());
            let refused = |cause| RemeshError::Element {
                node,
                to,
                element,
                corners,
                cause,
            };
            let before = Shape::of(&positions).map_err(refused)?;
            positions[place] = to;
            let after = Shape::of(&positions).map_err(refused)?;
            let material = &mesh.stiffness().materials()[element as usize];
            let (weights_before, weights_after) = (before.weights(material), after.weights(material));
            let own = corners.map(|corner| dofs.of(corner).map(|dof| support.binary_search(&dof).ok()));
            for (a, b) in (0..16).map(|pair| (pair / 4, pair % 4)) {
                let old = before.block(weights_before, a, b);
                let new = after.block(weights_after, a, b);
                for (i, j) in (0..9).map(|entry| (entry / 3, entry % 3)) {
                    if let (Some(row), Some(column)) = (own[a][i], own[b][j]) {
                        stiffness[(row, column)] += new[i][j] - old[i][j];
                    }
                }
            }
        }
        Ok(Change {
            node,
            from: mesh.nodes()[node as usize],
            to,
            step: mesh.step() + 1,
            ..self
        })
    }
}
