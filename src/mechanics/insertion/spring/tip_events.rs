//! Events at the tip: the skin, other regions, bone, and the next node.

use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::MassSpring;
use super::body::{BoneContact, TipNode, unloaded_tip};
use super::contacts::{Contact, SAME_ARC_MM};
use super::geometry::{FarFace, Simplex};
use super::step::STILL_MM;

use crate::insertion::EventKind;
use crate::insertion::interaction::{BORDER_MM, interaction};
use crate::needle::{Entry, ShaftPoint};

/// Bisections of a step to locate the tip at a surface: 0.4 mm become 1e-12 mm.
const HALVINGS: usize = 40;
/// Distance between samples of the regions along the way of the tip, mm.
const SAMPLE_MM: f64 = 0.25;
/// Maximum number of samples in a substep.
const MAX_SAMPLES: f64 = 400.0;
/// Distance in front of the tip of the point that determines the element it enters, as a share of the node spacing.
const IN_FRONT: f64 = 1e-6;

/// Returns the cylinder's frame for a needle that enters at a point in a direction.
pub(super) fn frame_at(point: &Point3<f64>, direction: &Vector3<f64>) -> Isometry3<f64> {
    let turn = Rotation3::rotation_between(&Vector3::z(), direction)
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    Isometry3::from_parts(Translation3::from(point.coords), UnitQuaternion::from(turn))
}

impl MassSpring {
    /// Checks whether the tip has entered the body.
    pub(super) fn seek_entry(&mut self, before: &ShaftPoint) {
        let tip = self.tip();
        let Some(region) = self.anatomy.region(&tip.point_mm) else {
            return;
        };
        if self.anatomy.region(&before.point_mm).is_some() {
            self.re_enter(&tip, region);
            return;
        }
        let [mut outside, mut inside] = [before.point_mm, tip.point_mm];
        for _ in 0..HALVINGS {
            let middle = nalgebra::center(&outside, &inside);
            match self.anatomy.region(&middle) {
                Some(_) => inside = middle,
                None => outside = middle,
            }
        }
        self.put(&frame_at(&inside, &tip.tangent));
        self.enter(&inside, 0, region);
        self.body.element = self.network.around(0)[0];
    }

    /// Handles a tip that left pressed-in tissue and advances again: it meets the skin where that is now.
    fn re_enter(&mut self, tip: &ShaftPoint, region: i32) {
        let in_front = tip.point_mm.coords;
        let Some((element, coordinates)) = self.network.locate(&in_front, self.body.element) else {
            return;
        };
        self.body.element = element;
        let corners = self.network.elements[element as usize];
        let in_skin = corners.into_iter().filter(|&node| (node as usize) < self.skin_nodes);
        // An array, as steps do not allocate.
        let mut candidates: [Option<u32>; 4] = [None; 4];
        candidates
            .iter_mut()
            .zip(in_skin)
            .for_each(|(to, node)| *to = Some(node));
        let distance = |node: &u32| (self.network.now(*node) - in_front).norm_squared();
        let nearest = candidates
            .into_iter()
            .flatten()
            .filter(|&node| !self.network.fixed[node as usize])
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        if let Some(node) = nearest
            && self.network.take_to(node, element, &coordinates, &in_front)
        {
            self.outcome.remeshes += 1;
            self.enter(&tip.point_mm, node, region);
        }
    }

    /// Enters the body at a node of the skin.
    fn enter(&mut self, point: &Point3<f64>, node: u32, region: i32) {
        self.body.entry = Some(Entry {
            point_mm: *point,
            direction: self.tip().tangent,
        });
        self.body.active = true;
        self.body.breaking = true;
        self.body.region = Some(region);
        (self.body.crossed, self.body.at_rest) = (point.coords, point.coords);
        self.push(node, Some(region));
        self.contacts.remember(&self.network);
        self.event(EventKind::Skin, *point, Some(region));
    }

    fn push(&mut self, node: u32, region: Option<i32>) {
        self.body.tip_node = TipNode::Held;
        self.body.refused = false;
        self.contacts.stack.push(Contact {
            node,
            arc: self.body.line.length_mm(),
            stuck: true,
            region,
            beyond: None,
            force: Vector3::zeros(),
            side: Vector3::zeros(),
        });
    }

