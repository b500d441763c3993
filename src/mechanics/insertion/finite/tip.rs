//! State of the tip: its place in the tissue, the cutting force, and the bone that stops it.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::Log;
use super::body::CutTissue;
use super::contact::{Slider, State, set_friction_bounds};
use super::contacts::Contacts;
use super::location::Place;
use super::needle::PlacedNeedle;
use super::reduced::TipRow;
use super::tissue::Tissue;
use crate::insertion::interaction::BORDER_MM;
use crate::insertion::{Bone, EventKind};
use crate::needle::CentreLine;

/// Distance by which a needle that was moved off bone catches up with the hand in each substep, mm.
const CATCH_UP_MM: f64 = 0.5;
/// Barycentric share of the last node in the position of the tip above which the tip is at that node.
const AT_NODE: f64 = 0.999;

/// State of the tip.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tip {
    /// Whether the tip has come out of the tissue on another side.
    pub outside: bool,
    /// Element that contains the tip or is nearest to it.
    pub element: Option<u32>,
    pub region: Option<i32>,
    /// Position of the last crossing of a boundary, in the reference state, mm.
    pub crossed: Point3<f64>,
    /// Whether the tip is in tissue that is cut already.
    pub in_channel: bool,
    /// Newly cut length behind the tip, mm.
    pub cut_mm: f64,
    /// Position in the reference state before a change of the mesh that left the tip behind: up to there it cuts again,
    /// without events.
    #[serde(rename = "front")]
    pub cut_front: Option<Point3<f64>>,
    /// Position in the reference state, mm.
    pub reference: Point3<f64>,
    /// A new place that is not yet in the system.
    #[serde(rename = "found")]
    pub new_place: Option<Place>,
    #[serde(flatten)]
    pub force: TipForce,
    /// Nodes in the system that are neither on the needle nor on the probe: corners of the element at the tip.
    pub corners: Vec<u32>,
    /// Puncture force of an unbroken surface in front of the tip, N.
    pub surface: Option<f64>,
    /// Position at which no corner fitted, mm: none is tried again there.
    #[serde(rename = "refused")]
    pub refused_at: Option<Point3<f64>>,
    /// Whether the tip entered where no node could be made on or near the surface: the tissue is fixed there, and the
    /// depth counts from the entry.
    #[serde(rename = "bare")]
    pub entered_without_node: bool,
    bone: Option<Met>,
}

/// Place at which the force at the tip acts.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "SavedForce", into = "SavedForce")]
pub(super) enum TipForce {
    /// Nowhere: nothing is cut.
    #[default]
    None,
    /// On the tissue: the corners of the element at the tip share the cutting force.
    Tissue(TipRow),
    /// On the last node on the needle, which is at the tip.
    Node,
    /// On bone, which pins the tip of a flexible needle.
    Bone(TipRow),
}

/// Form of [`TipForce`] in saved states.
#[derive(Serialize, Deserialize)]
struct SavedForce {
    row: Option<TipRow>,
    at_node: bool,
}

impl From<SavedForce> for TipForce {
    fn from(SavedForce { row, at_node }: SavedForce) -> Self {
        match row {
            Some(row) if row.compliance_mm_per_n > 0.0 => TipForce::Bone(row),
            Some(row) => TipForce::Tissue(row),
            None if at_node => TipForce::Node,
            None => TipForce::None,
        }
    }
}

impl From<TipForce> for SavedForce {
    fn from(force: TipForce) -> Self {
        let at_node = force == TipForce::Node;
        let row = force.into_row();
        SavedForce { row, at_node }
    }
}

impl TipForce {
    /// Returns the row of the tip in the system.
    pub(super) fn row(&self) -> Option<&TipRow> {
        match self {
            TipForce::Tissue(row) | TipForce::Bone(row) => Some(row),
            TipForce::None | TipForce::Node => None,
        }
    }

    pub(crate) fn row_mut(&mut self) -> Option<&mut TipRow> {
        match self {
            TipForce::Tissue(row) | TipForce::Bone(row) => Some(row),
            TipForce::None | TipForce::Node => None,
        }
    }

    fn into_row(self) -> Option<TipRow> {
        match self {
            TipForce::Tissue(row) | TipForce::Bone(row) => Some(row),
            TipForce::None | TipForce::Node => None,
        }
    }

    pub(crate) fn is_on_node(&self) -> bool {
        matches!(self, TipForce::Node)
    }

