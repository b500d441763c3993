//! Conversion of snapshots into tissue, on the image thread.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::living::Living;
use super::{Field, NodeSolver, Snapshot, Tissue, TissueAtTip};
use crate::tissue::dofs::Dofs;
use crate::tissue::factor::Factor;
use insonify_mesh::TetMesh;

/// Share of the mean square distance of an element's corners from the tip in the square of the reach of what is shown
/// there: so much that no node between free corners moves farther than the tissue at the tip by half.
const REACH: f64 = 4.0;
/// Farthest that a node moves for what is shown at the tip beside fixed nodes, in parts of what the tissue there moves.
const FARTHEST: f64 = 3.0;

/// NodeSolver of a finite element mesh.
pub(super) struct MeshImager {
    mesh: Arc<TetMesh>,
    base: Option<Base>,
    living: Option<Living>,
    nodes: Vec<[f64; 3]>,
}

/// Solver with the factor of the base mesh, for snapshots of forces.
struct Base {
    factor: Arc<Factor>,
    dofs: Dofs,
    displacements: Vec<f64>,
}

impl MeshImager {
    /// Takes the factor of the base mesh if snapshots may have forces in place of displacements, and the tissue's own
    /// motion.
    pub(super) fn new(mesh: Arc<TetMesh>, base: Option<(Arc<Factor>, Dofs)>, living: Option<Living>) -> MeshImager {
        let base = base.map(|(factor, dofs)| Base {
            displacements: vec![0.0; dofs.free()],
            factor,
            dofs,
        });
        MeshImager {
            nodes: vec![[0.0; 3]; mesh.nodes().len()],
            mesh,
            base,
            living,
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
        if let Some(living) = &mut self.living {
            living.go_to(snapshot.time_s);
            for ((node, reference), current) in (0..).zip(&into.reference).zip(&mut into.current) {
                let shift = living.displacement(node, *reference);
                (0..3).for_each(|axis| current[axis] += shift[axis]);
            }
        }
        into.inverted = self.mesh.volumes(&into.current).filter(|volume| *volume <= 0.0).count();
        if let Some(at_tip) = &snapshot.at_tip {
            at_tip.show(displacement, into);
        }
    }
}

impl TissueAtTip {
    /// Displaces the nodes around the tip so that the tissue at the tip is there: what a mesh lacks of the dent lies within
    /// its elements and the patch. Nodes that no instrument has displaced are fixed.
    fn show(&self, displacement: &[[f64; 3]], tissue: &mut Tissue) {
        let corners = || self.corners.iter().map(|node| *node as usize);
        let interpolated = |nodes: &[[f64; 3]]| -> Vector3<f64> {
            let terms = corners().zip(self.shares);
            terms.map(|(node, share)| Vector3::from(nodes[node]) * share).sum()
        };
        let at_rest = Point3::from(interpolated(&tissue.reference));
        let missing = self.tip_mm - Point3::from(interpolated(&tissue.current));
        let square = |node: &[f64; 3]| (Point3::from(*node) - at_rest).norm_squared();
        // The mean over the corners by the shares of the tip, beside the element those of the nearest face: it does not
        // jump from element to element.
        let inside = self.shares.map(|share| share.max(0.0));
        let mean = |of_node: &dyn Fn(&[f64; 3], &[f64; 3]) -> f64| {
            let terms = corners()
                .zip(inside)
                .map(|(node, share)| share * of_node(&tissue.reference[node], &displacement[node]));
            terms.sum::<f64>() / inside.iter().sum::<f64>()
        };
        let reach = self.radius_mm.powi(2) + REACH * mean(&|reference, _| square(reference));
        let weight = |reference: &[f64; 3], displacement: &[f64; 3]| {
            if *displacement == [0.0; 3] {
                0.0
            } else {
                (1.0 + square(reference) / reach).powf(-1.5)
            }
        };
        // Beside fixed corners the free ones make up for them as far as they may go.
        let factor = mean(&weight).recip().min(FARTHEST);
        let nodes = tissue.reference.iter().zip(displacement);
        for ((reference, displacement), current) in nodes.zip(&mut tissue.current) {
            let shift = missing * (factor * weight(reference, displacement));
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The tip in the middle of a large element, which a node that lies nearer passes by half at most, and near three
    /// fixed corners, for which the free one makes up as far as it may.
    #[test]
    fn no_node_goes_much_farther_than_the_tip() {
        let reference = vec![
            [12.0, 0.0, 0.0],
            [-12.0, 1.0, 0.0],
            [0.0, 0.0, 14.0],
            [0.0, 12.0, -8.0],
            [0.5, 0.5, 0.5],
        ];
        for (shares, is_free, is_exact) in [
            ([0.25; 4], [true; 5], true),
            ([0.01, 0.33, 0.33, 0.33], [true, false, false, false, true], false),
        ] {
            let displacement = is_free.map(|is_free| [0.0, 0.0, if is_free { 0.1 } else { 0.0 }]);
            let pairs = reference.iter().zip(displacement);
            let current: Vec<[f64; 3]> = pairs.map(|([x, y, z], by)| [*x, *y, z + by[2]]).collect();
            let interpolated = |nodes: &[[f64; 3]]| -> Vector3<f64> {
                nodes
                    .iter()
                    .zip(shares)
                    .map(|(node, share)| Vector3::from(*node) * share)
                    .sum()
            };
            let missing = Vector3::new(0.0, 0.0, 5.0);
            let at_tip = TissueAtTip {
                tip_mm: Point3::from(interpolated(&current) + missing),
                corners: [0, 1, 2, 3],
                shares,
                radius_mm: 5.0,
            };
            let mut tissue = Tissue {
                reference: reference.clone(),
                current: current.clone(),
                inverted: 0,
            };
            at_tip.show(&displacement, &mut tissue);
            for ((before, after), is_free) in current.iter().zip(&tissue.current).zip(is_free) {
                let shift = (Vector3::from(*after) - Vector3::from(*before)).norm();
                assert!(
                    shift <= if is_exact { 1.5 } else { FARTHEST } * missing.norm() && (shift > 1.0) == is_free,
                    "{before:?} {after:?}"
                );
            }
            let is_at_tip = (interpolated(&tissue.current) - at_tip.tip_mm.coords).norm() < 1e-9;
            assert_eq!(is_at_tip, is_exact);
        }
    }
}
