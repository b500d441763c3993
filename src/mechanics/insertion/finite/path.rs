//! Path of the needle: nodes are made at the tip as it advances and released as it is withdrawn.

use nalgebra::{Point3, Vector3};

use super::contact::Contact;
use super::joint::MOST_FADING;
use super::place::Place;
use super::slider::{Slider, State};
use super::{EventKind, Finite};
use crate::mechanics::insertion::Interaction;
use crate::mechanics::insertion::anatomy::{BORDER_MM, interaction};
use crate::mechanics::needle::ShaftPoint;
use crate::mechanics::tissue::remesh::corner::best_corner;

/// Distance beyond the tip at which a node is released, mm: rounding must not release one just made at the tip.
const BEYOND_MM: f64 = 0.05;
/// Distance beyond the tip at which a node is released while the needle advances, mm: a node made at the tip yields more to
/// the cutting force than the corners that shared it before, and lies beyond the tip until that has caught up.
const LOST_MM: f64 = 20.0;
/// Maximum number of iterations of [`Finite::transfer`].
const TRANSFERS: usize = 20;
/// Motion of the tip in the tissue at which [`Finite::transfer`] ends, mm: tissue beside a support is as stiff as 100 N/mm.
const TRANSFERRED_MM: f64 = 1e-5;
/// Distance between samples of the regions along a path, mm.
const SAMPLE_MM: f64 = 0.25;
/// Bisections of [`SAMPLE_MM`] to locate the start of a region, to 1e-13 mm.
const HALVINGS: usize = 40;

impl Finite {
    /// Releases the nodes from which the tip was withdrawn, after an `advance` (mm) of the base. Returns whether there were
    /// any.
    pub(super) fn release(&mut self, advance: f64) -> bool {
        let length = self.line.length_mm() + if advance >= 0.0 { LOST_MM } else { BEYOND_MM };
        let mut released = None;
        while self.contacts.last().is_some_and(|contact| contact.arc > length) {
            let Some(contact) = self.contacts.pop() else { break };
            // The needle still lies under its force, which fades as a solution without it is found.
            let force = self.forces.remove(self.contacts.len());
            if self.needle.is_flexible() {
                self.fade(contact.arc, force);
            }
            self.memory.starts.pop();
            if self.adaptation.restore(contact.node).is_err() {
                self.note(EventKind::NotRemeshed, self.line.tip(), None);
            }
            self.outcome.remeshes += 1;
            released = Some(force);
        }
        let Some(force) = released else { return false };
        // Its element has changed shape.
        self.tip.found = None;
        self.tip.surface = self.tip.surface.filter(|_| advance > 0.0 && !self.contacts.is_empty());
        if self.contacts.is_empty() {
            self.tip.forget_row();
            self.tip.corners.clear();
            if !self.tip.bare {
                self.leave();
            }
        }
        self.name_contacts();
        let element = self
            .tip
            .element
            .filter(|_| !self.contacts.is_empty() && !self.tip.outside && !self.tip.is_pinned());
        let Some(element) = element else {
            self.tip.forget_row();
            return true;
        };
        // The cutting force moves from the node to the tissue beside it.
        if self.tip.at_node || self.tip.row.is_none() {
            let tangent = self.line.at(self.line.length_mm()).tangent;
            let of_tip = tangent.into_inner() * tangent.dot(&force).clamp(0.0, self.cutting());
            if let Some(last) = self.forces[..self.contacts.len()].last_mut() {
                *last += of_tip;
            }
        }
        self.tip.at_node = false;
        self.find_again(element);
        if self.tip.found.is_some() {
            self.transfer();
        } else {
            self.tip.forget_row();
        }
        true
    }

    fn fade(&mut self, arc: f64, force: Vector3<f64>) {
        if let (MOST_FADING, Some(last)) = (self.fading.len(), self.forces.last_mut()) {
            *last += force;
        } else {
            self.fading.push(arc);
            self.forces.push(force);
        }
    }

