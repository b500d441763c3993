//! A new base for the exact level, prepared in the background.
//!
//! The update of the exact level costs O(|S|^2), and |S| grows with the nodes that are away from the base. When it passes a
//! limit, the mesh as it is becomes the base: a new factorisation, which takes far longer than a remesh. So it is made on
//! another thread from a [`Snapshot`], a pure function of it, while the haptic loop goes on with the old base; when it is done
//! [`adopt`] swaps it in. Nothing is replayed: what was moved meanwhile is away from the new base, and S and dK follow from
//! the two positions of the nodes as always.

use std::sync::Arc;

use super::adapted::AdaptedMesh;
use super::{RemeshError, Remesher, Source};
use crate::mechanics::tissue::assembly::{AssemblyError, Stiffness};
use crate::mechanics::tissue::columns::Columns;
use crate::mechanics::tissue::compliance::{Compliance, ComplianceError};
use crate::mechanics::tissue::factor::{Factor, FactorError};

/// |S| beyond which a new base is worth preparing: there an update takes about as long as a millisecond allows, and the new
/// factorisation comes long before the double of it.
pub const REBASE_ABOVE: usize = 600;

/// What the preparation of a base needs to know, and no more.
#[derive(Clone, Debug)]
pub struct Snapshot {
    nodes: Vec<[f64; 3]>,
    stiffness: Arc<Stiffness>,
    columns: Vec<usize>,
    capacity: usize,
}

/// A base that can be adopted.
#[derive(Clone, Debug)]
pub struct Rebase {
    nodes: Vec<[f64; 3]>,
    stiffness: Arc<Stiffness>,
    columns: Columns,
}

/// Why there is no new base. The old one stays in use.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RebaseError {
    /// The base was prepared for another mesh.
    #[error("the base has {found} free degrees of freedom, the mesh {expected}")]
    Mesh {
        /// Of the base.
        found: usize,
        /// Of the mesh.
        expected: usize,
    },
    /// The moved mesh cannot be assembled.
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    /// The moved mesh cannot be factored.
    #[error(transparent)]
    Factor(#[from] FactorError),
    /// Its columns cannot be solved.
    #[error(transparent)]
    Compliance(#[from] ComplianceError),
    /// The remesher cannot follow it.
    #[error(transparent)]
    Remesh(#[from] RemeshError),
}

impl Snapshot {
    /// The mesh as it is now. Columns of the new compliance at `ready`, the contacts above all and the nodes that are moved
    /// next, are solved with it, so that adopting it need not; `capacity` columns are kept (see [`Columns`]).
    pub fn of(mesh: &AdaptedMesh, ready: &[usize], capacity: usize) -> Snapshot {
        Snapshot {
            nodes: mesh.nodes().to_vec(),
            stiffness: Arc::clone(mesh.stiffness()),
            columns: ready.to_vec(),
            capacity,
        }
    }

    /// Assembles and factors the mesh, and solves for the columns: tens of milliseconds.
    ///
    /// # Errors
    /// [`RebaseError`].
    pub fn prepare(self) -> Result<Rebase, RebaseError> {
        let stiffness = self.stiffness.at_nodes(&self.nodes)?;
        let factor = Factor::new(&stiffness)?;
        let mut columns = Columns::new(Arc::new(factor), self.capacity);
        columns.prefetch(&self.columns)?;
        Ok(Rebase {
            nodes: self.nodes,
            stiffness: Arc::new(stiffness),
            columns,
        })
    }
}

/// Makes `rebase` the base of a mesh and of the remesher that follows it, and returns where its compliance comes from. S is
/// then what has been moved since the snapshot. Contacts, moves and what can be undone stay.
///
/// # Errors
/// [`RebaseError`]; mesh and remesher then stay with their base.
pub fn adopt(rebase: Rebase, mesh: &mut AdaptedMesh, remesher: &mut dyn Remesher) -> Result<Source, RebaseError> {
    let (found, expected) = (rebase.columns.size(), mesh.dofs().free());
    if found != expected || rebase.nodes.len() != mesh.nodes().len() {
        return Err(RebaseError::Mesh { found, expected });
    }
    let (base, stiffness) = (mesh.base().to_vec(), Arc::clone(mesh.stiffness()));
    mesh.set_base(rebase.nodes, rebase.stiffness);
    let source = Source::Columns(rebase.columns);
    match remesher.rebase(mesh, &source) {
        Ok(_) => Ok(source),
        Err(error) => {
            mesh.set_base(base, stiffness);
            Err(error.into())
        }
    }
}

#[cfg(test)]
mod tests;
