//! Positions of seeds in the deformed tissue.

use std::sync::Arc;

use nalgebra::{Point3, Vector3, center};

use crate::mechanics::insertion::{Snapshot, Tissue};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::mesh::locator::{Locator, NONE};
use crate::synth::NeedleShaft;

/// Locates seeds in the tissue.
pub(super) struct Seeds {
    mesh: Option<Arc<TetMesh>>,
    /// Locator from the reference state to the current one; made for the first seed.
    locator: Option<Locator<f64>>,
    /// Last element of each seed.
    elements: Vec<u32>,
}

impl Seeds {
    /// Takes the mesh of the tissue, or `None` if it does not move.
    pub(super) fn new(mesh: Option<Arc<TetMesh>>) -> Self {
        Self {
            mesh,
            locator: None,
            elements: Vec::new(),
        }
    }

    /// Writes the seeds of a state with the given tissue. A seed points along the needle at the time it was first seen here,
    /// since only its position is known; one outside the tissue stays at its position in the reference state.
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
            // The synthesizer reports a wrong number of nodes.
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

/// Returns the current position of a point of the reference state; the search starts at `element`, which receives the
/// element found.
fn carried(locator: Option<&Locator<f64>>, point: &Point3<f64>, element: &mut u32) -> Point3<f64> {
    let Some(locator) = locator else { return *point };
    let point = [point.x, point.y, point.z];
    *element = locator.locate(point, *element).element;
    match *element {
        NONE => point.into(),
        found => locator.to_reference(found, point).into(),
    }
}

/// Returns the direction of the needle at its tip.
fn at_tip(snapshot: &Snapshot) -> Vector3<f64> {
    match snapshot.line.nodes() {
        [] => Vector3::z(),
        _ => snapshot.line.at(snapshot.line.length_mm()).tangent.into_inner(),
    }
}