    /// Follows the tip through the tissue after an `advance` (mm) of the base. Returns whether a node was moved to it: only
    /// while the needle advances, as it would be released again otherwise.
    pub(super) fn advance(&mut self, advance: f64) -> bool {
        self.break_surface();
        let tip = self.line.tip();
        let found = match (self.contacts.is_empty(), self.tip.element) {
            (true, _) if self.tip.row.is_none() => self.enter(&tip),
            (_, Some(element)) => self.find(&tip, element),
            (_, None) => None,
        };
        // An unbroken surface takes its tissue along.
        let acts = self.tip.row.is_some() || self.tip.at_node;
        let holds = self.tip.surface.is_some() && acts && advance > 0.0;
        let Some(place) = found else {
            if !holds {
                self.be_outside();
            }
            return false;
        };
        let at_rest = self.point_at(&place);
        if holds && (at_rest - self.tip.reference).norm() > SAMPLE_MM {
            return false;
        }
        if self.entry.is_none() {
            self.tip.reference = at_rest;
            if self.anatomy.region(&at_rest).is_some() {
                return self.pierce(&place);
            }
            self.be_outside();
            return false;
        }
        let before = self.tip.reference;
        let tangent = self.line.at(self.line.length_mm()).tangent;
        let behind = |front: &Point3<f64>| advance >= 0.0 && tangent.dot(&(front - at_rest)) > 0.0;
        self.tip.front = self.tip.front.filter(behind);
        let place = self.pass(&before, &at_rest, place);
        self.tip.element = Some(place.element);
        self.lay_path(&before);
        let Some(region) = self.tip.region else {
            if !self.tip.outside {
                self.note(EventKind::Out, tip, None);
            }
            self.be_outside();
            return false;
        };
        self.tip.outside = false;
        let recuts = self.tip.front.is_some();
        // A withdrawn tip keeps its cutting force until it is relieved of it.
        if advance > 0.0 {
            self.tip.in_channel = !recuts && self.channel.holds(&self.tip.reference, self.needle.radius_mm());
        }
        if self.tip.in_channel {
            self.tip.cut_mm = 0.0;
        } else if advance > 0.0 {
            self.tip.cut_mm += (self.tip.reference - before).norm();
            self.channel.cut(&before, &self.tip.reference);
        }
        if self.of(region).bone.is_some() {
            self.tip.forget_row();
            self.stop_at_bone(region, advance);
            return false;
        }
        if self.tip.is_pinned() {
            return false;
        }
        self.tip.found = Some(place);
        advance > 0.0 && self.wants_node(&place) && self.remesh(&place, region)
    }

    /// Returns the interaction of a region with the needle.
    pub(super) fn of(&self, region: i32) -> Interaction {
        interaction(self.anatomy.as_ref(), Some(region))
    }

    /// Records that the tip is outside all tissue.
    fn be_outside(&mut self) {
        self.tip.outside = true;
        self.tip.forget_row();
        self.leave_bare();
    }

    /// Takes the tip through the regions from its position in the tissue at rest to `place`, or to the first surface that
    /// stops it: tissue that springs back as a surface breaks comes to rest there.
    fn pass(&mut self, before: &Point3<f64>, at_rest: &Point3<f64>, place: Place) -> Place {
        let pieces = ((at_rest - before).norm() / SAMPLE_MM).ceil();
        for piece in 1..pieces as usize {
            self.tip.reference = before + (at_rest - before) * (piece as f64 / pieces);
            if self.cross()
                && let Some(held) = self.locate_at_rest(&self.tip.reference, place.element)
            {
                return held;
            }
        }
        self.tip.reference = *at_rest;
        self.cross();
        place
    }

    /// Records the region that the tip has entered and returns whether its surface stops the tip. Near the last boundary no
    /// other region is recorded, so that a tip that wanders along a boundary does not cross it repeatedly; bone and critical
    /// regions always are.
    fn cross(&mut self) -> bool {
        let region = self.anatomy.region(&self.tip.reference);
        let of = interaction(self.anatomy.as_ref(), region);
        let same = region == self.tip.region || self.tip.front.is_some();
        let near = (self.tip.reference - self.tip.crossed).norm() < BORDER_MM && of.bone.is_none() && !of.critical;
        if same || near {
            return false;
        }
        (self.tip.region, self.tip.crossed) = (region, self.tip.reference);
        let Some(region) = region else { return false };
        let tip = self.line.tip();
        self.note(EventKind::Region, tip, Some(region));
        self.meet_surface(region);
        self.tip.surface.is_some()
    }

