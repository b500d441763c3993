//! Path of the needle: it enters the tissue, nodes are made at the tip as it advances and released as it is withdrawn.

use nalgebra::Point3;

use super::Finite;
use super::contact::{SAMPLE_MM, State};
use super::location::Place;
use super::tip::TipForce;
use crate::insertion::EventKind;
use crate::needle::{Entry, ShaftPoint};

/// Distance beyond the tip at which a node is released, mm: rounding must not release one just made at the tip.
const BEYOND_MM: f64 = 0.05;
/// Distance beyond the tip at which a node is released while the needle advances, mm: a node made at the tip yields
/// more to the cutting force than the corners that shared it before, and lies beyond the tip until that has caught up.
const LOST_MM: f64 = 20.0;
/// Maximum number of iterations of [`Finite::transfer`].
const TRANSFERS: usize = 20;
/// Motion of the tip in the tissue at which [`Finite::transfer`] ends, mm: tissue beside a support is as stiff as 100
/// N/mm.
const TRANSFERRED_MM: f64 = 1e-5;

impl Finite {
    /// Releases the nodes from which the tip was withdrawn, after an `advance` (mm) of the base. Returns whether there
    /// were any.
    pub(super) fn release(&mut self, advance: f64) -> bool {
        let length = self.needle.line.length_mm() + if advance >= 0.0 { LOST_MM } else { BEYOND_MM };
        let mut released = None;
        while let Some((node, force)) = self.contacts.release_beyond(length, self.needle.is_flexible()) {
            if self.tissue.adaptation.restore(node).is_err() {
                self.log.note(EventKind::NotRemeshed, self.needle.line.tip(), None);
            }
            self.tissue.remeshes += 1;
            released = Some(force);
        }
        let Some(force) = released else { return false };
        // Its element has changed shape.
        self.tip.new_place = None;
        let is_empty = self.contacts.nodes.is_empty();
        self.tip.surface = self.tip.surface.filter(|_| advance > 0.0 && !is_empty);
        if is_empty {
            self.tip.force.stop_cutting();
            self.tip.corners.clear();
            if !self.tip.entered_without_node {
                self.leave();
            }
        }
        self.register_contacts();
        let follows = !is_empty && !self.tip.outside && !self.tip.force.is_on_bone();
        let Some(element) = self.tip.element.filter(|_| follows) else {
            self.tip.force.stop_cutting();
            return true;
        };
        // The cutting force moves from the node to the tissue beside it.
        if self.tip.force.row().is_none() {
            let tangent = self.needle.tip().tangent;
            let of_tip = tangent.into_inner() * tangent.dot(&force).clamp(0.0, self.tip.cutting(&self.body));
            let nodes = self.contacts.nodes.len();
            if let Some(last) = self.contacts.forces[..nodes].last_mut() {
                *last += of_tip;
            }
            self.tip.force = TipForce::None;
        }
        self.tip.locate(&self.tissue, element);
        if self.tip.new_place.is_some() {
            self.transfer();
        } else {
            self.tip.force.stop_cutting();
        }
        true
    }

    /// Follows the tip through the tissue after an `advance` (mm) of the base. Returns whether a node was moved to it:
    /// only while the needle advances, as it would be released again otherwise.
    pub(super) fn advance(&mut self, advance: f64) -> bool {
        self.tip
            .break_surface(&mut self.contacts, &self.needle.line, &mut self.log);
        let place = match (self.contacts.nodes.is_empty(), self.tip.element) {
            (true, _) if self.tip.force.row().is_none() => {
                self.tissue.enter(self.body.anatomy.as_ref(), &self.needle.line.tip())
            }
            (_, Some(element)) => self.tissue.locate_tip(&self.needle.line, self.tip.reference, element),
            (_, None) => None,
        };
        // An unbroken surface takes its tissue along.
        let acts = self.tip.force != TipForce::None;
        let sticks = self.tip.surface.is_some() && acts && advance > 0.0;
        let Some(place) = place else {
            if !sticks {
                self.be_outside();
            }
            return false;
        };
        let at_rest = self.tissue.point_at(&place);
        if sticks && (at_rest - self.tip.reference).norm() > SAMPLE_MM {
            return false;
        }
        if self.needle.entry.is_none() {
            self.tip.reference = at_rest;
            if self.body.anatomy.region(&at_rest).is_some() {
                return self.pierce(&place);
            }
            self.be_outside();
            return false;
        }
        let before = self.tip.reference;
        let tangent = self.needle.tip().tangent;
        let behind = |front: &Point3<f64>| advance >= 0.0 && tangent.dot(&(front - at_rest)) > 0.0;
        self.tip.cut_front = self.tip.cut_front.filter(behind);
        // Regions between both places are crossed one by one: a step may be longer than a vessel wall.
        let place = self.pass(&before, &at_rest, place);
        self.tip.element = Some(place.element);
        self.extend_path(&before);
        let Some(region) = self.tip.region else {
            if !self.tip.outside {
                self.log.note(EventKind::Out, self.needle.line.tip(), None);
            }
            self.be_outside();
            return false;
        };
        self.tip.outside = false;
        self.cut(&before, advance);
        if self.body.interaction(Some(region)).bone.is_some() {
            self.tip.force.stop_cutting();
            self.tip
                .stop_at_bone(region, advance, &self.body, &self.needle, &mut self.log);
            return false;
        }
        if self.tip.force.is_on_bone() {
            return false;
        }
        self.tip.new_place = Some(place);
        advance > 0.0 && self.wants_node(&place) && self.remesh(&place, region)
    }

