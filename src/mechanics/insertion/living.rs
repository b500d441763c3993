//! Motion of the tissue itself, as by a breath.
//!
//! The displacements of the nodes are prescribed; those by needle and probe add to them, as linear elasticity adds them.
//! Forces are then those of the tissue at rest under what the instruments displace it by beside its own motion, also
//! while it moves: neither the strain by a breath nor inertia changes stiffness or force, and what a local rotation would
//! turn stays as at rest.

use std::sync::Arc;

use nalgebra::Vector3;

use insonify_mesh::{Locator, NO_ELEMENT, TetMesh};

/// Displacements of the nodes of a mesh at rest, in proportion to a share that varies over time.
#[derive(Clone)]
pub struct TissueMotion {
    /// Displacement of each node at a share of 1, mm; nodes beyond the list rest.
    pub displacements: Vec<[f64; 3]>,
    /// Share at a time, s from the start of the run.
    pub share_at: Arc<dyn Fn(f64) -> f64 + Send + Sync>,
}

/// Motions of the nodes of a mesh, which add up, and their shares now and before.
#[derive(Clone)]
pub(super) struct Living {
    motions: Arc<[TissueMotion]>,
    /// The mesh at rest, whose elements carry nodes that remeshing has moved.
    mesh: Arc<TetMesh>,
    locator: Arc<Locator<f64>>,
    shares: Vec<[f64; 2]>,
}

impl Living {
    pub(super) fn new(motions: Vec<TissueMotion>, mesh: Arc<TetMesh>, locator: Arc<Locator<f64>>) -> Living {
        let shares = motions.iter().map(|motion| [(motion.share_at)(0.0); 2]).collect();
        Living {
            motions: motions.into(),
            mesh,
            locator,
            shares,
        }
    }

    /// Moves on to a time, s from the start of the run.
    pub(super) fn go_to(&mut self, time_s: f64) {
        for ([now, before], motion) in self.shares.iter_mut().zip(self.motions.iter()) {
            *before = std::mem::replace(now, (motion.share_at)(time_s));
        }
    }

    /// Returns an upper bound of the way of any node between two times, mm.
    pub(super) fn farthest_mm(&self, from_s: f64, to_s: f64) -> f64 {
        let ways = self.motions.iter().map(|motion| {
            let share = ((motion.share_at)(to_s) - (motion.share_at)(from_s)).abs();
            let squares = motion.displacements.iter().map(|by| Vector3::from(*by).norm_squared());
            if share == 0.0 {
                0.0
            } else {
                share * squares.fold(0.0, f64::max).sqrt()
            }
        });
        ways.sum()
    }

    /// Returns the displacement of a node that lies at `reference` at rest, mm.
    pub(super) fn displacement(&self, node: u32, reference: [f64; 3]) -> Vector3<f64> {
        self.sum(node, reference, |[now, _]| now)
    }

    /// Returns how far such a node has gone since the time before, mm.
    pub(super) fn way(&self, node: u32, reference: [f64; 3]) -> Vector3<f64> {
        self.sum(node, reference, |[now, before]| now - before)
    }

    fn sum(&self, node: u32, reference: [f64; 3], share: impl Fn([f64; 2]) -> f64) -> Vector3<f64> {
        let of_node = |node: u32| -> Vector3<f64> {
            let terms = self.motions.iter().zip(&self.shares).map(|(motion, shares)| {
                let by = motion.displacements.get(node as usize).copied().unwrap_or_default();
                Vector3::from(by) * share(*shares)
            });
            terms.sum()
        };
        if self.mesh.nodes()[node as usize] == reference {
            return of_node(node);
        }
        let hit = self.locator.locate(reference, NO_ELEMENT);
        match self.mesh.elements().get(hit.element as usize) {
            Some(corners) => corners
                .iter()
                .zip(hit.bary)
                .map(|(node, weight)| of_node(*node) * weight)
                .sum(),
            None => of_node(node),
        }
    }
}
