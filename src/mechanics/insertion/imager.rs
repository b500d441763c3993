//! Conversion of snapshots into tissue, on the image thread.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::{Field, NodeSolver, Snapshot, Tissue, TissueAtTip};
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
        if let Some(at_tip) = &snapshot.at_tip {
            at_tip.show(into);
        }
    }
}

impl TissueAtTip {
    /// Displaces the nodes around the tip so that the tissue at the tip is there. What a mesh lacks of the dent lies within
    /// its elements and the patch; nodes that nothing has displaced are fixed.
    fn show(&self, tissue: &mut Tissue) {
        let interpolated = |nodes: &[[f64; 3]]| -> Vector3<f64> {
            let terms = self.corners.iter().zip(self.shares);
            terms
                .map(|(node, share)| Vector3::from(nodes[*node as usize]) * share)
                .sum()
        };
        let at_rest = Point3::from(interpolated(&tissue.reference));
        let missing = self.tip_mm - Point3::from(interpolated(&tissue.current));
        let weight = |reference: &[f64; 3], current: &[f64; 3]| {
            let distance = (Point3::from(*reference) - at_rest).norm_squared() / (self.radius_mm * self.radius_mm);
            if reference == current {
                0.0
            } else {
                (1.0 + distance).powf(-1.5)
            }
        };
        let at_tip: f64 = self
            .corners
            .iter()
            .zip(self.shares)
            .map(|(node, share)| share * weight(&tissue.reference[*node as usize], &tissue.current[*node as usize]))
            .sum();
        if at_tip <= 0.0 {
            return;
        }
        for (reference, current) in tissue.reference.iter().zip(&mut tissue.current) {
            let shift = missing * (weight(reference, current) / at_tip);
            (0..3).for_each(|axis| current[axis] += shift[axis]);
        }
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
