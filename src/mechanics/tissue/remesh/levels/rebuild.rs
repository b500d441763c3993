//! Rebuild of the inverse from its base, with all moves as one change.

use super::{DenseInverseRemesher, Store};
use crate::mechanics::tissue::remesh::adapted::AdaptedMesh;
use crate::mechanics::tissue::remesh::{Rebuilt, RemeshError, RemeshReport};

impl<S: Store> DenseInverseRemesher<S> {
    /// Rebuilds the inverse; returns the reciprocal condition of I + dK G.
    pub(super) fn rebuild(&mut self, mesh: &AdaptedMesh) -> Result<f64, RemeshError> {
        let limit = self.options.reciprocal_limit;
        let condition = self.inverse.rebuild(mesh, limit)?;
        condition.map_err(|reciprocal_condition| RemeshError::FarFromBase {
            reciprocal_condition,
            limit,
        })
    }

    /// Returns the report of a rebuild.
    pub(super) fn rebuilt(&self, mesh: &AdaptedMesh, condition: f64, reason: Rebuilt) -> RemeshReport {
        let rank = mesh.support().count();
        RemeshReport {
            level: self.level,
            rank,
            held: 0,
            reciprocal_condition: condition,
            residual: None,
            rebuilt: Some(reason),
            rebuild_failed: false,
            bytes_moved: 3 * self.inverse.store.bytes() + self.inverse.columns_bytes(rank),
        }
    }
}
