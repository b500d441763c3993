//! A mesh whose reference nodes move one at a time to where the needle's tip is.
//!
//! Three positions of a node matter. The *original* one is that of the mesh as loaded: a restored node returns there. The
//! *base* is the mesh of which an inverse or a factor is at hand. The *current* one is where the node has been moved to. The
//! base is the original mesh until it is replaced (see [`rebase`](super::rebase)).

mod change;
mod refused;

use std::sync::Arc;

use super::difference::Difference;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::quality::jacobian_condition;
use crate::mechanics::tissue::assembly::{AssemblyError, Stiffness, corners_by_node};
use crate::mechanics::tissue::dofs::{Dofs, NONE};
use crate::mechanics::tissue::element::Shape;
use crate::mechanics::tissue::material::Material;
pub use change::Change;
pub use refused::RefusedMove;

/// The largest Jacobian condition that a move may bring about.
///
/// At 1,000 a tetrahedron is about a thousand times longer than high: a few micrometres in a tissue mesh, far below what
/// positions in tissue mean. The condition of its stiffness grows with the square, to 1e6, which with the 1e4 or so of the
/// mesh itself leaves about six of sixteen digits: what passes here is still solved well.
pub const CONDITION_LIMIT: f64 = 1e3;

/// A mesh in its original, base and current reference states, and what is needed to find quickly what a move changes.
#[derive(Clone, Debug)]
pub struct AdaptedMesh {
    original: Vec<[f64; 3]>,
    pub(super) base: Vec<[f64; 3]>,
    pub(super) nodes: Vec<[f64; 3]>,
    pub(super) stiffness: Arc<Stiffness>,
    /// Where each node's corners begin; a corner is four times its element plus its place there.
    firsts: Vec<u32>,
    corners: Vec<u32>,
    /// Where each node's neighbours begin, and the neighbours: all nodes of its elements, itself too, ascending.
    neighbour_firsts: Vec<u32>,
    neighbours: Vec<u32>,
    /// How many nodes away from their base have each node among their neighbours.
    touched: Vec<u32>,
    /// Nodes away from their base, ascending.
    away: Vec<u32>,
    /// Moves not undone, each with the position before it.
    moves: Vec<(u32, [f64; 3])>,
    condition_limit: f64,
    step: u64,
}

impl AdaptedMesh {
    /// The mesh with every node at its base; `materials` one an element.
    ///
    /// # Errors
    /// [`AssemblyError`] where a list does not match the mesh or an element is flat or inverted.
    pub fn new(mesh: &TetMesh, materials: &[Material], dofs: &Dofs) -> Result<AdaptedMesh, AssemblyError> {
        let stiffness = Arc::new(Stiffness::assemble(mesh, materials, dofs)?);
        let count = mesh.nodes().len();
        let (firsts, corners) = corners_by_node(mesh.elements(), count);
        let mut neighbour_firsts = vec![0];
        let mut neighbours: Vec<u32> = Vec::with_capacity(16 * count);
        for node in 0..count {
            let around = &corners[firsts[node] as usize..firsts[node + 1] as usize];
            let start = neighbours.len();
            neighbours.extend(around.iter().flat_map(|corner| mesh.elements()[*corner as usize / 4]));
            neighbours[start..].sort_unstable();
            let mut kept = start;
            for at in start..neighbours.len() {
                if kept == start || neighbours[at] != neighbours[kept - 1] {
                    neighbours[kept] = neighbours[at];
                    kept += 1;
                }
            }
            neighbours.truncate(kept);
            neighbour_firsts.push(kept as u32);
        }
        Ok(AdaptedMesh {
            original: mesh.nodes().to_vec(),
            base: mesh.nodes().to_vec(),
            nodes: mesh.nodes().to_vec(),
            stiffness,
            firsts,
            corners,
            neighbour_firsts,
            neighbours,
            touched: vec![0; count],
            away: Vec::new(),
            moves: Vec::new(),
            condition_limit: CONDITION_LIMIT,
            step: 0,
        })
    }

