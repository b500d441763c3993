//! Mesh whose reference nodes are moved one at a time to the needle tip.
//!
//! A node has three positions. The *original* one is that of the mesh as loaded, to which a restored node returns. The
//! *base* is that of the mesh whose inverse or factor is available. The *current* one is where the node has been moved
//! to. The base is the original mesh.

mod moves;

pub(super) use moves::Record;

use std::sync::Arc;

use faer::Mat;

use super::difference::Difference;
use crate::tissue::assembly::Stiffness;
use crate::tissue::dofs::{Dofs, NO_DOF};
use crate::tissue::element::Shape;
use crate::tissue::error::LinearError;
use crate::tissue::material::Material;
use crate::tissue::remesh::RemeshError;
use insonify_mesh::TetMesh;
use insonify_mesh::lists::Lists;

/// Largest Jacobian condition that a move may cause.
///
/// At 1,000 a tetrahedron is about a thousand times longer than high: a few micrometres in a tissue mesh, far below
/// meaningful positions in tissue. The condition of its stiffness grows with the square, to 1e6, which with the 1e4 or
/// so of the mesh itself leaves about six of sixteen digits: accepted meshes are still solved well.
pub const CONDITION_LIMIT: f64 = 1e3;

/// Mesh in its original, base and current reference states, with the adjacency needed to find quickly what a move
/// changes.
#[derive(Clone, Debug)]
pub struct AdaptedMesh {
    original: Vec<[f64; 3]>,
    base: Vec<[f64; 3]>,
    nodes: Vec<[f64; 3]>,
    /// Stiffness of the base.
    stiffness: Arc<Stiffness>,
    around: Arc<Around>,
    /// Number of nodes away from their base among the neighbours of each node.
    touched: Vec<u32>,
    /// Nodes away from their base, ascending.
    away: Vec<u32>,
    /// Moves not undone, each with the node's previous position.
    moves: Vec<(u32, [f64; 3])>,
    condition_limit: f64,
    step: u64,
    /// Buffer for the next change.
    spare: Option<Change>,
}

impl AdaptedMesh {
    /// Creates the mesh with every node at its base, given one material per element.
    ///
    /// # Errors
    /// [`LinearError`] where a list does not match the mesh or an element is flat or inverted.
    pub fn new(mesh: &TetMesh, materials: &[Material], dofs: &Dofs) -> Result<AdaptedMesh, LinearError> {
        let stiffness = Arc::new(Stiffness::assemble(mesh, materials, dofs)?);
        let count = mesh.nodes().len();
        Ok(AdaptedMesh {
            original: mesh.nodes().to_vec(),
            base: mesh.nodes().to_vec(),
            nodes: mesh.nodes().to_vec(),
            stiffness,
            around: Arc::new(Around::new(mesh.elements(), count)),
            touched: vec![0; count],
            away: Vec::new(),
            moves: Vec::new(),
            condition_limit: CONDITION_LIMIT,
            step: 0,
            spare: None,
        })
    }

    /// Replaces the limit of the Jacobian condition, [`CONDITION_LIMIT`] by default (1 or more).
    #[must_use]
    pub fn with_condition_limit(self, condition_limit: f64) -> AdaptedMesh {
        AdaptedMesh {
            condition_limit,
            ..self
        }
    }

    /// Current reference positions, mm.
    pub fn nodes(&self) -> &[[f64; 3]] {
        &self.nodes
    }

    /// Reference positions of the base, mm.
    pub fn base(&self) -> &[[f64; 3]] {
        &self.base
    }

    /// Node indices of the elements.
    pub fn elements(&self) -> &[[u32; 4]] {
        self.stiffness.elements()
    }

    /// Stiffness of the base.
    pub fn stiffness(&self) -> &Arc<Stiffness> {
        &self.stiffness
    }

    /// Degrees of freedom of the mesh.
    pub fn dofs(&self) -> &Dofs {
        self.stiffness.dofs()
    }

    /// Number of changes so far; undoing a move is a change.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// Nodes away from their base, ascending.
    pub fn away(&self) -> &[u32] {
        &self.away
    }

    /// Moves not undone, oldest first: the node, and its position before the move (mm).
    pub fn moves(&self) -> &[(u32, [f64; 3])] {
        &self.moves
    }

    /// Nodes that share an element with `node`, including itself, ascending.
    ///
    /// # Panics
    /// If the node does not exist.
    pub fn neighbours(&self, node: u32) -> &[u32] {
        self.around.neighbours(node)
    }

    /// Whether the current stiffness may differ from that of the base in the rows of `node`.
    ///
    /// # Panics
    /// If the node does not exist.
    pub(crate) fn is_touched(&self, node: u32) -> bool {
        self.touched[node as usize] > 0
    }

