//! Conversion of finite element snapshots into tissue, on the image thread.

use std::sync::Arc;

use crate::mechanics::insertion::{Field, Imager, Snapshot, Tissue};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::tissue::dofs::Dofs;
use crate::mechanics::tissue::factor::Factor;

/// Solver with the factor of the base mesh.
pub(super) struct FiniteImager {
    mesh: Arc<TetMesh>,
    factor: Arc<Factor>,
    dofs: Dofs,
    displacements: Vec<f64>,
    nodes: Vec<[f64; 3]>,
}

impl FiniteImager {
    pub fn new(mesh: Arc<TetMesh>, factor: Arc<Factor>, dofs: Dofs) -> FiniteImager {
        FiniteImager {
            displacements: vec![0.0; dofs.free()],
            nodes: vec![[0.0; 3]; mesh.nodes().len()],
            mesh,
            factor,
            dofs,
        }
    }
}

impl Imager for FiniteImager {
    fn elements(&self) -> &[[u32; 4]] {
        self.mesh.elements()
    }

    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue) {
        into.reference.clear();
        into.reference.extend_from_slice(self.mesh.nodes());
        for (node, place) in &snapshot.moved {
            into.reference[*node as usize] = *place;
        }
        let displacement: &[[f64; 3]] = match &snapshot.field {
            Field::Displacement(displacement) => displacement,
            Field::BaseForces(forces) => {
                self.displacements.fill(0.0);
                forces
                    .iter()
                    .for_each(|(dof, force)| self.displacements[*dof as usize] += force);
                if self.displacements.iter().any(|force| *force != 0.0) {
                    self.factor.solve_in_place(&mut self.displacements);
                }
                self.dofs.scatter(&self.displacements, &mut self.nodes);
                &self.nodes
            }
        };
        into.current.clear();
        let pairs = into.reference.iter().zip(displacement);
        into.current
            .extend(pairs.map(|(place, u)| [place[0] + u[0], place[1] + u[1], place[2] + u[2]]));
        into.inverted = self.mesh.volumes(&into.current).filter(|volume| *volume <= 0.0).count();
    }
}