    /// Returns whether bone pins the tip, as with a flexible needle.
    pub(crate) fn is_on_bone(&self) -> bool {
        matches!(self, TipForce::Bone(_))
    }

    /// Removes a cutting force; bone stays.
    pub(crate) fn stop_cutting(&mut self) {
        if !self.is_on_bone() {
            *self = TipForce::None;
        }
    }
}

/// Bone met by the tip.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Met {
    at: Point3<f64>,
    bone: Bone,
    /// Lag of the needle behind the hand, mm.
    behind: f64,
}

impl Met {
    /// Removes the bone from under the tip, which continues from where it is.
    fn leave(&mut self, line: &CentreLine) {
        (self.bone, self.at) = (Bone::LEFT, line.tip());
    }

    /// Returns the depth in bone that the hand demands of the tip, mm.
    fn demanded(&self, line: &CentreLine) -> f64 {
        let tangent = line.point_at_arc(line.length_mm()).tangent;
        tangent.dot(&(line.tip() - self.at)) + self.behind
    }
}

impl Tip {
    pub(super) fn in_bone(&self) -> bool {
        self.bone.is_some_and(|contact| contact.bone.holds())
    }

    /// Returns the pose of the needle's base for this pose of the hand: behind it while bone stops the tip.
    pub(super) fn stopped(&self, base: &Isometry3<f64>) -> Isometry3<f64> {
        let behind = self.bone.map_or(0.0, |bone| bone.behind);
        let mut stopped = *base;
        stopped.translation.vector -= base.rotation * Vector3::z() * behind;
        stopped
    }

    /// Returns the force of bone on the tip of a rigid needle, N: it grows with the demanded depth in the bone.
    pub(crate) fn bone_force(&self, line: &CentreLine) -> Vector3<f64> {
        let Some(contact) = self.bone.filter(|_| !self.force.is_on_bone()) else {
            return Vector3::zeros();
        };
        let tangent = line.point_at_arc(line.length_mm()).tangent;
        tangent.into_inner() * -contact.bone.force_n(contact.demanded(line))
    }

    /// Enters the tissue at a new place of the tip into the system.
    pub(crate) fn add_to_system(&mut self, contacts: &mut Contacts, tissue: &mut Tissue, body: &CutTissue) {
        let Some(place) = self.new_place.take() else { return };
        let last = contacts.nodes.last();
        let node = last.map(|last| last.node);
        // The force keeps its state of stick or slip wherever it acts next: moving it is no motion of the needle.
        let before = std::mem::take(&mut self.force).into_row().map(|row| row.slider.state);
        let state = before.or(last.map(|last| last.slider.state));
        let state = state.filter(|_| self.surface.is_none()).unwrap_or(State::Stuck);
        let corners = tissue.mesh.elements()[place.element as usize];
        let share = corners
            .iter()
            .position(|corner| Some(*corner) == node)
            .map_or(0.0, |corner| place.bary[corner]);
        if share > AT_NODE {
            self.force = TipForce::Node;
            // The cutting force moves from the tissue beside the node to the node.
            if let (Some(before), Some(last)) = (before, contacts.nodes.last_mut()) {
                last.slider.state = before;
            }
        } else if self.cutting(body) > 0.0 && corners.iter().any(|node| tissue.is_free(*node)) {
            self.take_corners(&place, contacts, tissue);
            self.force = TipForce::Tissue(self.row_at(&place, Slider::new(state), contacts, tissue));
        }
    }

    /// Sets the bounds of all sliders.
    pub(super) fn bound(&mut self, contacts: &mut Contacts, line: &CentreLine, body: &CutTissue) {
        // Shaft that has come out on another side has no friction.
        let end = self.end_in_tissue(contacts, line);
        let cut_mm = if self.outside { 0.0 } else { self.cut_mm };
        set_friction_bounds(body.anatomy.as_ref(), &mut contacts.nodes, end, cut_mm);
        let cutting = self.cutting(body);
        match &mut self.force {
            TipForce::Bone(row) => row.slider.set_bounds([f64::INFINITY, 0.0]),
            TipForce::Tissue(row) => row.slider.set_bounds([cutting, 0.0]),
            TipForce::Node => {
                if let Some(last) = contacts.nodes.last_mut() {
                    last.slider.sliding[0] += cutting;
                    last.slider.static_limits[0] += cutting;
                }
            }
            TipForce::None => {}
        }
    }

