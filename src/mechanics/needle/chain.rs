//! Chain of rigid links and joints: the geometry common to the models.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use super::{Bevel, CentreLine};

/// Distance along the shaft below which two nodes are merged, mm.
const APART_MM: f64 = 1e-9;

/// Nodes along the undeformed shaft: base, joints, the start of the bevel, tip.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    arcs: Vec<f64>,
    /// Node of each joint.
    joints: Vec<usize>,
    /// Node from which the shaft is tilted, and its direction there in the frame of the link.
    tilt: Option<(usize, Vector3<f64>)>,
    nodes: Vec<(f64, Point3<f64>)>,
    turns: Vec<Vector3<f64>>,
}

impl Chain {
    /// Builds a shaft with joints at rising arcs (mm) within it, with or without one at the base. Bevel and length must
    /// be valid.
    pub(super) fn new(length_mm: f64, joints: &[f64], bevel: Option<&Bevel>) -> Self {
        let first_joint = usize::from(joints.first() != Some(&0.0));
        let mut arcs = vec![0.0; first_joint];
        arcs.extend_from_slice(joints);
        arcs.push(length_mm);
        let mut joint_nodes: Vec<usize> = (first_joint..first_joint + joints.len()).collect();
        let tilt = bevel.filter(|bevel| bevel.r_mm > 0.0).map(|bevel| {
            let start = length_mm - bevel.length_mm;
            // A joint where the bevel begins serves as its node: links of almost no length would be ill-conditioned.
            let near = arcs.iter().position(|arc| (arc - start).abs() < APART_MM);
            let start_node = near.unwrap_or_else(|| {
                let index = arcs.partition_point(|&arc| arc < start);
                arcs.insert(index, start);
                joint_nodes
                    .iter_mut()
                    .filter(|joint| **joint >= index)
                    .for_each(|joint| *joint += 1);
                index
            });
            (start_node, bevel.direction())
        });
        let nodes = Vec::with_capacity(arcs.len());
        let turns = Vec::with_capacity(joint_nodes.len());
        Self {
            arcs,
            joints: joint_nodes,
            tilt,
            nodes,
            turns,
        }
    }

    pub(super) fn length_mm(&self) -> f64 {
        self.arcs[self.arcs.len() - 1]
    }

    /// Returns the node of each joint, base first.
    pub(super) fn joints(&self) -> &[usize] {
        &self.joints
    }

    /// Returns the number of joints before an arc (mm).
    pub(super) fn joints_before(&self, arc_mm: f64) -> usize {
        self.joints.partition_point(|&node| self.arcs[node] < arc_mm)
    }

    /// Returns whether a line has the nodes and joints of this shaft.
    pub(super) fn fits(&self, line: &CentreLine) -> bool {
        let arcs = line.nodes().iter().map(|node| node.0);
        let turns = line.turns().len() == self.joints.len();
        turns && line.nodes().len() == self.arcs.len() && arcs.eq(self.arcs.iter().copied())
    }

    /// Places the links one after another. `turn` gives the rotation (axis times angle, world axes) of each joint for
    /// the direction of the link before it; frames are carried along by these rotations alone.
    pub(super) fn place(
        &mut self,
        base: &Isometry3<f64>,
        line: &mut CentreLine,
        mut turn: impl FnMut(usize, &Vector3<f64>) -> Vector3<f64>,
    ) {
        let direction = |frame: &UnitQuaternion<f64>, node: usize| match &self.tilt {
            Some((from, tilted)) if node >= *from => frame * tilted,
            _ => frame * Vector3::z(),
        };
        let mut frame = base.rotation;
        // Points are computed from the last turn of the shaft, so that a straight one is straight to the bit.
        let mut turned = (self.arcs[0], Point3::from(base.translation.vector));
        let mut tangent = direction(&frame, 0);
        let mut joint = 0;
        self.nodes.clear();
        self.turns.clear();
        self.nodes.push(turned);
        if self.joints.first() == Some(&0) {
            let angle = turn(0, &tangent);
            self.turns.push(angle);
            if angle != Vector3::zeros() {
                frame = UnitQuaternion::from_scaled_axis(angle) * frame;
                tangent = direction(&frame, 0);
            }
            joint = 1;
        }
        for (node, &arc) in self.arcs.iter().enumerate().skip(1) {
            let point = turned.1 + tangent * (arc - turned.0);
            self.nodes.push((arc, point));
            let mut turns = self.tilt.as_ref().is_some_and(|tilt| tilt.0 == node);
            if self.joints.get(joint) == Some(&node) {
                let angle = turn(joint, &tangent);
                self.turns.push(angle);
                if angle != Vector3::zeros() {
                    frame = UnitQuaternion::from_scaled_axis(angle) * frame;
                    turns = true;
                }
                joint += 1;
            }
            if turns {
                tangent = direction(&frame, node);
                turned = (arc, point);
            }
        }
        line.set_turned(self.nodes.iter().copied(), &self.turns);
    }
}
