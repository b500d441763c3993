//! Conversion of snapshots into tissue for a fixed mesh with displaced nodes.

use std::sync::Arc;

use crate::mechanics::insertion::{Field, Imager, Snapshot, Tissue};
use crate::mechanics::mesh::TetMesh;

/// A mesh that never changes.
pub(super) struct Unchanging(pub Arc<TetMesh>);

impl Imager for Unchanging {
    fn elements(&self) -> &[[u32; 4]] {
        self.0.elements()
    }

    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue) {
        into.reference.clear();
        into.reference.extend_from_slice(self.0.nodes());
        into.current.clone_from(&into.reference);
        if let Field::Displacement(field) = &snapshot.field {
            for (node, by) in into.current.iter_mut().zip(field) {
                (0..3).for_each(|axis| node[axis] += by[axis]);
            }
        }
        into.inverted = self.0.volumes(&into.current).filter(|volume| *volume <= 0.0).count();
    }
}