    /// Returns the arc length at which the needle in the tissue ends, mm: at the tip, unless that has come out on
    /// another side.
    pub(crate) fn end_in_tissue(&self, contacts: &Contacts, line: &CentreLine) -> f64 {
        let last = contacts.nodes.last().filter(|_| self.outside);
        last.map_or(line.length_mm(), |last| last.arc + last.path_mm())
    }

    /// Returns the cutting force at the tip, N; at a surface its puncture force, until the tip has slipped into it.
    pub(super) fn cutting(&self, body: &CutTissue) -> f64 {
        let interaction = body.interaction(self.region);
        let cutting = if self.in_channel { 0.0 } else { interaction.cutting_n };
        self.surface.unwrap_or(cutting)
    }

    /// Returns the slider of the cutting force.
    fn slider<'a>(&'a mut self, contacts: &'a mut Contacts) -> Option<&'a mut Slider> {
        match &mut self.force {
            TipForce::Tissue(row) | TipForce::Bone(row) => Some(&mut row.slider),
            TipForce::Node => contacts.nodes.last_mut().map(|last| &mut last.slider),
            TipForce::None => None,
        }
    }

    /// Ensures that the corners which share the force at a place are in the system.
    fn take_corners(&mut self, place: &Place, contacts: &Contacts, tissue: &mut Tissue) {
        let corners = tissue.mesh.elements()[place.element as usize];
        let is_new = |node: &u32, others: &[u32]| {
            tissue.is_free(*node) && tissue.index_of(*node, &contacts.nodes, others).is_none()
        };
        if !corners.iter().any(|node| is_new(node, &self.corners)) {
            return;
        }
        self.corners.clear();
        for node in corners {
            if is_new(&node, &self.corners) {
                self.corners.push(node);
            }
        }
        tissue.register_contacts(&contacts.nodes, &self.corners);
    }

    /// Returns the row of a place whose corners are in the system, except fixed ones.
    fn row_at(&self, place: &Place, slider: Slider, contacts: &Contacts, tissue: &Tissue) -> TipRow {
        let corners = tissue.mesh.elements()[place.element as usize];
        let share = |corner: usize| {
            tissue
                .index_of(corners[corner], &contacts.nodes, &self.corners)
                .map_or((0, 0.0), |index| (index, place.bary[corner]))
        };
        TipRow {
            shares: std::array::from_fn(share),
            compliance_mm_per_n: 0.0,
            reference: tissue.point_at(place),
            slider,
        }
    }

    /// Records that a surface is broken, once the tip slips into it.
    pub(crate) fn break_surface(&mut self, contacts: &mut Contacts, line: &CentreLine, log: &mut Log) {
        let cuts = self
            .slider(contacts)
            .is_some_and(|slider| slider.state == State::Slipping(1.0));
        if cuts && self.surface.take().is_some() {
            log.note(EventKind::Puncture, line.tip(), self.region);
        }
    }

    /// Handles a surface in front of the tip that withstands more than the tissue behind it: it sticks until it breaks.
    pub(crate) fn meet_surface(
        &mut self,
        region: i32,
        body: &CutTissue,
        needle: &PlacedNeedle,
        contacts: &mut Contacts,
        log: &mut Log,
    ) {
        let interaction = body.interaction(Some(region));
        if interaction.critical {
            log.note(EventKind::Critical, needle.line.tip(), Some(region));
        }
        let breaks = interaction.puncture_n > interaction.cutting_n
            && !body.channel.contains(&self.reference, needle.radius_mm());
        self.surface = breaks.then_some(interaction.puncture_n);
        if self.surface.is_some()
            && let Some(slider) = self.slider(contacts)
        {
            slider.state = State::Stuck;
        }
    }

    /// Records the region that the tip has entered and returns whether its surface stops the tip. Near the last
    /// boundary no other region is recorded, so that a tip that wanders along a boundary does not cross it repeatedly;
    /// bone and critical regions always are.
    pub(super) fn cross(
        &mut self,
        body: &CutTissue,
        needle: &PlacedNeedle,
        contacts: &mut Contacts,
        log: &mut Log,
    ) -> bool {
        let region = body.anatomy.region(&self.reference);
        let interaction = body.interaction(region);
        let same = region == self.region || self.cut_front.is_some();
        let near =
            (self.reference - self.crossed).norm() < BORDER_MM && interaction.bone.is_none() && !interaction.critical;
        if same || near {
            return false;
        }
        (self.region, self.crossed) = (region, self.reference);
        let Some(region) = region else { return false };
        log.note(EventKind::Region, needle.line.tip(), Some(region));
        self.meet_surface(region, body, needle, contacts, log);
        self.surface.is_some()
    }

