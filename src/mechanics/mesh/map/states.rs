//! A mesh in its two states, either of which a frame may move: tissue moves the current nodes, remeshing the reference ones.

use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::locator::{Locator, NodeCount};
use crate::real::Real;

/// Locators of the deformed and the reference state of one mesh, in step with each other: the one carries points to the
/// nodes that the other locates in.
#[derive(Clone, Debug)]
pub struct States<T> {
    deformed: Locator<T>,
    reference: Locator<T>,
}

/// Which of the two locators an update has changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moved {
    /// The locator of the deformed state.
    pub deformed: bool,
    /// The locator of the reference state.
    pub reference: bool,
}

impl<T: Real> States<T> {
    /// Both states as the mesh has them.
    pub fn new(mesh: &TetMesh) -> Self {
        Self {
            deformed: Locator::new(mesh),
            reference: Locator::new(mesh),
        }
    }

    /// Moves nodes to their places in the current and in the reference state (mm, in the order of the mesh); none leaves
    /// them where they are. Reference nodes that are where they were cost a comparison. Allocates nothing.
    ///
    /// # Errors
    /// [`NodeCount`] where the number of positions is not that of the mesh; both states are then as they were.
    pub fn update(&mut self, current: Option<&[[f64; 3]]>, reference: Option<&[[f64; 3]]>) -> Result<Moved, NodeCount> {
        let reference = reference.filter(|nodes| *nodes != self.deformed.reference());
        let moved = Moved {
            deformed: current.is_some() || reference.is_some(),
            reference: reference.is_some(),
        };
        if moved.deformed {
            self.deformed.update_states(current, reference)?;
        }
        if let Some(nodes) = reference {
            self.reference.update(nodes)?;
        }
        Ok(moved)
    }

    /// Locates in the deformed state, and carries from there to the reference state.
    pub fn deformed(&self) -> &Locator<T> {
        &self.deformed
    }

    /// Locates in the reference state.
    pub fn reference(&self) -> &Locator<T> {
        &self.reference
    }
}
