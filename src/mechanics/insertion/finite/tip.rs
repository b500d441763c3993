//! State of the tip: its place in the tissue, the cutting force, and the bone that stops it.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::Log;
use super::body::CutTissue;
use super::contact::{Slider, State, set_friction_bounds};
use super::contacts::{Contacts, HELD_MM};
use super::location::Place;
use super::needle::PlacedNeedle;
use super::reduced::TipRow;
use super::tissue::Tissue;
use crate::insertion::interaction::BORDER_MM;
use crate::insertion::{Bone, EventKind};
use crate::needle::CentreLine;

/// Distance by which a needle that was moved off bone catches up with the hand in each substep, mm.
const CATCH_UP_MM: f64 = 0.5;
/// Travel of the tip in the tissue after which the compliance of its patch is computed anew, in radii of the patch: no
/// multiple of usual steps, which rounding would put here or there.
const ANEW: f64 = 0.097;
/// Share of the cutting force by which the force at a tip that sticks differs from those at which it slides.
const SLIDES: f64 = 1e-3;
/// Part of the offset of a dent that is released per motion of the instruments.
const RELEASE: f64 = 0.3;
/// Maximum travel of the tip in the tissue per motion of the instruments.
const TRAVEL: f64 = 1.3;
/// Length of a bevel, in diameters of the needle: a ground angle of 22 degrees. Over this length the edge of the tip
/// crosses from one tissue into another.
const BEVEL_DIAMETERS: f64 = 2.5;

/// State of the tip.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tip {
    /// Whether the tip has come out of the tissue on another side.
    pub outside: bool,
    /// Whether the event of that has been reported.
    #[serde(default)]
    pub out_told: bool,
    /// Element that contains the tip or is nearest to it.
    pub element: Option<u32>,
    pub region: Option<i32>,
    /// Position of the last crossing of a boundary, in the reference state, mm.
    pub crossed: Point3<f64>,
    /// Region left there.
    #[serde(default)]
    pub left: Option<i32>,
    /// Whether the tip is in tissue that is cut already.
    pub in_channel: bool,
    /// Newly cut length behind the tip, mm.
    pub cut_mm: f64,
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
    /// Whether the unbroken surface is that of the body.
    #[serde(default)]
    pub at_skin: bool,
    /// Whether a surface has broken, over which the tissue has not sprung back yet.
    #[serde(default)]
    springs_back: bool,
    /// Tissue behind the edge of the tip: cutting force (N) and length (mm), the oldest first.
    #[serde(default)]
    pub edge: Vec<[f64; 2]>,
    /// The dent of the tissue at the tip.
    #[serde(default)]
    pub dent: Dent,
    /// Position at which no corner fitted, mm: none is tried again there.
    #[serde(rename = "refused")]
    pub refused_at: Option<Point3<f64>>,
    /// Whether the tip entered where no node could be made on or near the surface: the tissue is fixed there, and the
    /// depth counts from the entry.
    #[serde(rename = "bare")]
    pub entered_without_node: bool,
    bone: Option<Met>,
}

/// Dent of the tissue at the tip: how far the tip is ahead of where the other forces have moved the tissue there. It is
/// `offset_mm` and what the force at the tip adds, and belongs to the tip, not to the element there.
///
/// Whatever changes at once beside the force, be it mesh, stiffness or place, changes the offset in place of the force.
/// It is released as the needle moves on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Dent {
    /// Compliance of the patch of tissue that bears the force, mm/N.
    pub compliance_mm_per_n: f64,
    /// Its value in the tissue where it was last computed, mm/N.
    pub target_mm_per_n: f64,
    /// Travel of the tip in the tissue since then, in radii of the patch.
    pub travel: f64,
    /// Depth without force, mm.
    pub offset_mm: f64,
    /// Force in the last solution, N.
    pub force_n: f64,
    /// Way that the needle was withdrawn since it last advanced, up to [`HELD_MM`], mm.
    pub withdrawn_mm: f64,
}

impl Dent {
    /// Returns the depth, mm.
    pub(super) fn depth_mm(&self) -> f64 {
        self.offset_mm + self.compliance_mm_per_n * self.force_n
    }

    /// Records an advance of the needle, mm.
    pub(super) fn advance(&mut self, advance_mm: f64) {
        self.withdrawn_mm = (self.withdrawn_mm - advance_mm).clamp(0.0, HELD_MM);
    }