    /// Handles a tip that has entered bone during an `advance` (mm) of the base.
    pub(crate) fn stop_at_bone(
        &mut self,
        region: i32,
        advance: f64,
        body: &CutTissue,
        needle: &PlacedNeedle,
        log: &mut Log,
    ) {
        // Bone is not met while the needle is withdrawn.
        let bone = body.interaction(Some(region)).bone;
        let Some(bone) = bone.filter(|_| !self.in_bone() && advance >= 0.0) else {
            return;
        };
        let tip = needle.tip();
        let length = needle.line.length_mm();
        let border = body.border_behind(&self.reference, &tip.tangent, length, |sampled| sampled == Some(region));
        // A needle that entered from the side has not advanced farther than its base.
        let depth = border.unwrap_or(0.0).min(advance);
        let border_point = tip.point_mm - tip.tangent.into_inner() * depth;
        self.meet_bone(&bone, &border_point, region, needle.is_flexible(), log);
    }

    /// Records bone met `at` a point, unless some is already. The shape of a flexible needle is solved with bone as one
    /// of its contacts.
    pub(crate) fn meet_bone(
        &mut self,
        bone: &Bone,
        point: &Point3<f64>,
        region: i32,
        is_flexible: bool,
        log: &mut Log,
    ) {
        if !self.in_bone() {
            self.bone = Some(Met {
                at: *point,
                bone: *bone,
                behind: self.bone.map_or(0.0, |left| left.behind),
            });
            log.note(EventKind::Bone, *point, Some(region));
        }
        if is_flexible {
            self.force = TipForce::Bone(TipRow {
                shares: [(0, 0.0); 4],
                compliance_mm_per_n: 1.0 / bone.stiffness_n_per_mm,
                reference: *point,
                slider: Slider::new(State::Stuck),
            });
        }
    }

    /// Limits the depth of the tip in bone, and drops bone that it has left. Returns whether the base has moved.
    pub(crate) fn limit_depth_in_bone(&mut self, body: &CutTissue, line: &CentreLine) -> bool {
        let tangent = line.point_at_arc(line.length_mm()).tangent;
        let (is_pinned, reference) = (self.force.is_on_bone(), self.reference);
        let Some(contact) = &mut self.bone else { return false };
        if !contact.bone.holds() {
            contact.at += tangent.into_inner() * CATCH_UP_MM;
        } else if !is_pinned && !contact.bone.is_in_front(body.anatomy.as_ref(), &reference, &tangent) {
            contact.leave(line);
        }
        // What the hand demands is the depth of the tip and the lag behind the hand together.
        let demanded = contact.demanded(line);
        let behind = contact.bone.behind_mm(demanded);
        let moved = behind != contact.behind;
        contact.behind = behind;
        if demanded < 0.0 {
            self.bone = None;
            if is_pinned {
                self.force = TipForce::None;
            }
        }
        moved
    }

    /// Records that no corner fits at the tip; reported once, as one may fit farther on.
    pub(super) fn refuse(&mut self, region: i32, line: &CentreLine, log: &mut Log) {
        if self.refused_at.replace(self.reference).is_none() {
            log.note(EventKind::NotRemeshed, line.tip(), Some(region));
        }
    }

    /// Locates the tip in the reference state, searching from an element.
    pub(super) fn locate(&mut self, tissue: &Tissue, from: u32) {
        self.new_place = tissue.locate_at_rest(&self.reference, from);
        if let Some(place) = &self.new_place {
            self.element = Some(place.element);
        }
    }

    /// Returns the position of the tissue at the tip at rest, mm, or `None` outside.
    pub(super) fn at_rest(&self, needle: &PlacedNeedle) -> Option<Point3<f64>> {
        let inside = needle.entry.is_some() && !self.outside && self.element.is_some();
        inside.then_some(self.reference)
    }

    /// Returns the depth of a tip that entered without a node, mm: fixed tissue stays where it is.
    pub(crate) fn depth_without_node_mm(&self, needle: &PlacedNeedle) -> f64 {
        let tangent = needle.tip().tangent;
        let entry = needle.entry.as_ref().filter(|_| self.entered_without_node);
        entry.map_or(0.0, |entry| tangent.dot(&(needle.line.tip() - entry.point_mm)).max(0.0))
    }
}