    /// Handles a tip that has entered bone during an `advance` (mm) of the base.
    fn stop_at_bone(&mut self, region: i32, advance: f64) {
        // Bone is not met while the needle is withdrawn.
        let Some(bone) = self.of(region).bone.filter(|_| !self.tip.in_bone() && advance >= 0.0) else {
            return;
        };
        let ShaftPoint { point_mm, tangent } = self.line.at(self.line.length_mm());
        let border = self.border_behind(&tangent, |other| other == Some(region));
        // A needle that entered from the side has not advanced farther than its base.
        let depth = border.unwrap_or(0.0).min(advance);
        self.meet_bone(&bone, &(point_mm - tangent.into_inner() * depth), region);
    }

    /// Returns the distance from the tip back along the needle to the boundary of the regions `within`, mm, in the tissue at
    /// rest.
    pub(super) fn border_behind(&self, tangent: &Vector3<f64>, within: impl Fn(Option<i32>) -> bool) -> Option<f64> {
        let is_in = |behind: f64| within(self.anatomy.region(&(self.tip.reference - tangent * behind)));
        let most = (self.line.length_mm() / SAMPLE_MM).ceil() as usize;
        let beyond = (1..=most).find(|at| !is_in(*at as f64 * SAMPLE_MM))?;
        let [mut inside, mut outside] = [beyond - 1, beyond].map(|at| at as f64 * SAMPLE_MM);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (inside + outside);
            *(if is_in(middle) { &mut inside } else { &mut outside }) = middle;
        }
        Some(inside)
    }

    /// Extends the path from the last node to the tip, which was at `before` in the reference state, or shortens it.
    pub(super) fn lay_path(&mut self, before: &Point3<f64>) {
        let length = self.line.length_mm();
        let Some(last) = self.contacts.last_mut() else { return };
        let ahead = length - last.arc;
        let laid = last.laid();
        if ahead <= laid {
            last.shorten(ahead);
            return;
        }
        let pieces = ((ahead - laid) / SAMPLE_MM).ceil().max(1.0);
        for piece in 0..pieces as usize {
            let middle = before + (self.tip.reference - before) * ((piece as f64 + 0.5) / pieces);
            let region = self.anatomy.region(&middle);
            // The shaft does not enter bone.
            let is_bone = interaction(self.anatomy.as_ref(), region).bone.is_some();
            let behind = last.layers.last().map_or(last.region, |layer| layer.region);
            last.lengthen(if is_bone { behind } else { region }, (ahead - laid) / pieces);
        }
    }

    /// Returns whether the tip has left the elements around the last node, if any, and is far enough from it.
    fn wants_node(&self, place: &Place) -> bool {
        let spacing = self.options.spacing_mm;
        let refused = self
            .tip
            .refused
            .is_some_and(|refused| (refused - self.tip.reference).norm() < spacing / 4.0);
        let beyond = self.contacts.last().is_none_or(|last| {
            let elsewhere = !self.mesh.elements()[place.element as usize].contains(&last.node);
            elsewhere && self.line.length_mm() - last.arc >= spacing
        });
        beyond && !refused && (self.tip.surface.is_none() || self.contacts.is_empty()) && place.is_inside()
    }

    /// Moves a corner to the tip.
    fn remesh(&mut self, place: &Place, region: i32) -> bool {
        let Some(node) = self.move_corner(place.element, self.tip.reference) else {
            self.refuse(region);
            return false;
        };
        let cutting = self.cutting();
        // Tissue sticks at an unbroken surface.
        let slides = self.contacts.last().filter(|_| self.tip.surface.is_none());
        let state = slides.map_or(State::Stuck, |last| last.slider.state);
        self.add_contact(node, self.line.length_mm(), state, Some(region));
        if let (true, [.., before, last]) = (self.tip.at_node, &mut self.forces[..self.contacts.len()]) {
            let tangent = self.line.at(self.line.length_mm()).tangent;
            *last = tangent.into_inner() * tangent.dot(before).clamp(0.0, cutting);
            *before -= *last;
        }
        self.find_again(place.element);
        self.transfer();
        true
    }

    /// Locates tip and last node in the changed mesh under the forces of the previous mesh: a change of the mesh is no
    /// motion of the needle, so it neither drags tissue nor relieves the hand. The tip comes to lie behind the node, by the
    /// amount that this yields more to the cutting force than the corners that shared it before.
    pub(super) fn transfer(&mut self) {
        let front = self.tip.front.unwrap_or(self.tip.reference);
        for _ in 0..TRANSFERS {
            self.take_tip();
            self.take_compliance();
            self.write_arcs();
            self.carry();
            let Some(place) = self
                .tip
                .element
                .and_then(|element| self.find(&self.line.tip(), element))
            else {
                break;
            };
            let (before, at_rest) = (self.tip.reference, self.point_at(&place));
            (self.tip.reference, self.tip.element, self.tip.found) = (at_rest, Some(place.element), Some(place));
            if (at_rest - before).norm() < TRANSFERRED_MM {
                break;
            }
        }
        self.tip.front = Some(front);
        for at in 0..self.contacts.len() {
            let place = self.contacts[at].reference + self.displacement_of(self.contacts[at].node);
            let arc = self.line.nearest(&place);
            (self.contacts[at].arc, self.memory.starts[at]) = (arc, arc);
        }
    }

    /// Records that no corner fits at the tip; reported once, as one may fit farther on.
    pub(super) fn refuse(&mut self, region: i32) {
        if self.tip.refused.replace(self.tip.reference).is_none() {
            self.note(EventKind::NotRemeshed, self.line.tip(), Some(region));
        }
    }

    /// Moves the best corner of an element to a point of the reference state. Returns the node, or `None` if none fits.
    pub(super) fn move_corner(&mut self, element: u32, to: Point3<f64>) -> Option<u32> {
        let node = self.corner(element, to, |_| true)?;
        self.move_node(node, to).then_some(node)
    }

    /// Moves a node to a point of the reference state, if that spoils no element.
    pub(super) fn move_node(&mut self, node: u32, to: Point3<f64>) -> bool {
        let moved = self.adaptation.move_node(node, to.into()).is_ok();
        self.outcome.remeshes += usize::from(moved);
        moved
    }

    /// Returns the best of the permitted corners to move to a point of the reference state, or `None` if none fits.
    pub(super) fn corner(&self, element: u32, to: Point3<f64>, may: impl Fn(u32) -> bool) -> Option<u32> {
        let taken = |node: u32| {
            let on_needle = self.contacts.iter().any(|contact| contact.node == node);
            let on_probe = self.press.as_ref().is_some_and(|press| press.nodes().contains(&node));
            on_needle || on_probe || !may(node)
        };
        let corner = best_corner(self.adaptation.mesh(), element, to.into(), taken).ok()?;
        (corner.condition <= self.options.condition_limit).then_some(corner.node)
    }

    pub(super) fn add_contact(&mut self, node: u32, arc: f64, state: State, region: Option<i32>) {
        self.forces.insert(self.contacts.len(), Vector3::zeros());
        self.contacts.push(Contact {
            node,
            reference: self.adaptation.mesh().nodes()[node as usize].into(),
            arc,
            slider: Slider::new(state),
            region,
            drift: -1.0,
            layers: Vec::new(),
        });
        self.memory.starts.push(arc);
        self.tip.refused = None;
        self.tip.corners.retain(|other| *other != node);
        self.name_contacts();
    }

    /// Locates the tip among the elements around the moved corner.
    pub(super) fn find_again(&mut self, from: u32) {
        let point = self.tip.reference;
        self.tip.found = self.locate_at_rest(&point, from);
        if let Some(place) = &self.tip.found {
            self.tip.element = Some(place.element);
        }
    }

    /// Passes the contacts to the remesher: those of the probe, those of the needle, corners at the tip.
    pub(super) fn name_contacts(&mut self) {
        let dofs = &mut self.memory.dofs;
        dofs.clear();
        let mesh = self.adaptation.mesh();
        let probe = self.press.iter().flat_map(|press| press.nodes().iter().copied());
        let needle = self.contacts.iter().map(|contact| contact.node);
        let nodes = probe.chain(needle).chain(self.tip.corners.iter().copied());
        dofs.extend(nodes.flat_map(|node| mesh.dofs().of(node)).map(|dof| dof as usize));
        if let Err(error) = self.adaptation.ask(|_, remesher| remesher.set_contacts(dofs)) {
            unreachable!("contacts are free nodes, each once: {error}");
        }
        self.version += 1;
    }
}