    /// The same with another limit of the Jacobian condition than [`CONDITION_LIMIT`] (1 or more).
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

    /// The stiffness of the base.
    pub fn stiffness(&self) -> &Arc<Stiffness> {
        &self.stiffness
    }

    /// The degrees of freedom.
    pub fn dofs(&self) -> &Dofs {
        self.stiffness.dofs()
    }

    /// Changes made so far, undone moves counted as changes.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// Nodes that are not where the base has them, ascending.
    pub fn away(&self) -> &[u32] {
        &self.away
    }

    /// Moves that are not undone, oldest first: the node, and its position before the move (mm).
    pub fn moves(&self) -> &[(u32, [f64; 3])] {
        &self.moves
    }

    /// All nodes that share an element with `node`, itself among them, ascending.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn neighbours(&self, node: u32) -> &[u32] {
        let node = node as usize;
        &self.neighbours[self.neighbour_firsts[node] as usize..self.neighbour_firsts[node + 1] as usize]
    }

    /// Whether the current stiffness may differ from that of the base in the rows of `node`.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn is_touched(&self, node: u32) -> bool {
        self.touched[node as usize] > 0
    }

    /// Free degrees of freedom of all touched nodes, ascending.
    pub fn support(&self) -> impl Iterator<Item = u32> + '_ {
        let touched = (0..self.touched.len() as u32).filter(|node| self.is_touched(*node));
        touched.flat_map(|node| self.dofs().of(node)).filter(|dof| *dof != NONE)
    }

    /// The elements around a node and its place in each.
    pub(super) fn around(&self, node: u32) -> impl Iterator<Item = (u32, usize)> + '_ {
        let node = node as usize;
        let corners = &self.corners[self.firsts[node] as usize..self.firsts[node + 1] as usize];
        corners.iter().map(|corner| (corner / 4, *corner as usize % 4))
    }

    /// Reference position of the point with these barycentric coordinates in an element (mm).
    ///
    /// # Panics
    /// If there is no such element.
    pub fn point(&self, element: u32, barycentric: [f64; 4]) -> [f64; 3] {
        let corners = self.elements()[element as usize];
        std::array::from_fn(|axis| {
            let terms = corners.iter().zip(barycentric);
            terms
                .map(|(node, weight)| weight * self.nodes[*node as usize][axis])
                .sum()
        })
    }

    /// The worst Jacobian condition among the tetrahedra around `node` after it were moved to `to` (mm): what the choice of a
    /// corner goes by. Nothing is moved.
    ///
    /// # Errors
    /// [`RefusedMove`], as [`move_node`](Self::move_node) would refuse.
    pub fn assess(&self, node: u32, to: [f64; 3]) -> Result<f64, RefusedMove> {
        let nodes = self.nodes.len();
        if node as usize >= nodes {
            return Err(RefusedMove::Node { node, nodes });
        }
        if to.iter().any(|x| !x.is_finite()) {
            return Err(RefusedMove::Position { node, to });
        }
        let (mut worst, mut thinnest, mut before) = (0.0, 0, 0.0f64);
        for (element, place) in self.around(node) {
            let mut positions = self.positions(element, &self.nodes);
            before = before.max(jacobian_condition(&positions));
            positions[place] = to;
            if let Err(cause) = Shape::of(&positions) {
                let corners = self.elements()[element as usize];
                return Err(RefusedMove::Element {
                    node,
                    to,
                    element,
                    corners,
                    cause,
                });
            }
            let condition = jacobian_condition(&positions);
            if condition > worst {
                (worst, thinnest) = (condition, element);
            }
        }
        // A move that betters elements which were too thin from the start is welcome.
        if worst > self.condition_limit && worst > before {
            return Err(RefusedMove::Condition {
                node,
                to,
                element: thinnest,
                condition: worst,
                limit: self.condition_limit,
            });
        }
        Ok(worst)
    }

    /// Moves a node to `to` (mm).
    ///
    /// # Errors
    /// [`RefusedMove`] when an element would be inverted or flat, or thinner than the limit allows and thinner than any
    /// around the node was before.
    pub fn move_node(&mut self, node: u32, to: [f64; 3]) -> Result<Change, RefusedMove> {
        self.assess(node, to)?;
        let from = self.nodes[node as usize];
        let change = self.shift(node, to)?;
        self.moves.push((node, from));
        Ok(change)
    }

    /// Moves a node back to its original position and forgets its moves.
    ///
    /// # Errors
    /// [`RefusedMove`] when that would invert or flatten an element, as other nodes have moved since.
    pub fn restore(&mut self, node: u32) -> Result<Change, RefusedMove> {
        let nodes = self.nodes.len();
        let to = self.original.get(node as usize);
        let change = self.shift(node, *to.ok_or(RefusedMove::Node { node, nodes })?)?;
        self.moves.retain(|(moved, _)| *moved != node);
        Ok(change)
    }

    /// Takes back the last move; `None` when there is none. In the reverse order of the moves this is never refused.
    ///
    /// # Errors
    /// [`RefusedMove`] when that would invert or flatten an element, as nodes have been restored in another order.
    pub fn undo(&mut self) -> Result<Option<Change>, RefusedMove> {
        let Some(&(node, before)) = self.moves.last() else {
            return Ok(None);
        };
        let change = self.shift(node, before)?;
        self.moves.pop();
        Ok(Some(change))
    }

    /// K(now) - K(base), from scratch.
    pub fn difference(&self) -> Difference {
        let mut difference = Difference::default();
        self.difference_into(&mut difference);
        difference
    }

    /// As [`difference`](Self::difference), into what was used before.
    pub fn difference_into(&self, difference: &mut Difference) {
        difference.assemble(self);
    }

    /// Positions of an element's corners.
    pub(super) fn positions(&self, element: u32, nodes: &[[f64; 3]]) -> [[f64; 3]; 4] {
        self.elements()[element as usize].map(|node| nodes[node as usize])
    }

    /// Moves a node wherever its elements stay usable.
    fn shift(&mut self, node: u32, to: [f64; 3]) -> Result<Change, RefusedMove> {
        let change = Change::of(self, node, to)?;
        self.place(node, to);
        self.step = change.step;
        Ok(change)
    }

    /// Takes back `change`, the last one made, as if it had never been.
    pub(super) fn revert(&mut self, change: &Change, moves: Vec<(u32, [f64; 3])>) {
        self.place(change.node, change.from);
        self.moves = moves;
        self.step -= 1;
    }

    fn place(&mut self, node: u32, to: [f64; 3]) {
        self.nodes[node as usize] = to;
        self.note(node);
    }

    /// Keeps account of whether a node is away from its base.
    fn note(&mut self, node: u32) {
        let is_away = self.nodes[node as usize] != self.base[node as usize];
        let place = self.away.binary_search(&node);
        let span = self.neighbour_firsts[node as usize] as usize..self.neighbour_firsts[node as usize + 1] as usize;
        match place {
            Err(at) if is_away => {
                self.away.insert(at, node);
                self.neighbours[span]
                    .iter()
                    .for_each(|node| self.touched[*node as usize] += 1);
            }
            Ok(at) if !is_away => {
                self.away.remove(at);
                self.neighbours[span]
                    .iter()
                    .for_each(|node| self.touched[*node as usize] -= 1);
            }
            _ => {}
        }
    }

    /// Replaces the base: its positions and their stiffness.
    pub(super) fn set_base(&mut self, base: Vec<[f64; 3]>, stiffness: Arc<Stiffness>) {
        self.base = base;
        self.stiffness = stiffness;
        (0..self.nodes.len() as u32).for_each(|node| self.note(node));
    }
}
