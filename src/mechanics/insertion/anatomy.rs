//! Anatomy at rest as seen by a needle: regions in space and their interactions with the needle.

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::sync::Arc;

use nalgebra::Point3;

use super::Interaction;
use crate::mechanics::mesh::{Locator, NONE, TetMesh};

/// Regions of the body and their interactions with a needle, independent of any mesh.
pub trait Anatomy: Send + Sync + Debug {
    /// Returns the region at a point of the undeformed body (mm), or `None` outside the body.
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32>;

    /// Returns the interaction of a region with a needle. One that fails [`Interaction::check`] is replaced by the default.
    fn interaction(&self, region: i32) -> Interaction;
}

/// Least distance in the tissue at rest between two crossings of a boundary, mm: a tip that wanders along a boundary crosses
/// it once. Bone and critical regions are entered at once.
pub(super) const BORDER_MM: f64 = 0.5;

/// Returns the interaction of a region with a needle, the default (no force) outside the body.
pub(super) fn interaction(anatomy: &dyn Anatomy, region: Option<i32>) -> Interaction {
    region
        .map(|region| anatomy.interaction(region))
        .filter(|it| it.check().is_ok())
        .unwrap_or_default()
}

impl<T: Anatomy + ?Sized> Anatomy for Arc<T> {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        self.as_ref().region(at_rest_mm)
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.as_ref().interaction(region)
    }
}

/// Regions of the elements of a mesh, before any of its nodes was moved.
#[derive(Debug)]
pub struct MeshRegions {
    mesh: Arc<TetMesh>,
    locator: Arc<Locator<f64>>,
    interactions: BTreeMap<i32, Interaction>,
}

impl MeshRegions {
    /// Takes the regions of a mesh with their interactions; a region that is not listed exerts no force.
    pub fn new(mesh: &Arc<TetMesh>, interactions: &[(i32, Interaction)]) -> MeshRegions {
        MeshRegions::located(mesh, Arc::new(Locator::new(mesh)), interactions)
    }

    pub(super) fn located(
        mesh: &Arc<TetMesh>,
        locator: Arc<Locator<f64>>,
        interactions: &[(i32, Interaction)],
    ) -> MeshRegions {
        MeshRegions {
            mesh: Arc::clone(mesh),
            locator,
            interactions: interactions.iter().copied().collect(),
        }
    }
}

impl Anatomy for MeshRegions {
    fn region(&self, at_rest_mm: &Point3<f64>) -> Option<i32> {
        let hit = self.locator.locate((*at_rest_mm).into(), NONE);
        (hit.element != NONE).then(|| self.mesh.regions()[hit.element as usize])
    }

    fn interaction(&self, region: i32) -> Interaction {
        self.interactions.get(&region).copied().unwrap_or_default()
    }
}