    /// Records what the tip has cut since it was at `before` in the reference state.
    fn cut(&mut self, before: &Point3<f64>, advance: f64) {
        let tip = &mut self.tip;
        let recuts = tip.cut_front.is_some();
        // A withdrawn tip keeps its cutting force until it is relieved of it.
        if advance > 0.0 {
            tip.in_channel = !recuts && self.body.channel.contains(&tip.reference, self.needle.radius_mm());
        }
        if tip.in_channel {
            tip.cut_mm = 0.0;
        } else if advance > 0.0 {
            tip.cut_mm += (tip.reference - before).norm();
            self.body.channel.cut(before, &tip.reference);
        }
    }

    /// Records that the tip is outside all tissue: without a contact the needle has left the body, unless it has come
    /// out on another side.
    fn be_outside(&mut self) {
        self.tip.outside = true;
        self.tip.force.stop_cutting();
        let has_entry = self.needle.entry.is_some();
        if self.contacts.nodes.is_empty() && has_entry && self.tip.depth_without_node_mm(&self.needle) <= 0.0 {
            self.leave();
        }
    }

    /// Records that the needle has left the body.
    fn leave(&mut self) {
        (self.needle.entry, self.tip.element, self.tip.region) = (None, None, None);
        (self.tip.entered_without_node, self.tip.refused_at) = (false, None);
        self.log.note(EventKind::Out, self.needle.line.tip(), None);
    }

    /// Takes the tip through the skin and makes the first node where the needle crosses it. Returns whether one was
    /// made: bone met there needs none, and in fixed tissue there may be none to make.
    fn pierce(&mut self, place: &Place) -> bool {
        let length = self.needle.line.length_mm();
        let ShaftPoint { point_mm: tip, tangent } = self.needle.tip();
        let border = self
            .body
            .border_behind(&self.tip.reference, &tangent, length, |region| region.is_some());
        let Some(depth) = border else {
            return false;
        };
        let back = tangent.into_inner() * depth;
        let (point_mm, at_rest) = (tip - back, self.tip.reference - back);
        let Some(region) = self.body.anatomy.region(&at_rest) else {
            return false;
        };
        self.log.note(EventKind::Skin, point_mm, Some(region));
        self.needle.entry = Some(Entry {
            point_mm,
            direction: tangent,
        });
        // The step may have taken the tip deeper than the skin: what it has passed is cut.
        (self.tip.element, self.tip.cut_mm) = (Some(place.element), depth);
        (self.tip.region, self.tip.crossed, self.tip.outside) = (Some(region), at_rest, false);
        let bone = self.body.interaction(Some(region)).bone;
        if let Some(bone) = &bone {
            let is_flexible = self.needle.is_flexible();
            self.tip.meet_bone(bone, &point_mm, region, is_flexible, &mut self.log);
        }
        let Some((node, arc)) = self.first_node(place, at_rest, length - depth, bone.is_some()) else {
            self.tip.entered_without_node = true;
            if bone.is_none() {
                self.tip.refuse(region, &self.needle.line, &mut self.log);
                self.meet_surface(region);
                self.tip.new_place = Some(*place);
            }
            return false;
        };
        self.add_contact(node, arc, State::Stuck, region);
        self.extend_path(&at_rest);
        self.tip.force.stop_cutting();
        self.tip.in_channel = self.body.channel.contains(&at_rest, self.needle.radius_mm());
        self.meet_surface(region);
        self.tip.locate(&self.tissue, place.element);
        if bone.is_some() {
            self.tip.new_place = None;
        }
        true
    }

    /// Moves a node of the surface to the entry (reference state), so that the mesh surface moves to the surface of the
    /// body; if none can be moved there, a node inside to the tip, unless that is in bone. Returns the node and its
    /// arc.
    fn first_node(&mut self, place: &Place, entry: Point3<f64>, arc: f64, in_bone: bool) -> Option<(u32, f64)> {
        let tissue = &self.tissue;
        let (nodes, limit) = (&self.contacts.nodes, self.options.condition_limit);
        let skin = tissue.locate_at_rest(&entry, place.element);
        let skin = skin.and_then(|skin| {
            tissue.corner(skin.element, entry, nodes, limit, |node| {
                tissue.on_surface[node as usize]
            })
        });
        let on_surface = skin.filter(|node| self.tissue.move_node(*node, entry));
        match on_surface {
            Some(node) => Some((node, arc)),
            None if in_bone => None,
            None => self
                .move_corner(place.element)
                .map(|node| (node, self.needle.line.length_mm())),
        }
    }