    /// Checks for another region, bone, or the next node at the tip.
    pub(super) fn follow_tip(&mut self, before: &ShaftPoint, travel: f64, hand: &Isometry3<f64>) {
        let tip = self.tip();
        let (point, direction) = (tip.point_mm.coords, tip.tangent.into_inner());
        let in_front = point + direction * (IN_FRONT * self.spacing_mm);
        let in_bone = self.meet_bone(before, travel, hand);
        // Side and far end are fixed: beyond them there is no element.
        let in_cylinder = self.frame.inverse_transform_point(&tip.point_mm);
        let [beside, below] = [in_cylinder.coords.xy().norm(), in_cylinder.z];
        let within = below <= self.parameters.length_mm() && beside <= self.parameters.radius_mm;
        // In front of the tip, as a tip on a face lies in two elements.
        let located = self.network.locate(&in_front, self.body.element).filter(|_| within);
        let Some((element, _)) = located else {
            self.refuse();
            return;
        };
        self.body.element = element;
        let corners = self.network.corners(element);
        let Some(simplex) = Simplex::new(&corners) else {
            return;
        };
        let coordinates = simplex.coordinates(&point);
        let reference = self.network.to_reference(element, &coordinates);
        if !in_bone {
            self.meet(&reference);
        }
        if travel <= STILL_MM {
            return;
        }
        let length = self.body.line.length_mm();
        let nodes = self.network.elements[element as usize];
        // Where the last node has slid back from the tip, the face opposite it is still the far one: the needle may run
        // along others.
        let last = self.contacts.stack.last();
        let at_tip = last.is_some_and(|last| last.arc >= length - SAME_ARC_MM);
        let opposite = last.and_then(|last| nodes.iter().position(|&node| node == last.node));
        let Some(far) = FarFace::of(&corners, &point, &direction, opposite) else {
            return;
        };
        if !far.is_met(self.parameters.lambda) {
            return;
        }
        let holds = at_tip && self.body.tip_node == TipNode::Held;
        if holds && self.body.breaking {
            // A surface with a puncture force drags its tissue along until that is reached, any other is penetrated as
            // the elements are.
            if interaction(self.anatomy.as_ref(), self.body.region).puncture_n > 0.0 {
                return;
            }
            self.broken();
        }
        if holds {
            // Penetrated. The tissue gets this substep to draw the node back along the shaft before the next is taken.
            self.body.tip_node = TipNode::Penetrated;
            return;
        }
        for corner in far.nearest_first(&corners) {
            let node = nodes[corner];
            let free =
                !self.network.fixed[node as usize] && self.contacts.stack.iter().all(|contact| contact.node != node);
            if free && self.network.take_to(node, element, &coordinates, &point) {
                self.outcome.remeshes += 1;
                self.push(node, self.body.region);
                return;
            }
        }
        if !at_tip {
            self.refuse();
        }
    }

    fn refuse(&mut self) {
        if !std::mem::replace(&mut self.body.refused, true) {
            self.event(EventKind::NotRemeshed, self.tip().point_mm, self.body.region);
        }
    }

    /// Takes the tip through the regions to a new position in the reference state, which jumps by millimetres as a node
    /// is penetrated, or to the first surface that stops it.
    fn meet(&mut self, reference: &Vector3<f64>) {
        if self.body.breaking && self.body.tip_node == TipNode::Held {
            return;
        }
        let before = self.body.at_rest;
        let pieces = ((reference - before).norm() / SAMPLE_MM).ceil().clamp(1.0, MAX_SAMPLES);
        for piece in 1..=pieces as usize {
            self.body.at_rest = before + (reference - before) * (piece as f64 / pieces);
            self.meet_at(&self.body.at_rest.into());
            if self.body.breaking && self.body.tip_node == TipNode::Held {
                return;
            }
        }
    }

    /// Updates the region of the tip at a position in the reference state.
    fn meet_at(&mut self, reference: &Point3<f64>) {
        let tip = self.tip().point_mm;
        let region = self.anatomy.region(reference);
        let interaction = interaction(self.anatomy.as_ref(), region);
        let near = (reference.coords - self.body.crossed).norm() < BORDER_MM && !interaction.critical;
        // Bone does not move with the springs.
        if interaction.bone.is_none() && !near && std::mem::replace(&mut self.body.region, region) != region {
            self.body.crossed = reference.coords;
            let length = self.body.line.length_mm();
            if let Some(last) = self.contacts.stack.last_mut() {
                let from = last.beyond.map_or(length - last.arc, |(from, _)| from);
                last.beyond = (region != last.region).then_some((from, region));
            }
            self.body.breaking = interaction.puncture_n > interaction.cutting_n;
            self.event(EventKind::Region, tip, region);
            if interaction.critical {
                self.event(EventKind::Critical, tip, region);
            }
        }
    }

    /// Checks whether the tip is in bone, which does not yield: it lies as in the undeformed body.
    fn meet_bone(&mut self, before: &ShaftPoint, travel: f64, hand: &Isometry3<f64>) -> bool {
        let tip = self.tip();
        let region = self.anatomy.region(&tip.point_mm);
        let Some(bone) = interaction(self.anatomy.as_ref(), region).bone else {
            return false;
        };
        self.body.region = region;
        if self.body.bone_contact.is_some_and(|contact| contact.bone.holds()) || travel <= STILL_MM {
            return true;
        }
        let [mut outside, mut inside] = [before.point_mm, tip.point_mm];
        for _ in 0..HALVINGS {
            let middle = nalgebra::center(&outside, &inside);
            if self.anatomy.region(&middle) == region {
                inside = middle
            } else {
                outside = middle
            }
        }
        self.body.bone_contact = Some(BoneContact {
            at: unloaded_tip(hand, self.needle.length_mm()) + (inside - tip.point_mm),
            direction: tip.tangent,
            bone,
        });
        self.event(EventKind::Bone, inside, region);
        true
    }
}
