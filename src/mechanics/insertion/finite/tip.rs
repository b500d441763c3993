//! State of the tip: its place in the tissue, the cutting force, and the bone that stops it.

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::friction::bound;
use super::place::Place;
use super::reduced::TipRow;
use super::slider::{Slider, State};
use super::{EventKind, Finite};
use crate::mechanics::insertion::Bone;
use crate::mechanics::insertion::anatomy::interaction;
use crate::mechanics::needle::CentreLine;
use crate::mechanics::tissue::dofs::NONE;

/// Distance by which a needle that was moved off bone catches up with the hand in each substep, mm.
const CATCH_UP_MM: f64 = 0.5;
/// Barycentric share of the last node in the position of the tip above which the tip is at that node.
const AT_NODE: f64 = 0.999;

/// State of the tip.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tip {
    /// Effective base: that of the hand, or behind it while bone stops the tip.
    pub base: Option<Isometry3<f64>>,
    /// Whether the tip has come out of the tissue on another side.
    pub outside: bool,
    /// Element that contains the tip or is nearest to it.
    pub element: Option<u32>,
    /// Region of the tip.
    pub region: Option<i32>,
    /// Position of the last crossing of a boundary, in the reference state, mm.
    pub crossed: Point3<f64>,
    /// Whether the tip is in tissue that is cut already.
    pub in_channel: bool,
    /// Newly cut length behind the tip, mm.
    pub cut_mm: f64,
    /// Position in the reference state before a change of the mesh that left the tip behind: up to there it cuts again,
    /// without events.
    pub front: Option<Point3<f64>>,
    /// Position in the reference state, mm.
    pub reference: Point3<f64>,
    /// A new place that is not yet in the system.
    pub found: Option<Place>,
    /// Row of the tissue at the tip in the system; `None` where nothing is cut, or where the last node on the needle is at
    /// the tip.
    pub row: Option<TipRow>,
    /// Whether the last node on the needle is at the tip, so that the cutting force acts on it.
    pub at_node: bool,
    /// Nodes in the system that are neither on the needle nor on the probe: corners of the element at the tip.
    pub corners: Vec<u32>,
    /// Puncture force of an unbroken surface in front of the tip, N.
    pub surface: Option<f64>,
    /// Position at which no corner fitted, mm: none is tried again there.
    pub refused: Option<Point3<f64>>,
    /// Whether the tip entered where no node could be made on or near the surface: the tissue is fixed there, and the depth
    /// counts from the entry.
    pub bare: bool,
    bone: Option<Met>,
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
    fn asked(&self, line: &CentreLine) -> f64 {
        let tangent = line.at(line.length_mm()).tangent;
        tangent.dot(&(line.tip() - self.at)) + self.behind
    }
}

impl Tip {
    pub fn in_bone(&self) -> bool {
        self.bone.is_some_and(|met| met.bone.holds())
    }

    /// Returns whether bone pins the tip, as with a flexible needle.
    pub fn is_pinned(&self) -> bool {
        self.row.as_ref().is_some_and(|row| row.compliance_mm_per_n > 0.0)
    }

    /// Removes the tissue at the tip.
    pub fn forget_row(&mut self) {
        if !self.is_pinned() {
            self.row = None;
        }
        self.at_node = false;
    }

    /// Returns the effective base for this base of the hand.
    pub fn held(&self, base: &Isometry3<f64>) -> Isometry3<f64> {
        let behind = self.bone.map_or(0.0, |bone| bone.behind);
        let mut held = *base;
        held.translation.vector -= base.rotation * Vector3::z() * behind;
        held
    }

    /// Returns the force of bone on the tip of a rigid needle, N: it grows with the demanded depth in the bone.
    pub fn bone_force(&self, line: &CentreLine) -> Vector3<f64> {
        let Some(met) = self.bone.filter(|_| !self.is_pinned()) else {
            return Vector3::zeros();
        };
        let tangent = line.at(line.length_mm()).tangent;
        tangent.into_inner() * -met.bone.force_n(met.asked(line))
    }
}

