//! Moves of nodes, and their reversal.

use super::{AdaptedMesh, Change};
use crate::tissue::element::Shape;
use crate::tissue::remesh::RemeshError;
use insonify_mesh::quality::jacobian_condition;

/// Effect of a change on the list of moves.
#[derive(Clone, Copy, Debug)]
pub(in super::super) enum Record {
    /// The change is appended as a move.
    Moved,
    /// All moves of the node are removed.
    Restored,
    /// The last move is removed.
    Undone,
}

impl AdaptedMesh {
    /// Returns the worst Jacobian condition that the tetrahedra around `node` would have with it at `to` (mm), the
    /// criterion for the choice of a corner. Nothing is moved.
    ///
    /// # Errors
    /// [`RemeshError`] as of [`move_node`](Self::move_node).
    pub fn assess(&self, node: u32, to: [f64; 3]) -> Result<f64, RemeshError> {
        let nodes = self.nodes.len();
        if node as usize >= nodes {
            return Err(RemeshError::Node { node, nodes });
        }
        if to.iter().any(|x| !x.is_finite()) {
            return Err(RemeshError::Position { node, to });
        }
        let (mut worst, mut thinnest, mut before) = (0.0, 0, 0.0f64);
        for (element, corner) in self.elements_around(node) {
            let mut positions = self.positions(element, &self.nodes);
            before = before.max(jacobian_condition(&positions));
            positions[corner] = to;
            if let Err(cause) = Shape::of(&positions) {
                let corners = self.elements()[element as usize];
                return Err(RemeshError::Element {
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
        // A move is accepted if it improves elements that were too thin from the start.
        if worst > self.condition_limit && worst > before {
            return Err(RemeshError::Condition {
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
    /// [`RemeshError`] when an element would be inverted or flat, or thinner than both the limit and the thinnest
    /// element around the node before.
    pub fn move_node(&mut self, node: u32, to: [f64; 3]) -> Result<Change, RemeshError> {
        let change = self.begin_move(node, to)?;
        self.record(Record::Moved, &change);
        Ok(change)
    }

    /// Moves a node back to its original position and removes its moves from the list.
    ///
    /// # Errors
    /// [`RemeshError`] when that would invert or flatten an element, as other nodes have moved since.
    pub fn restore(&mut self, node: u32) -> Result<Change, RemeshError> {
        let change = self.begin_restore(node)?;
        self.record(Record::Restored, &change);
        Ok(change)
    }

    /// Undoes the last move; `None` if there is none. In the reverse order of the moves this is never refused.
    ///
    /// # Errors
    /// [`RemeshError`] when that would invert or flatten an element, as nodes have been restored in another order.
    pub fn undo(&mut self) -> Result<Option<Change>, RemeshError> {
        let change = self.begin_undo()?;
        if let Some(change) = &change {
            self.record(Record::Undone, change);
        }
        Ok(change)
    }

    /// Takes the memory of a finished change for the next one, so that moves allocate nothing.
    pub(crate) fn reclaim(&mut self, change: Change) {
        self.spare = Some(change);
    }

    /// Performs [`move_node`](Self::move_node), but does not list the move until it is [recorded](Self::record).
    pub(in super::super) fn begin_move(&mut self, node: u32, to: [f64; 3]) -> Result<Change, RemeshError> {
        self.assess(node, to)?;
        self.shift(node, to)
    }

    /// Performs [`restore`](Self::restore) without updating the list of moves.
    pub(in super::super) fn begin_restore(&mut self, node: u32) -> Result<Change, RemeshError> {
        let nodes = self.nodes.len();
        let home = self.original.get(node as usize).copied();
        self.shift(node, home.ok_or(RemeshError::Node { node, nodes })?)
    }

    /// Performs [`undo`](Self::undo) without updating the list of moves.
    pub(in super::super) fn begin_undo(&mut self) -> Result<Option<Change>, RemeshError> {
        match self.moves.last() {
            Some(&(node, before)) => self.shift(node, before).map(Some),
            None => Ok(None),
        }
    }

    /// Records a change that was begun in the list of moves.
    pub(in super::super) fn record(&mut self, record: Record, change: &Change) {
        match record {
            Record::Moved => self.moves.push((change.node, change.from)),
            Record::Restored => self.moves.retain(|(node, _)| *node != change.node),
            Record::Undone => drop(self.moves.pop()),
        }
    }

    /// Reverts the last change, which was begun but not recorded.
    pub(in super::super) fn take_back(&mut self, change: &Change) {
        self.place(change.node, change.from);
        self.step -= 1;
    }

    /// Moves a node if its elements stay usable.
    fn shift(&mut self, node: u32, to: [f64; 3]) -> Result<Change, RemeshError> {
        let spare = self.spare.take().unwrap_or_else(Change::none);
        let change = spare.fill(self, node, to)?;
        self.place(node, to);
        self.step = change.step;
        Ok(change)
    }

    fn place(&mut self, node: u32, to: [f64; 3]) {
        self.nodes[node as usize] = to;
        self.note(node);
    }

    /// Updates the record of whether a node is away from its base.
    pub(super) fn note(&mut self, node: u32) {
        let is_away = self.nodes[node as usize] != self.base[node as usize];
        let index = self.away.binary_search(&node);
        let neighbours = self.around.neighbours(node);
        match index {
            Err(at) if is_away => {
                self.away.insert(at, node);
                neighbours.iter().for_each(|node| self.touched[*node as usize] += 1);
            }
            Ok(at) if !is_away => {
                self.away.remove(at);
                neighbours.iter().for_each(|node| self.touched[*node as usize] -= 1);
            }
            _ => {}
        }
    }
}
