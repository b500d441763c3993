//! Conversion of snapshots into tissue, on the image thread.

use std::sync::Arc;

use super::{Field, NodeSolver, Snapshot, Tissue};
use crate::tissue::dofs::Dofs;
use crate::tissue::factor::Factor;
use insonify_mesh::TetMesh;

/// NodeSolver of a finite element mesh.
pub(super) struct MeshImager {
    mesh: Arc<TetMesh>,
    base: Option<Base>,
    nodes: Vec<[f64; 3]>,
}

/// Solver with the factor of the base mesh, for snapshots of forces.
struct Base {
    factor: Arc<Factor>,
    dofs: Dofs,
    displacements: Vec<f64>,
}

impl MeshImager {
    /// Takes the factor of the base mesh if snapshots may have forces in place of displacements.
    pub(super) fn new(mesh: Arc<TetMesh>, base: Option<(Arc<Factor>, Dofs)>) -> MeshImager {
        let base = base.map(|(factor, dofs)| Base {
            displacements: vec![0.0; dofs.free()],
            factor,
            dofs,
        });
        MeshImager {
            nodes: vec![[0.0; 3]; mesh.nodes().len()],
            mesh,
            base,
        }
    }
}

impl NodeSolver for MeshImager {
    fn elements(&self) -> &[[u32; 4]] {
        self.mesh.elements()
    }

    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue) {
        let displacement = match (&snapshot.field, &mut self.base) {
            (Field::Displacement(displacement), _) => displacement,
            (Field::BaseForces(_), None) => &self.nodes,
            (Field::BaseForces(forces), Some(base)) => {
                base.displacements.fill(0.0);
                forces
                    .iter()
                    .for_each(|(dof, force)| base.displacements[*dof as usize] += force);
                if base.displacements.iter().any(|force| *force != 0.0) {
                    base.factor.solve_in_place(&mut base.displacements);
                }
                base.dofs.scatter(&base.displacements, &mut self.nodes);
                &self.nodes
            }
        };
        write_nodes(self.mesh.nodes(), &snapshot.moved, displacement, into);
        into.inverted = self.mesh.volumes(&into.current).filter(|volume| *volume <= 0.0).count();
    }
}

/// NodeSolver of a network of springs: snapshots contain all nodes.
pub(super) struct NetworkImager {
    pub elements: Arc<[[u32; 4]]>,
    /// Node positions before the first snapshot.
    pub first: Vec<[f64; 3]>,
}

impl NodeSolver for NetworkImager {
    fn elements(&self) -> &[[u32; 4]] {
        &self.elements
    }

    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue) {
        let displacement = match &snapshot.field {
            Field::Displacement(displacement) => &displacement[..],
            Field::BaseForces(_) => &[],
        };
        write_nodes(&self.first, &snapshot.moved, displacement, into);
    }
}

/// Writes reference positions, some of which were moved, and current positions; nodes without a displacement stay.
fn write_nodes(nodes: &[[f64; 3]], moved: &[(u32, [f64; 3])], displacement: &[[f64; 3]], into: &mut Tissue) {
    into.reference.clear();
    into.reference.extend_from_slice(nodes);
    for (node, position) in moved {
        into.reference[*node as usize] = *position;
    }
    into.current.clone_from(&into.reference);
    for (node, shift) in into.current.iter_mut().zip(displacement) {
        (0..3).for_each(|axis| node[axis] += shift[axis]);
    }
}