impl Finite {
    /// Enters the tissue at a new place of the tip into the system.
    pub(super) fn take_tip(&mut self) {
        if let Some(place) = self.tip.found.take() {
            let last = self.contacts.last();
            let node = last.map_or(NONE, |last| last.node);
            let before = self
                .tip
                .row
                .take()
                .map(|row| row.slider.state)
                .filter(|_| !self.tip.at_node);
            let state = before.or(last.map(|last| last.slider.state));
            let state = state.filter(|_| self.tip.surface.is_none()).unwrap_or(State::Stuck);
            let corners = self.mesh.elements()[place.element as usize];
            let share = corners
                .iter()
                .position(|corner| *corner == node)
                .map_or(0.0, |at| place.bary[at]);
            self.tip.at_node = share > AT_NODE;
            // The cutting force moves from the tissue beside the node to the node.
            if let (true, Some(before), Some(last)) = (self.tip.at_node, before, self.contacts.last_mut()) {
                last.slider.state = before;
            }
            let yields = |node: &u32| !self.adaptation.mesh().dofs().of(*node).contains(&NONE);
            if self.cutting() > 0.0 && !self.tip.at_node && corners.iter().any(yields) {
                self.take_corners(&place);
                self.tip.row = Some(self.row_at(&place, Slider::new(state)));
            }
        }
    }

    /// Sets the bounds of all sliders.
    pub(super) fn bound(&mut self) {
        // Shaft that has come out on another side has no friction.
        let end = self.end_in_tissue();
        let cut_mm = if self.tip.outside { 0.0 } else { self.tip.cut_mm };
        bound(self.anatomy.as_ref(), &mut self.contacts, end, cut_mm);
        let cutting = self.cutting();
        match (&mut self.tip.row, self.contacts.last_mut()) {
            (Some(row), _) => {
                let most = if row.compliance_mm_per_n > 0.0 {
                    f64::INFINITY
                } else {
                    cutting
                };
                (row.slider.sliding, row.slider.holding) = ([most, 0.0], [most, 0.0]);
            }
            (None, Some(last)) if self.tip.at_node => {
                last.slider.sliding[0] += cutting;
                last.slider.holding[0] += cutting;
            }
            _ => {}
        }
    }

    /// Returns the arc length at which the needle in the tissue ends, mm: at the tip, unless that has come out on another
    /// side.
    pub(super) fn end_in_tissue(&self) -> f64 {
        let last = self.contacts.last().filter(|_| self.tip.outside);
        last.map_or(self.line.length_mm(), |last| last.arc + last.laid())
    }

    /// Returns the cutting force at the tip, N; at a surface its puncture force, until the tip has slipped into it.
    pub(super) fn cutting(&self) -> f64 {
        let of = interaction(self.anatomy.as_ref(), self.tip.region);
        let cutting = if self.tip.in_channel { 0.0 } else { of.cutting_n };
        self.tip.surface.unwrap_or(cutting)
    }

    /// Returns the slider of the cutting force.
    fn tip_slider(&mut self) -> Option<&mut Slider> {
        let at_node = self.tip.at_node;
        let last = self
            .contacts
            .last_mut()
            .filter(|_| at_node)
            .map(|last| &mut last.slider);
        self.tip.row.as_mut().map(|row| &mut row.slider).or(last)
    }

    /// Ensures that the corners which share the force at a place are in the system.
    fn take_corners(&mut self, place: &Place) {
        let corners = self.mesh.elements()[place.element as usize];
        let yields = |node: &u32| !self.adaptation.mesh().dofs().of(*node).contains(&NONE);
        if !corners
            .iter()
            .any(|node| self.index_of(*node).is_none() && yields(node))
        {
            return;
        }
        self.tip.corners.clear();
        for node in corners {
            let is_free = !self.adaptation.mesh().dofs().of(node).contains(&NONE);
            if is_free && self.index_of(node).is_none() {
                self.tip.corners.push(node);
            }
        }
        self.name_contacts();
    }

