//! Path of the needle: it enters the tissue, nodes are made at the tip as it advances and released as it is withdrawn.

use nalgebra::Point3;

use super::Finite;
use super::body::CutTissue;
use super::contact::{SAMPLE_MM, State};
use super::contacts::Contacts;
use super::location::Place;
use super::tip::TipLimits;
use crate::insertion::{EventKind, Work};
use crate::needle::{Entry, ShaftPoint};

/// Distance beyond the tip at which a node is released, mm: rounding must not release one just made at the tip.
const BEYOND_MM: f64 = 0.05;
/// Distance beyond the tip at which a node is released while the needle advances, mm: a node made at the tip may yield
/// more to the forces than the tissue there did, and lies beyond the tip until that has caught up.
const LOST_MM: f64 = 20.0;
/// Excess of a travel over its limit that is rounding, mm.
const ROUNDING_MM: f64 = 1e-9;

impl Finite {
    /// Releases the nodes from which the tip was withdrawn, after an `advance` (mm) of the base. Returns whether there
    /// were any.
    pub(super) fn release(&mut self, advance: f64) -> bool {
        let length = self.needle.line.length_mm() + if advance >= 0.0 { LOST_MM } else { BEYOND_MM };
        let mut released = false;
        self.log.cost.count(Work::Search);
        while let Some(node) = self.contacts.release_beyond(length, self.needle.is_flexible()) {
            if self.tissue.adaptation.restore(node).is_err() {
                self.log.note(EventKind::NotRemeshed, self.needle.line.tip(), None);
            }
            self.tissue.remeshes += 1;
            released = true;
        }
        if !released {
            return false;
        }
        self.log.cost.count(Work::Remeshing);
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
    pub(super) fn advance(&mut self, advance: f64, limits: TipLimits) -> bool {
        let tangent = self.needle.tip().tangent;
        self.tip.settle_dent(&self.contacts, &tangent);
        // An unbroken surface takes its tissue along.
        if self.tip.sticks_at_surface() {
            return false;
        }
        self.tip.release_dent(limits.release_mm, &self.body);
        let place = match (self.contacts.nodes.is_empty(), self.tip.element) {
            (true, _) if self.tip.force.row().is_none() => {
                self.tissue.enter(self.body.anatomy.as_ref(), &self.needle.line.tip())
            }
            (_, Some(element)) => {
                let (line, reference) = (&self.needle.line, self.tip.reference);
                self.tissue
                    .locate_tip(line, self.tip.dent.depth_mm(), reference, element)
            }
            (_, None) => None,
        };
        let Some(place) = place else {
            self.be_outside();
            return false;
        };
        let at_rest = self.tissue.point_at(&place);
        if self.needle.entry.is_none() {
            self.tip.reference = at_rest;
            if self.body.anatomy.region(&at_rest).is_some() {
                return self.pierce(&place);
            }
            self.be_outside();
            return false;
        }
        let before = self.tip.reference;
        let bone = self.bone_at_tip(advance);
        let nearer = bone.or_else(|| self.within_travel(&at_rest, place.element, limits.travel_mm));
        let (at_rest, place) = nearer.unwrap_or((at_rest, place));
        // Regions between both places are crossed one by one: a step may be longer than a vessel wall.
        let (place, is_stopped) = self.pass(&before, &at_rest, place);
        if is_stopped && limits.springs() {
            self.tip.dent.offset_mm = 0.0;
        } else if nearer.is_some() || is_stopped {
            self.take_depth(&place);
        }
        self.tip.element = Some(place.element);
        let Some(region) = self.tip.region else {
            if !self.tip.outside {
                self.tip.out_told = true;
                self.log.note(EventKind::Out, self.needle.line.tip(), None);
            }
            self.be_outside();
            return false;
        };
        self.extend_path(&before);
        (self.tip.outside, self.tip.out_told) = (false, false);
        self.tip.follow_tissue(&before, &tangent, &self.body);
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

    /// Returns the place on the way of the tip in the tissue to `at_rest` at which a limit of its travel (mm) is reached,
    /// if that is nearer.
    fn within_travel(&self, at_rest: &Point3<f64>, element: u32, limit_mm: f64) -> Option<(Point3<f64>, Place)> {
        let before = self.tip.reference;
        let travel = at_rest - before;
        let length = travel.norm();
        if length <= limit_mm + ROUNDING_MM {
            return None;
        }
        let at_rest = before + travel * (limit_mm / length);
        let place = self
            .tissue
            .locate_at_rest(&at_rest, self.tip.element.unwrap_or(element))?;
        Some((at_rest, place))
    }

    /// Returns the place of bone that an advancing tip has reached: bone is not dented, and the tip is in it before the
    /// tissue that it dents.
    fn bone_at_tip(&mut self, advance: f64) -> Option<(Point3<f64>, Place)> {
        let element = self.tip.element?;
        let (depth_mm, tip) = (self.tip.dent.depth_mm(), self.needle.tip());
        let is_bone =
            |body: &CutTissue, point: &Point3<f64>| body.interaction(body.anatomy.region(point)).bone.is_some();
        // Where bone is nowhere near, the tissue at the tip is not sought.
        let ahead = self.tip.reference + tip.tangent.into_inner() * depth_mm;
        let is_near = is_bone(&self.body, &tip.point_mm) || is_bone(&self.body, &ahead);
        if advance <= 0.0 || depth_mm <= 0.0 || self.tip.in_bone() || !is_near {
            return None;
        }
        let place = self
            .tissue
            .locate_tip(&self.needle.line, 0.0, self.tip.reference, element)?;
        let at_rest = self.tissue.point_at(&place);
        is_bone(&self.body, &at_rest).then_some((at_rest, place))
    }

    /// Takes the depth of the dent at a place as it is, at the same force.
    fn take_depth(&mut self, place: &Place) {
        let ShaftPoint { point_mm: tip, tangent } = self.needle.tip();
        let depth_mm = tangent.dot(&(tip - self.tissue.lies(place, &tangent)));
        self.tip.take_depth(depth_mm, &tangent);
    }

    /// Records what the tip has cut since it was at `before` in the reference state.
    fn cut(&mut self, before: &Point3<f64>, advance: f64) {
        let tip = &mut self.tip;
        // A withdrawn tip keeps its cutting force until it is relieved of it.
        if advance > 0.0 {
            let was_in_channel = tip.in_channel;
            tip.in_channel = self.body.channel.contains(&tip.reference, self.needle.radius_mm());
            // At its end the whole edge meets uncut tissue.
            if was_in_channel && !tip.in_channel {
                tip.edge.clear();
            }
            let cutting = tip.cutting_here(&self.body);
            tip.advance_edge(cutting, (tip.reference - before).norm(), &self.needle);
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
        if !std::mem::take(&mut self.tip.out_told) {
            self.log.note(EventKind::Out, self.needle.line.tip(), None);
        }
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
        let reference = std::mem::replace(&mut self.tip.reference, at_rest);
        self.tip.meet_tissue(&tangent, &self.body);
        self.tip.reference = reference;
        let bone = self.body.interaction(Some(region)).bone;
        if let Some(bone) = &bone {
            let is_flexible = self.needle.is_flexible();
            self.tip
                .meet_bone(bone, &point_mm, &tangent, region, is_flexible, &mut self.log);
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
        let on_surface = skin.filter(|node| self.move_node(*node, entry));
        match on_surface {
            Some(node) => Some((node, arc)),
            None if in_bone => None,
            None => self
                .move_corner(place.element)
                .map(|node| (node, self.needle.line.length_mm())),
        }
    }

    /// Meets the surface of the body.
    fn meet_surface(&mut self, region: i32) {
        self.tip.meet_surface(region, &self.body, &self.needle, &mut self.log);
        self.tip.at_skin = true;
    }

    fn extend_path(&mut self, before: &Point3<f64>) {
        let length = self.needle.line.length_mm();
        self.contacts
            .extend_path(&self.body, length, before, &self.tip.reference);
    }

    /// Takes the tip through the regions from its position in the tissue at rest to `place`, or to the first surface
    /// that stops it: tissue that springs back as a surface breaks comes to rest there. Returns where that is, and
    /// whether it is short of `place`.
    fn pass(&mut self, before: &Point3<f64>, at_rest: &Point3<f64>, place: Place) -> (Place, bool) {
        let pieces = ((at_rest - before).norm() / SAMPLE_MM).ceil();
        for piece in 1..pieces as usize {
            self.tip.reference = before + (at_rest - before) * (piece as f64 / pieces);
            if self.cross()
                && let Some(stopped) = self.tissue.locate_at_rest(&self.tip.reference, place.element)
            {
                return (stopped, true);
            }
        }
        self.tip.reference = *at_rest;
        self.cross();
        (place, false)
    }

    fn cross(&mut self) -> bool {
        self.tip.cross(&self.body, &self.needle, &mut self.log)
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
        // Tissue sticks at an unbroken surface.
        let slides = self.contacts.nodes.last().filter(|_| self.tip.surface.is_none());
        let state = slides.map_or(State::Stuck, |last| last.slider.state);
        self.add_contact(node, self.needle.line.length_mm(), state, region);
        self.tip.locate(&self.tissue, place.element);
        self.transfer();
        true
    }

    /// Carries forces over to the changed mesh: a change of the mesh is no motion of the needle, so it neither drags
    /// tissue nor relieves the hand. The tip keeps its place in the tissue.
    pub(super) fn transfer(&mut self) {
        self.tip.settle_dent(&self.contacts, &self.needle.tip().tangent);
        let place = self.tip.new_place;
        self.log.cost.count(Work::Search);
        self.take_tip();
        self.take_compliance();
        self.write_arcs();
        self.take_forces();
        self.log.cost.count(Work::Condensation);
        if let Some(place) = place {
            self.take_depth(&place);
        }
        let line = &self.needle.line;
        let Contacts {
            nodes, starts, forces, ..
        } = &mut self.contacts;
        for ((contact, start), force) in nodes.iter_mut().zip(starts).zip(forces) {
            let position = contact.reference + self.tissue.displacement_of(contact.node);
            *start = contact.arc;
            let ShaftPoint { point_mm, tangent } = line.point_at_arc(contact.arc);
            let across = *force - tangent.into_inner() * tangent.dot(force);
            contact.aside = point_mm - position - across * contact.softness_mm_per_n;
        }
    }

    /// Moves the best corner of an element to the tip. Returns the node, or `None` if none fits.
    fn move_corner(&mut self, element: u32) -> Option<u32> {
        let (nodes, limit) = (&self.contacts.nodes, self.options.condition_limit);
        let target = self.tip.reference;
        let node = self.tissue.corner(element, target, nodes, limit, |_| true)?;
        self.move_node(node, target).then_some(node)
    }

    /// Moves a node; returns whether it could be.
    fn move_node(&mut self, node: u32, to: Point3<f64>) -> bool {
        self.log.cost.count(Work::Search);
        let is_moved = self.tissue.move_node(node, to);
        self.log.cost.count(Work::Remeshing);
        is_moved
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
        self.log.cost.count(Work::Condensation);
    }
}
