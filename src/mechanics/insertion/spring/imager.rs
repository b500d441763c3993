//! Conversion of mass-spring snapshots into tissue.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::mechanics::insertion::{Field, Imager, Snapshot, Tissue};

/// Elements that never change; snapshots contain all nodes.
pub(super) struct Moved {
    elements: Arc<[[u32; 4]]>,
    /// Node positions before the first snapshot.
    first: Vec<[f64; 3]>,
}

impl Moved {
    pub fn new(elements: Arc<[[u32; 4]]>, nodes: &[Vector3<f64>]) -> Moved {
        Moved {
            elements,
            first: nodes.iter().map(|&node| node.into()).collect(),
        }
    }
}

impl Imager for Moved {
    fn elements(&self) -> &[[u32; 4]] {
        &self.elements
    }

    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue) {
        into.reference.clone_from(&self.first);
        for (node, reference) in &snapshot.moved {
            if let Some(to) = into.reference.get_mut(*node as usize) {
                *to = *reference;
            }
        }
        into.current.clone_from(&into.reference);
        if let Field::Displacement(field) = &snapshot.field {
            for (node, by) in into.current.iter_mut().zip(field) {
                (0..3).for_each(|axis| node[axis] += by[axis]);
            }
        }
    }
}