    /// Returns the row of a place whose corners are in the system, except fixed ones.
    fn row_at(&self, place: &Place, slider: Slider) -> TipRow {
        let corners = self.mesh.elements()[place.element as usize];
        let share = |at: usize| {
            self.index_of(corners[at])
                .map_or((0, 0.0), |index| (index, place.bary[at]))
        };
        TipRow {
            shares: std::array::from_fn(share),
            compliance_mm_per_n: 0.0,
            reference: self.adaptation.mesh().point(place.element, place.bary).into(),
            slider,
        }
    }

    /// Returns the index of a node in the compliance: probe, needle, corners at the tip.
    fn index_of(&self, node: u32) -> Option<usize> {
        let probe = self.press.iter().flat_map(|press| press.nodes().iter().copied());
        let needle = self.contacts.iter().map(|contact| contact.node);
        probe
            .chain(needle)
            .chain(self.tip.corners.iter().copied())
            .position(|other| other == node)
    }

    /// Records that a surface is broken, once the tip slips into it.
    pub(super) fn break_surface(&mut self) {
        let cuts = self
            .tip_slider()
            .is_some_and(|slider| slider.state == State::Slipping(1.0));
        if cuts && self.tip.surface.take().is_some() {
            self.note(EventKind::Puncture, self.line.tip(), self.tip.region);
        }
    }

    /// Handles a surface in front of the tip that withstands more than the tissue behind it: it sticks until it breaks.
    pub(super) fn meet_surface(&mut self, region: i32) {
        let ahead = self.of(region);
        if ahead.critical {
            self.note(EventKind::Critical, self.line.tip(), Some(region));
        }
        let breaks =
            ahead.puncture_n > ahead.cutting_n && !self.channel.holds(&self.tip.reference, self.needle.radius_mm());
        self.tip.surface = breaks.then_some(ahead.puncture_n);
        if self.tip.surface.is_some()
            && let Some(slider) = self.tip_slider()
        {
            slider.state = State::Stuck;
        }
    }

    /// Records bone met `at` a point, unless some is already.
    pub(super) fn meet_bone(&mut self, bone: &Bone, at: &Point3<f64>, region: i32) {
        if !self.tip.in_bone() {
            self.tip.bone = Some(Met {
                at: *at,
                bone: *bone,
                behind: self.tip.bone.map_or(0.0, |left| left.behind),
            });
            self.note(EventKind::Bone, *at, Some(region));
        }
        // The shape of a flexible needle is solved with bone as one of its contacts.
        if self.needle.is_flexible() {
            self.tip.row = Some(TipRow {
                shares: [(0, 0.0); 4],
                compliance_mm_per_n: 1.0 / bone.stiffness_n_per_mm,
                reference: *at,
                slider: Slider::new(State::Stuck),
            });
        }
    }

    /// Limits the depth of the tip in bone, and drops bone that it has left. Returns whether the base has moved.
    pub(super) fn hold_at_bone(&mut self) -> bool {
        let tangent = self.line.at(self.line.length_mm()).tangent;
        let (is_pinned, reference) = (self.tip.is_pinned(), self.tip.reference);
        let Some(met) = &mut self.tip.bone else { return false };
        if !met.bone.holds() {
            met.at += tangent.into_inner() * CATCH_UP_MM;
        } else if !is_pinned && !met.bone.is_ahead(self.anatomy.as_ref(), &reference, &tangent) {
            met.leave(&self.line);
        }
        let asked = met.asked(&self.line);
        let behind = met.bone.behind_mm(asked);
        let moved = behind != met.behind;
        met.behind = behind;
        if asked < 0.0 {
            self.tip.bone = None;
            self.tip.row = self.tip.row.take().filter(|row| row.compliance_mm_per_n == 0.0);
        }
        moved
    }

    /// Returns the position of the tissue at the tip at rest, mm, or `None` outside.
    pub(super) fn tip_at_rest(&self) -> Option<Point3<f64>> {
        let inside = self.entry.is_some() && !self.tip.outside && self.tip.element.is_some();
        inside.then_some(self.tip.reference)
    }

    /// Leaves a seed at the tip, if it is in tissue.
    pub(super) fn deposit(&mut self) {
        let Some(place) = self.tip_at_rest() else { return };
        self.seeds.push(place);
        self.note(EventKind::Seed, self.line.tip(), self.tip.region);
    }
}
