//! Entry into the tissue and exit from it.

use super::place::Place;
use super::slider::State;
use super::{EventKind, Finite};
use crate::mechanics::needle::{Entry, ShaftPoint};

impl Finite {
    /// Takes the tip through the skin and makes the first node where the needle crosses it. Returns whether one was made:
    /// bone met there needs none, and in fixed tissue there may be none to make.
    pub(super) fn pierce(&mut self, place: &Place) -> bool {
        let length = self.line.length_mm();
        let ShaftPoint { point_mm: tip, tangent } = self.line.at(length);
        let Some(depth) = self.border_behind(&tangent, |region| region.is_some()) else {
            return false;
        };
        let back = tangent.into_inner() * depth;
        let (point_mm, at_rest) = (tip - back, self.tip.reference - back);
        let Some(region) = self.anatomy.region(&at_rest) else {
            return false;
        };
        self.note(EventKind::Skin, point_mm, Some(region));
        self.entry = Some(Entry {
            point_mm,
            direction: tangent,
        });
        (self.tip.element, self.tip.cut_mm) = (Some(place.element), depth);
        (self.tip.region, self.tip.crossed, self.tip.outside) = (Some(region), at_rest, false);
        let bone = self.of(region).bone;
        if let Some(bone) = &bone {
            self.meet_bone(bone, &point_mm, region);
        }
        // A surface node of the mesh, so that the mesh surface moves to the surface of the body.
        let skin = self.locate_at_rest(&at_rest, place.element);
        let skin = skin.and_then(|skin| self.corner(skin.element, at_rest, |node| self.on_surface[node as usize]));
        let on_surface = skin.filter(|node| self.move_node(*node, at_rest));
        // If none can be moved there, the tip becomes a node inside.
        let made = match on_surface {
            Some(node) => Some((node, length - depth)),
            None if bone.is_some() => None,
            None => self
                .move_corner(place.element, self.tip.reference)
                .map(|node| (node, length)),
        };
        let Some((node, arc)) = made else {
            self.tip.bare = true;
            if bone.is_none() {
                self.refuse(region);
                self.meet_surface(region);
                self.tip.found = Some(*place);
            }
            return false;
        };
        self.add_contact(node, arc, State::Stuck, Some(region));
        self.lay_path(&at_rest);
        self.tip.forget_row();
        self.tip.in_channel = self.channel.holds(&at_rest, self.needle.radius_mm());
        self.meet_surface(region);
        self.find_again(place.element);
        if bone.is_some() {
            self.tip.found = None;
        }
        true
    }

    /// Records that the needle is outside.
    pub(super) fn leave(&mut self) {
        (self.entry, self.tip.element, self.tip.region) = (None, None, None);
        (self.tip.bare, self.tip.refused) = (false, None);
        self.note(EventKind::Out, self.line.tip(), None);
    }

    /// Handles a tip that is not in tissue: without a contact the needle has left the body, unless it has come out on
    /// another side.
    pub(super) fn leave_bare(&mut self) {
        if self.contacts.is_empty() && self.entry.is_some() && self.depth_of_bare() <= 0.0 {
            self.leave();
        }
    }

    /// Returns the depth of a tip that entered without a node, mm: fixed tissue stays where it is.
    pub(super) fn depth_of_bare(&self) -> f64 {
        let tangent = self.line.at(self.line.length_mm()).tangent;
        let entry = self.entry.as_ref().filter(|_| self.tip.bare);
        entry.map_or(0.0, |entry| tangent.dot(&(self.line.tip() - entry.point_mm)).max(0.0))
    }
}