    /// Free degrees of freedom of all touched nodes, ascending.
    pub fn support(&self) -> impl Iterator<Item = u32> + '_ {
        let touched = (0..self.touched.len() as u32).filter(|node| self.is_touched(*node));
        touched
            .flat_map(|node| self.dofs().of(node))
            .filter(|dof| *dof != NO_DOF)
    }

    /// Free degrees of freedom of `node` and its neighbours, ascending: those affected by a move of it.
    ///
    /// # Panics
    /// If the node does not exist.
    pub(crate) fn support_of(&self, node: u32) -> impl Iterator<Item = u32> + '_ {
        let dofs = self.neighbours(node).iter().flat_map(|node| self.dofs().of(*node));
        dofs.filter(|dof| *dof != NO_DOF)
    }

    /// Elements around a node, with its place in each.
    pub(super) fn elements_around(&self, node: u32) -> impl Iterator<Item = (u32, usize)> + '_ {
        self.around.elements(node)
    }

    /// Reference position of a point with these barycentric coordinates in an element (mm).
    ///
    /// # Panics
    /// If the element does not exist.
    pub fn point(&self, element: u32, barycentric: [f64; 4]) -> [f64; 3] {
        let corners = self.elements()[element as usize];
        std::array::from_fn(|axis| {
            let terms = corners.iter().zip(barycentric);
            terms
                .map(|(node, weight)| weight * self.nodes[*node as usize][axis])
                .sum()
        })
    }

    /// Computes K(now) - K(base) from scratch.
    pub fn difference(&self) -> Difference {
        let mut difference = Difference::default();
        self.difference_into(&mut difference);
        difference
    }

    /// Computes [`difference`](Self::difference) in existing memory.
    pub(crate) fn difference_into(&self, difference: &mut Difference) {
        difference.assemble(self);
    }

    /// Corner positions of an element.
    pub(super) fn positions(&self, element: u32, nodes: &[[f64; 3]]) -> [[f64; 3]; 4] {
        self.elements()[element as usize].map(|node| nodes[node as usize])
    }
}

/// Elements and neighbours of every node. They depend only on the elements, so moves do not change them.
#[derive(Clone, Debug)]
struct Around {
    /// Corners of each node; a corner is four times its element plus its place there.
    corners: Lists,
    neighbours: Lists,
}

impl Around {
    pub(crate) fn new(elements: &[[u32; 4]], nodes: usize) -> Around {
        let corners = Lists::corners(elements, nodes);
        let mut pairs = Vec::with_capacity(16 * nodes);
        let mut neighbours: Vec<u32> = Vec::new();
        for node in 0..nodes as u32 {
            neighbours.clear();
            neighbours.extend(
                corners
                    .get(node)
                    .iter()
                    .flat_map(|corner| elements[*corner as usize / 4]),
            );
            neighbours.sort_unstable();
            neighbours.dedup();
            pairs.extend(neighbours.iter().map(|&neighbour| (node, neighbour)));
        }
        Around {
            corners,
            neighbours: Lists::new(nodes, pairs.iter().copied()),
        }
    }

    /// Nodes of the elements of `node`, including itself, ascending.
    pub(crate) fn neighbours(&self, node: u32) -> &[u32] {
        self.neighbours.get(node)
    }

    /// Elements of a node, with its place in each.
    pub(crate) fn elements(&self, node: u32) -> impl Iterator<Item = (u32, usize)> + '_ {
        let corners = self.corners.get(node).iter();
        corners.map(|corner| (corner / 4, *corner as usize % 4))
    }
}

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
    fn none() -> Change {
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
    fn fill(mut self, mesh: &AdaptedMesh, node: u32, to: [f64; 3]) -> Result<Change, RemeshError> {
        let dofs = mesh.dofs();
        self.support.clear();
        self.support.extend(mesh.support_of(node));
        let (support, size) = (&self.support, self.support.len());
        let stiffness = &mut self.stiffness;
        stiffness.truncate(0, 0);
        stiffness.resize_with(size, size, |_, _| 0.0);
        for (element, moved_corner) in mesh.elements_around(node) {
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
            positions[moved_corner] = to;
            let after = Shape::of(&positions).map_err(refused)?;
            let material = &mesh.stiffness().materials()[element as usize];
            let (weights_before, weights_after) = (before.weights(material), after.weights(material));
            // Fixed degrees of freedom have no place: the inverse is that of the free ones.
            let places = corners.map(|corner| dofs.of(corner).map(|dof| support.binary_search(&dof).ok()));
            for (a, b) in (0..16).map(|pair| (pair / 4, pair % 4)) {
                let old = before.block(weights_before, a, b);
                let new = after.block(weights_after, a, b);
                for (i, j) in (0..9).map(|entry| (entry / 3, entry % 3)) {
                    if let (Some(row), Some(column)) = (places[a][i], places[b][j]) {
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

#[cfg(test)]
mod tests;
