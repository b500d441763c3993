//! Seeds where the tissue has carried them.

use std::sync::Arc;

use nalgebra::{Point3, Vector3, center};

use crate::mechanics::insertion::{Snapshot, Tissue};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::locator::{Locator, NONE};
use crate::synth::NeedleShaft;

/// Finds seeds in the tissue.
pub(super) struct Seeds {
    mesh: Option<Arc<TetMesh>>,
    /// From the reference state to the current one; made for the first seed.
    locator: Option<Locator<f64>>,
    /// The element that each was in last.
    elements: Vec<u32>,
}

impl Seeds {
    /// Of tissue with a mesh, or of none that moves.
    pub(super) fn new(mesh: Option<Arc<TetMesh>>) -> Self {
        Self {
            mesh,
            locator: None,
            elements: Vec::new(),
        }
    }

    /// Writes the seeds of a state whose tissue is as stated. A seed points where the needle did when it was first seen here,
    /// for only its place is known; one outside the tissue stays at its place in the reference state.
    pub(super) fn show(&mut self, snapshot: &Snapshot, tissue: &Tissue, into: &mut Vec<NeedleShaft>) {
        let count = snapshot.seeds.len();
        self.elements.resize(count, NONE);
        into.truncate(count);
        if count == 0 {
            return;
        }
        if let Some(mesh) = &self.mesh {
            let locator = self.locator.get_or_insert_with(|| Locator::new(mesh));
            let moved = locator.update_states(Some(&tissue.reference), Some(&tissue.current));
            // Nodes of another number are the synthesizer's to refuse.
            if moved.is_err() {
                return;
            }
        }
        for (at, (seed, element)) in snapshot.seeds.iter().zip(&mut self.elements).enumerate() {
            let place = carried(self.locator.as_ref(), seed, element);
            match into.get_mut(at) {
                Some(NeedleShaft { nodes, .. }) => {
                    let by = place - center(&nodes[0], &nodes[1]);
                    nodes.iter_mut().for_each(|node| *node += by);
                }
                None => into.push(NeedleShaft::seed(place, &at_tip(snapshot))),
            }
        }
    }
}

/// Where a point of the reference state is now; `element` is where to look first, and then where it was found.
fn carried(locator: Option<&Locator<f64>>, point: &Point3<f64>, element: &mut u32) -> Point3<f64> {
    let Some(locator) = locator else { return *point };
    let point = [point.x, point.y, point.z];
    *element = locator.locate(point, *element).element;
    match *element {
        NONE => point.into(),
        found => locator.to_reference(found, point).into(),
    }
}

/// The direction of the needle at its tip.
fn at_tip(snapshot: &Snapshot) -> Vector3<f64> {
    match snapshot.line.nodes() {
        [] => Vector3::z(),
        _ => snapshot.line.at(snapshot.line.length_mm()).tangent.into_inner(),
    }
}