    /// Lets the compliance follow that of the tissue over a travel of the tip, in radii of the patch, at the same force
    /// and depth.
    fn follow(&mut self, travel: f64) {
        let share = 1.0 - (-travel).exp();
        let change = (self.target_mm_per_n - self.compliance_mm_per_n) * share;
        self.compliance_mm_per_n += change;
        self.offset_mm -= change * self.force_n;
    }
}

/// Limits of what the tip does in one motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct TipLimits {
    /// Maximum travel in the tissue, mm.
    pub travel_mm: f64,
    /// Part of a dent's offset that is released, mm.
    pub release_mm: f64,
}

impl TipLimits {
    /// Limits for a motion (mm) of the instruments.
    pub(super) fn of(motion_mm: f64) -> TipLimits {
        TipLimits {
            travel_mm: TRAVEL * motion_mm,
            release_mm: RELEASE * motion_mm,
        }
    }

    /// Returns whether the tissue springs back.
    pub(super) fn springs(&self) -> bool {
        self.release_mm == f64::INFINITY
    }

    /// Limits for tissue that springs back, by up to a travel (mm) of the tip in it.
    pub(super) fn springing(travel_mm: f64) -> TipLimits {
        TipLimits {
            travel_mm,
            release_mm: f64::INFINITY,
        }
    }
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
    /// On bone, which pins the tip of a flexible needle.
    Bone(TipRow),
}

/// Form of [`TipForce`] in saved states.
#[derive(Serialize, Deserialize)]
struct SavedForce {
    row: Option<TipRow>,
}

impl From<SavedForce> for TipForce {
    fn from(SavedForce { row }: SavedForce) -> Self {
        match row {
            Some(row) if row.is_bone => TipForce::Bone(row),
            Some(row) => TipForce::Tissue(row),
            None => TipForce::None,
        }
    }
}

impl From<TipForce> for SavedForce {
    fn from(force: TipForce) -> Self {
        let row = force.into_row();
        SavedForce { row }
    }
}

impl TipForce {
    /// Returns the row of the tip in the system.
    pub(super) fn row(&self) -> Option<&TipRow> {
        match self {
            TipForce::Tissue(row) | TipForce::Bone(row) => Some(row),
            TipForce::None => None,
        }
    }

    pub(crate) fn row_mut(&mut self) -> Option<&mut TipRow> {
        match self {
            TipForce::Tissue(row) | TipForce::Bone(row) => Some(row),
            TipForce::None => None,
        }
    }