    fn meet_surface(&mut self, region: i32) {
        self.tip
            .meet_surface(region, &self.body, &self.needle, &mut self.contacts, &mut self.log);
    }

    fn extend_path(&mut self, before: &Point3<f64>) {
        let length = self.needle.line.length_mm();
        self.contacts
            .extend_path(&self.body, length, before, &self.tip.reference);
    }

    /// Takes the tip through the regions from its position in the tissue at rest to `place`, or to the first surface
    /// that stops it: tissue that springs back as a surface breaks comes to rest there.
    fn pass(&mut self, before: &Point3<f64>, at_rest: &Point3<f64>, place: Place) -> Place {
        let pieces = ((at_rest - before).norm() / SAMPLE_MM).ceil();
        for piece in 1..pieces as usize {
            self.tip.reference = before + (at_rest - before) * (piece as f64 / pieces);
            if self.cross()
                && let Some(stopped) = self.tissue.locate_at_rest(&self.tip.reference, place.element)
            {
                return stopped;
            }
        }
        self.tip.reference = *at_rest;
        self.cross();
        place
    }

    fn cross(&mut self) -> bool {
        self.tip
            .cross(&self.body, &self.needle, &mut self.contacts, &mut self.log)
    }

    /// Returns whether the tip has left the elements around the last node, if any, and is far enough from it.
    fn wants_node(&self, place: &Place) -> bool {
        let spacing = self.options.spacing_mm;
        let tip = &self.tip;
        let refused = tip
            .refused_at
            .is_some_and(|refused| (refused - tip.reference).norm() < spacing / 4.0);
        let last = self.contacts.nodes.last();
        let beyond = last.is_none_or(|last| {
            let elsewhere = !self.tissue.mesh.elements()[place.element as usize].contains(&last.node);
            elsewhere && self.needle.line.length_mm() - last.arc >= spacing
        });
        beyond && !refused && (tip.surface.is_none() || last.is_none()) && place.is_inside()
    }

    /// Moves a corner to the tip.
    fn remesh(&mut self, place: &Place, region: i32) -> bool {
        let Some(node) = self.move_corner(place.element) else {
            self.tip.refuse(region, &self.needle.line, &mut self.log);
            return false;
        };
        let cutting = self.tip.cutting(&self.body);
        // Tissue sticks at an unbroken surface.
        let slides = self.contacts.nodes.last().filter(|_| self.tip.surface.is_none());
        let state = slides.map_or(State::Stuck, |last| last.slider.state);
        self.add_contact(node, self.needle.line.length_mm(), state, region);
        if self.tip.force.is_on_node() {
            self.contacts.pass_cutting_on(&self.needle.tip(), cutting);
        }
        self.tip.locate(&self.tissue, place.element);
        self.transfer();
        true
    }

    /// Locates tip and last node in the changed mesh under the forces of the previous mesh: a change of the mesh is no
    /// motion of the needle, so it neither drags tissue nor relieves the hand. The tip comes to lie behind the node, by
    /// the amount that this yields more to the cutting force than the corners that shared it before.
    pub(super) fn transfer(&mut self) {
        let front = self.tip.cut_front.unwrap_or(self.tip.reference);
        for _ in 0..TRANSFERS {
            self.take_tip();
            self.take_compliance();
            self.write_arcs();
            self.take_forces();
            let (line, tissue) = (&self.needle.line, &mut self.tissue);
            let tip = &mut self.tip;
            let place = tip
                .element
                .and_then(|element| tissue.locate_tip(line, tip.reference, element));
            let Some(place) = place else { break };
            let (before, at_rest) = (tip.reference, tissue.point_at(&place));
            (tip.reference, tip.element, tip.new_place) = (at_rest, Some(place.element), Some(place));
            if (at_rest - before).norm() < TRANSFERRED_MM {
                break;
            }
        }
        self.tip.cut_front = Some(front);
        let starts = &mut self.contacts.starts;
        for (contact, start) in self.contacts.nodes.iter_mut().zip(starts) {
            let position = contact.reference + self.tissue.displacement_of(contact.node);
            let arc = self.needle.line.nearest(&position);
            (contact.arc, *start) = (arc, arc);
        }
    }

    /// Moves the best corner of an element to the tip. Returns the node, or `None` if none fits.
    fn move_corner(&mut self, element: u32) -> Option<u32> {
        let (nodes, limit) = (&self.contacts.nodes, self.options.condition_limit);
        let target = self.tip.reference;
        let node = self.tissue.corner(element, target, nodes, limit, |_| true)?;
        self.tissue.move_node(node, target).then_some(node)
    }

    fn add_contact(&mut self, node: u32, arc: f64, state: State, region: i32) {
        let reference = self.tissue.adaptation.mesh().nodes()[node as usize].into();
        self.contacts.add(node, reference, arc, state, Some(region));
        self.tip.refused_at = None;
        self.tip.corners.retain(|corner| *corner != node);
        self.register_contacts();
    }

    pub(super) fn register_contacts(&mut self) {
        self.tissue.register_contacts(&self.contacts.nodes, &self.tip.corners);
    }
}
