//! Deformed and reference state of a mesh, either of which a frame may change: tissue moves the current nodes, remeshing the
//! reference ones.

use crate::base::real::Real;
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::locator::Locator;

/// Consistent locators of the deformed and the reference state of one mesh: the first carries points to the nodes among
/// which the second locates.
#[derive(Clone, Debug)]
pub struct States<T> {
    deformed: Locator<T>,
    reference: Locator<T>,
}

/// Locators changed by an update.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Moved {
    /// Whether the locator of the deformed state has changed.
    pub deformed: bool,
    /// Whether the locator of the reference state has changed.
    pub reference: bool,
}

impl<T: Real> States<T> {
    /// Builds both locators for the reference state of the mesh.
    pub fn new(mesh: &TetMesh) -> Self {
        Self {
            deformed: Locator::new(mesh),
            reference: Locator::new(mesh),
        }
    }

    /// Moves nodes to their positions in the current and in the reference state (mm, in the order of the mesh); `None`
    /// leaves a state unchanged. Unchanged reference nodes cost a comparison. Allocates nothing.
    ///
    /// # Errors
    /// [`InvalidMesh`] where the number of positions is not that of the mesh; both states are then unchanged.
    pub fn update(
        &mut self,
        current: Option<&[[f64; 3]]>,
        reference: Option<&[[f64; 3]]>,
    ) -> Result<Moved, InvalidMesh> {
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

    /// Returns the locator of the deformed state, which carries points to the reference state.
    pub fn deformed(&self) -> &Locator<T> {
        &self.deformed
    }

    /// Returns the locator of the reference state.
    pub fn reference(&self) -> &Locator<T> {
        &self.reference
    }
}
