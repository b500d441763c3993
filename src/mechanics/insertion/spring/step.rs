//! One substep: motion of tissue and needle, and their coupling.

use nalgebra::{Isometry3, Point3, Vector3};

use super::MassSpring;
use super::body::TipNode;
use super::contacts::{SAME_ARC_MM, Travel};
use crate::insertion::interaction::interaction;
use crate::insertion::{Event, EventKind};
use crate::needle::ShaftPoint;

/// Travel of the tip that counts as rest, mm.
pub(super) const STILL_MM: f64 = 1e-9;
/// Motion below which tissue without a needle is at rest, mm and mm/s.
const REST: [f64; 2] = [1e-9, 1e-7];

impl MassSpring {
    /// Moves the needle's base from `hand_before` to `hand` and the tissue by a time `h`.
    pub(super) fn part(&mut self, hand_before: &Isometry3<f64>, hand: &Isometry3<f64>, h: f64) {
        if self.body.active {
            self.contacts.remember(&self.network);
            self.network.find_forces();
            self.network.advance(h);
        }
        let before = self.tip();
        let travel = self.place_needle(hand_before, hand);
        if self.body.entry.is_none() {
            self.seek_entry(&before);
        }
        if self.body.entry.is_some() {
            self.constrain_nodes(travel, h);
            self.release();
        }
        if self.body.entry.is_some() {
            self.follow_tip(&before, travel, hand);
        }
        self.add_force_on_hand(hand);
    }

    pub(super) fn tip(&self) -> ShaftPoint {
        self.body.line.point_at_arc(self.body.line.length_mm())
    }

    /// Places the needle by hand, bone and the previous forces. Returns its advance along its axis.
    fn place_needle(&mut self, hand_before: &Isometry3<f64>, hand: &Isometry3<f64>) -> f64 {
        let length = self.needle.length_mm();
        // Bone does not move with the springs.
        let tip = self.tip().point_mm;
        if let Some(bone_contact) = &mut self.body.bone_contact
            && !(bone_contact.bone.holds()
                && bone_contact
                    .bone
                    .is_in_front(self.anatomy.as_ref(), &tip, &bone_contact.direction))
        {
            bone_contact.leave(hand, length);
        }
        self.body.bone_contact = self.body.bone_contact.filter(|contact| !contact.is_left(hand, length));
        let bone_contact = self.body.bone_contact;
        let stopped = |hand: &Isometry3<f64>| bone_contact.map_or(*hand, |contact| contact.stopped(hand, length));
        let base = stopped(hand);
        self.contacts.loads(&mut self.loads);
        let (entry, line) = (self.body.entry.as_ref(), &mut self.body.line);
        self.needle.place(&base, entry, &self.loads, &self.loads, line);
        let moved = base.translation.vector - stopped(hand_before).translation.vector;
        moved.dot(&(base * Vector3::z()))
    }

    /// Brings the nodes of the stack back to the shaft.
    fn constrain_nodes(&mut self, travel: f64, h: f64) {
        let length = self.body.line.length_mm();
        let retracting = travel < -STILL_MM;
        let at_tip = self
            .contacts
            .stack
            .last()
            .is_some_and(|last| last.arc >= length - SAME_ARC_MM);
        // A pause changes nothing: the node at the tip stays with it until the needle is withdrawn.
        self.body.tip_node = match self.body.tip_node {
            _ if retracting => TipNode::Empty,
            TipNode::Empty if travel > STILL_MM && at_tip => TipNode::Held,
            same => same,
        };
        let of_tip = interaction(self.anatomy.as_ref(), self.body.region);
        let push = if self.body.breaking {
            of_tip.cutting_n.max(of_tip.puncture_n)
        } else {
            of_tip.cutting_n
        };
        let travel = Travel {
            advancing: travel > STILL_MM,
            open: self.body.tip_node == TipNode::Empty,
            push: (self.body.tip_node == TipNode::Held).then_some(push),
        };
        let anatomy = self.anatomy.as_ref();
        let cut = self.contacts.solve(
            &mut self.network,
            h,
            &self.body.line,
            self.needle.as_mut(),
            travel,
            |region| interaction(anatomy, region),
        );
        if cut {
            self.broken();
        }
    }

    /// Records that the surface in front of the tip is broken, if there is one.
    pub(super) fn broken(&mut self) {
        if std::mem::take(&mut self.body.breaking) {
            self.event(EventKind::Puncture, self.tip().point_mm, self.body.region);
        }
    }

    /// Releases the nodes that have come off the needle: it is withdrawn, or the tissue that it dragged along springs
    /// back.
    fn release(&mut self) {
        if self.body.tip_node != TipNode::Empty {
            return;
        }
        let length = self.body.line.length_mm();
        while let Some(last) = self.contacts.stack.pop_if(|last| last.arc > length + SAME_ARC_MM) {
            self.network.restore(last.node);
            self.outcome.remeshes += 1;
        }
        if self.contacts.stack.is_empty() {
            self.body.entry = None;
            self.body.tip_node = TipNode::Empty;
            self.body.breaking = false;
            self.body.bone_contact = None;
            let region = self.body.region.take();
            self.event(EventKind::Out, self.tip().point_mm, region);
        }
    }

    pub(super) fn event(&mut self, kind: EventKind, at_mm: Point3<f64>, region: Option<i32>) {
        self.outcome.events.push(Event {
            kind,
            time_s: self.body.time_s,
            at_mm,
            region,
        });
    }

    /// Adds the force on the hand in this substep.
    fn add_force_on_hand(&mut self, hand: &Isometry3<f64>) {
        let about = Point3::from(hand.translation.vector);
        for contact in &self.contacts.stack {
            let point = self.body.line.point_at_arc(contact.arc).point_mm;
            self.outcome.on_hand.add(contact.force, &point, &about);
        }
        if let Some(bone_contact) = &self.body.bone_contact {
            let force = bone_contact.force(hand, self.needle.length_mm());
            self.outcome.on_hand.add(force, &self.body.line.tip(), &about);
        }
    }

    /// Puts tissue to rest that has no needle in it and hardly moves any more.
    pub(super) fn settle(&mut self) {
        if !self.body.active || self.body.entry.is_some() {
            return;
        }
        let below = |vectors: &[Vector3<f64>], limit: f64| vectors.iter().all(|vector| vector.amax() < limit);
        if below(&self.network.displacement, REST[0]) && below(&self.network.velocity, REST[1]) {
            self.network.rest();
            self.body.active = false;
        }
    }
}