    fn into_row(self) -> Option<TipRow> {
        match self {
            TipForce::Tissue(row) | TipForce::Bone(row) => Some(row),
            TipForce::None => None,
        }
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
    pub(crate) fn add_to_system(
        &mut self,
        tangent: &Vector3<f64>,
        contacts: &Contacts,
        tissue: &mut Tissue,
        body: &CutTissue,
    ) {
        let Some(place) = self.new_place.take() else { return };
        let last = contacts.nodes.last();
        // The force keeps its state of stick or slip wherever it acts next: moving it is no motion of the needle.
        let before = std::mem::take(&mut self.force).into_row().map(|row| row.slider.state);
        let state = before.or(last.map(|last| last.slider.state));
        let state = state.filter(|_| self.surface.is_none()).unwrap_or(State::Stuck);
        if self.cutting(body) > 0.0 && self.dent.compliance_mm_per_n > 0.0 {
            self.take_corners(&place, contacts, tissue);
            self.force = TipForce::Tissue(self.row_at(&place, Slider::new(state), tangent, contacts, tissue));
        }
    }

    /// Takes the force of the last solution at the dent.
    pub(super) fn settle_dent(&mut self, contacts: &Contacts, tangent: &Vector3<f64>) {
        let is_tissue = matches!(self.force, TipForce::Tissue(_)) && contacts.has_others[0];
        let force = contacts.forces.get(contacts.nodes.len()).filter(|_| is_tissue);
        self.dent.force_n = force.map_or(0.0, |force| tangent.dot(force));
    }

    /// Releases a part of the dent's offset, while the tip slides in the tissue, or is about to: rounding does not decide.
    pub(super) fn release_dent(&mut self, release_mm: f64, body: &CutTissue) {
        let cutting_n = self.cutting(body);
        let sticks = (SLIDES * cutting_n..(1.0 - SLIDES) * cutting_n).contains(&self.dent.force_n);
        if !(sticks && matches!(self.force, TipForce::Tissue(_))) {
            self.dent.offset_mm -= self.dent.offset_mm.clamp(-release_mm, release_mm);
        }
    }

    /// Releases all of the dent that no force explains.
    pub(super) fn release_all(&mut self, tangent: &Vector3<f64>) {
        let depth_mm = self.dent.depth_mm() - self.dent.offset_mm;
        self.take_depth(depth_mm, tangent);
    }

    /// Takes the depth of the dent as it is in the tissue, at the same force.
    pub(super) fn take_depth(&mut self, depth_mm: f64, tangent: &Vector3<f64>) {
        let offset_mm = depth_mm - self.dent.compliance_mm_per_n * self.dent.force_n;
        let change = offset_mm - std::mem::replace(&mut self.dent.offset_mm, offset_mm);
        if let TipForce::Tissue(row) = &mut self.force {
            row.reference += tangent * change;
        }
    }

    /// Takes the compliance of the tissue after the tip has travelled in it from `before` (reference state).
    pub(super) fn follow_tissue(&mut self, before: &Point3<f64>, tangent: &Vector3<f64>, body: &CutTissue) {
        let travel = (self.reference - before).norm() / body.patch_mm;
        self.dent.travel += travel;
        if self.dent.travel >= ANEW {
            self.dent.travel = 0.0;
            self.dent.target_mm_per_n = body.patch_compliance(&self.reference, tangent);
        }
        self.dent.follow(travel);
    }

    /// Takes the dent of tissue that the tip has just met.
    pub(super) fn meet_tissue(&mut self, tangent: &Vector3<f64>, body: &CutTissue) {
        let compliance = body.patch_compliance(&self.reference, tangent);
        self.dent = Dent {
            compliance_mm_per_n: compliance,
            target_mm_per_n: compliance,
            withdrawn_mm: self.dent.withdrawn_mm,
            ..Dent::default()
        };
        self.edge.clear();
    }

    /// Returns whether the tip is at the unbroken surface of the body.
    pub(super) fn is_at_skin(&self) -> bool {
        self.at_skin && self.surface.is_some()
    }

    /// Returns whether the tip sticks at an unbroken surface.
    pub(super) fn sticks_at_surface(&self) -> bool {
        self.surface.is_some() && matches!(&self.force, TipForce::Tissue(row) if row.slider.is_stuck())
    }

    /// Records a length (mm) that the edge of the tip has advanced in tissue with a cutting force (N).
    pub(super) fn advance_edge(&mut self, cutting_n: f64, length_mm: f64, needle: &PlacedNeedle) {
        let room = BEVEL_DIAMETERS * 2.0 * needle.radius_mm();
        match self.edge.last_mut() {
            Some(last) if last[0] == cutting_n => last[1] = (last[1] + length_mm).min(room),
            // The edge enters its first tissue as a whole.
            None => self.edge.push([cutting_n, room]),
            Some(_) => self.edge.push([cutting_n, length_mm.min(room)]),
        }
        let mut surplus = self.edge.iter().map(|piece| piece[1]).sum::<f64>() - room;
        self.edge.retain_mut(|piece| {
            let dropped = piece[1].min(surplus.max(0.0));
            (piece[1], surplus) = (piece[1] - dropped, surplus - dropped);
            piece[1] > 0.0
        });
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
            TipForce::None => {}
        }
    }

    /// Returns the arc length at which the needle in the tissue ends, mm: at the tip, unless that has come out on
    /// another side.
    pub(crate) fn end_in_tissue(&self, contacts: &Contacts, line: &CentreLine) -> f64 {
        // Nothing of the needle is in tissue yet.
        if let Some(first) = contacts.nodes.first().filter(|_| self.is_at_skin()) {
            return first.arc;
        }
        let last = contacts.nodes.last().filter(|_| self.outside);
        last.map_or(line.length_mm(), |last| last.arc + last.path_mm())
    }

    /// Returns the cutting force at the tip, N, the mean over its edge; at a surface its puncture force, until the tip
    /// has slipped into it.
    pub(super) fn cutting(&self, body: &CutTissue) -> f64 {
        let length: f64 = self.edge.iter().map(|piece| piece[1]).sum();
        let cutting = if length > 0.0 {
            self.edge.iter().map(|[force, piece]| force * piece).sum::<f64>() / length
        } else {
            self.cutting_here(body)
        };
        self.surface.unwrap_or(cutting)
    }

    /// Returns the cutting force of the tissue at the tip, N.
    pub(super) fn cutting_here(&self, body: &CutTissue) -> f64 {
        if self.in_channel {
            0.0
        } else {
            body.interaction(self.region).cutting_n
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
    fn row_at(
        &self,
        place: &Place,
        slider: Slider,
        tangent: &Vector3<f64>,
        contacts: &Contacts,
        tissue: &Tissue,
    ) -> TipRow {
        let corners = tissue.mesh.elements()[place.element as usize];
        let shares = place.shares();
        let share = |corner: usize| {
            tissue
                .index_of(corners[corner], &contacts.nodes, &self.corners)
                .map_or((0, 0.0), |index| (index, shares[corner]))
        };
        TipRow {
            shares: std::array::from_fn(share),
            compliance_mm_per_n: self.dent.compliance_mm_per_n,
            is_bone: false,
            is_alone: self.is_at_skin(),
            reference: tissue.point_at(place) + tangent * self.dent.offset_mm,
            slider,
        }
    }

    /// Returns whether a surface has broken, over which the tissue has not sprung back yet.
    pub(super) fn is_broken(&self) -> bool {
        self.springs_back
    }

    /// Records that the tissue has sprung back over the tip.
    pub(super) fn spring_back_ends(&mut self) {
        self.springs_back = false;
    }

    /// Records that a surface is broken, once the tip slips into it.
    pub(crate) fn break_surface(&mut self, line: &CentreLine, log: &mut Log) {
        let cuts = self
            .force
            .row()
            .is_some_and(|row| row.slider.state == State::Slipping(1.0));
        if cuts && self.surface.take().is_some() {
            self.springs_back = true;
            log.note(EventKind::Puncture, line.tip(), self.region);
        }
    }

    /// Handles a surface in front of the tip that withstands more than the tissue behind it: it sticks until it breaks.
    pub(crate) fn meet_surface(&mut self, region: i32, body: &CutTissue, needle: &PlacedNeedle, log: &mut Log) {
        let interaction = body.interaction(Some(region));
        if interaction.critical {
            log.note(EventKind::Critical, needle.line.tip(), Some(region));
        }
        let breaks = interaction.puncture_n > interaction.cutting_n
            && !body.channel.contains(&self.reference, needle.radius_mm());
        self.surface = breaks.then_some(interaction.puncture_n);
        if self.surface.is_some()
            && let Some(row) = self.force.row_mut()
        {
            row.slider.state = State::Stuck;
        }
    }

    /// Records the region that the tip has entered and returns whether its surface stops the tip. Near the last
    /// boundary no other region is recorded, so that a tip that wanders along a boundary does not cross it repeatedly;
    /// bone and critical regions always are.
    pub(super) fn cross(&mut self, body: &CutTissue, needle: &PlacedNeedle, log: &mut Log) -> bool {
        let region = body.anatomy.region(&self.reference);
        let interaction = body.interaction(region);
        let same = region == self.region;
        let near =
            (self.reference - self.crossed).norm() < BORDER_MM && interaction.bone.is_none() && !interaction.critical;
        if same || near {
            return false;
        }
        // A tip along a boundary returns into a region whose surface is broken there.
        let returns = region == self.left && (self.reference - self.crossed).norm() < body.patch_mm;
        self.left = std::mem::replace(&mut self.region, region);
        self.crossed = self.reference;
        let Some(region) = region else { return false };
        log.note(EventKind::Region, needle.line.tip(), Some(region));
        self.meet_surface(region, body, needle, log);
        self.surface = self.surface.filter(|_| !returns);
        self.at_skin = false;
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
        self.meet_bone(&bone, &border_point, &tip.tangent, region, needle.is_flexible(), log);
    }

    /// Records bone met `at` a point, unless some is already. The shape of a flexible needle is solved with bone as one
    /// of its contacts.
    pub(crate) fn meet_bone(
        &mut self,
        bone: &Bone,
        point: &Point3<f64>,
        tangent: &Vector3<f64>,
        region: i32,
        is_flexible: bool,
        log: &mut Log,
    ) {
        // The force on the tip goes on as that of bone.
        let begin = point - tangent * (self.dent.force_n / bone.stiffness_n_per_mm);
        if !self.in_bone() {
            self.bone = Some(Met {
                at: begin,
                bone: *bone,
                behind: self.bone.map_or(0.0, |left| left.behind),
            });
            log.note(EventKind::Bone, *point, Some(region));
        }
        if is_flexible {
            self.force = TipForce::Bone(TipRow {
                shares: [(0, 0.0); 4],
                compliance_mm_per_n: 1.0 / bone.stiffness_n_per_mm,
                is_bone: true,
                is_alone: false,
                reference: begin,
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
