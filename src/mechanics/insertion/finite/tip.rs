//! The tip: where it is, what it cuts, and the bone that stops it.

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

/// A needle that was moved off bone catches up with the hand by as much in each part of a step, mm.
const CATCH_UP_MM: f64 = 0.5;
/// With a larger share of the place of the tip than this, the last node on the needle is where the tip is.
const AT_NODE: f64 = 0.999;

/// Where the tip is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Tip {
    /// The effective base: where the hand has it, or behind, with the tip at bone.
    pub base: Option<Isometry3<f64>>,
    /// True once it has come out of the tissue on another side.
    pub outside: bool,
    /// The element it is in, or beside.
    pub element: Option<u32>,
    /// The region it is in.
    pub region: Option<i32>,
    /// Place of the last crossing of a border, in the reference state, mm.
    pub crossed: Point3<f64>,
    /// True in tissue that is cut already.
    pub in_channel: bool,
    /// Length newly cut behind it, mm.
    pub cut_mm: f64,
    /// Where it was in the reference state before a change of the mesh that left it behind: up to there it cuts again, without events.
    pub front: Option<Point3<f64>>,
    /// In the reference state, mm.
    pub reference: Point3<f64>,
    /// A place found, not yet in the system.
    pub found: Option<Place>,
    /// The tissue at the tip, as a row of the system; none where nothing is cut, or the last node on the needle is there.
    pub row: Option<TipRow>,
    /// True if the last node on the needle is at the tip: the cutting force acts on it then.
    pub at_node: bool,
    /// Nodes in the system that are neither on the needle nor on the probe: corners of the element at the tip.
    pub corners: Vec<u32>,
    /// The force that a surface before the tip withstands, N, while it is not broken.
    pub surface: Option<f64>,
    /// Where no corner fitted, mm: it is not tried again there.
    pub refused: Option<Point3<f64>>,
    /// Whether it went in where no node could be made on the surface, nor near it: tissue is held there, and its depth counts from the
    /// entry.
    pub bare: bool,
    bone: Option<Met>,
}

/// Bone that the tip has met.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Met {
    at: Point3<f64>,
    bone: Bone,
    /// How far the needle stays behind the hand, mm.
    behind: f64,
}

impl Met {
    /// Bone that was under the tip is there no more: the tip goes on from where it is.
    fn leave(&mut self, line: &CentreLine) {
        (self.bone, self.at) = (Bone::LEFT, line.tip());
    }

    /// How deep the hand would have the tip of a needle that lies so, mm.
    fn asked(&self, line: &CentreLine) -> f64 {
        let tangent = line.at(line.length_mm()).tangent;
        tangent.dot(&(line.tip() - self.at)) + self.behind
    }
}

impl Tip {
    pub fn in_bone(&self) -> bool {
        self.bone.is_some_and(|met| met.bone.holds())
    }

    /// True where bone pins the tip, as of a needle that bends.
    pub fn is_pinned(&self) -> bool {
        self.row.as_ref().is_some_and(|row| row.compliance_mm_per_n > 0.0)
    }

    /// Takes away the tissue at the tip.
    pub fn forget_row(&mut self) {
        if !self.is_pinned() {
            self.row = None;
        }
        self.at_node = false;
    }

    /// The base that a hand which has it here can bring about.
    pub fn held(&self, base: &Isometry3<f64>) -> Isometry3<f64> {
        let behind = self.bone.map_or(0.0, |bone| bone.behind);
        let mut held = *base;
        held.translation.vector -= base.rotation * Vector3::z() * behind;
        held
    }

    /// Force of bone on the tip of a needle that does not bend, N: it grows with how far the hand would have the tip in it.
    pub fn bone_force(&self, line: &CentreLine) -> Vector3<f64> {
        let Some(met) = self.bone.filter(|_| !self.is_pinned()) else {
            return Vector3::zeros();
        };
        let tangent = line.at(line.length_mm()).tangent;
        tangent.into_inner() * -met.bone.force_n(met.asked(line))
    }
}

impl Finite {
    /// Puts the tissue where the tip has been found into the system.
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
            // What the tip cut beside the node it cuts at the node.
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
        // Shaft that has come out on another side does not rub.
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

    /// Arc length at which the needle in the tissue ends, mm: at the tip, unless that has come out on another side.
    pub(super) fn end_in_tissue(&self) -> f64 {
        let last = self.contacts.last().filter(|_| self.tip.outside);
        last.map_or(self.line.length_mm(), |last| last.arc + last.laid())
    }

    /// Cutting force at the tip, N; at a surface its puncture force, until the tip has slipped into it.
    pub(super) fn cutting(&self) -> f64 {
        let of = interaction(self.anatomy.as_ref(), self.tip.region);
        let cutting = if self.tip.in_channel { 0.0 } else { of.cutting_n };
        self.tip.surface.unwrap_or(cutting)
    }

    /// The slider of the cutting force.
    fn tip_slider(&mut self) -> Option<&mut Slider> {
        let at_node = self.tip.at_node;
        let last = self
            .contacts
            .last_mut()
            .filter(|_| at_node)
            .map(|last| &mut last.slider);
        self.tip.row.as_mut().map(|row| &mut row.slider).or(last)
    }

    /// Makes sure that the corners which share the force at a place are in the system.
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

    /// The row of a place whose corners are in the system, those that do not move aside.
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

    /// The place of a node among those of the compliance: probe, needle, corners at the tip.
    fn index_of(&self, node: u32) -> Option<usize> {
        let probe = self.press.iter().flat_map(|press| press.nodes().iter().copied());
        let needle = self.contacts.iter().map(|contact| contact.node);
        probe
            .chain(needle)
            .chain(self.tip.corners.iter().copied())
            .position(|other| other == node)
    }

    /// Tells that a surface is broken.
    pub(super) fn break_surface(&mut self) {
        let cuts = self
            .tip_slider()
            .is_some_and(|slider| slider.state == State::Slipping(1.0));
        if cuts && self.tip.surface.take().is_some() {
            self.note(EventKind::Puncture, self.line.tip(), self.tip.region);
        }
    }

    /// A surface before the tip withstands more than the tissue behind it: it holds until it breaks.
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

    /// Notes bone that is met `at` a point, if none is yet.
    pub(super) fn meet_bone(&mut self, bone: &Bone, at: &Point3<f64>, region: i32) {
        if !self.tip.in_bone() {
            self.tip.bone = Some(Met {
                at: *at,
                bone: *bone,
                behind: self.tip.bone.map_or(0.0, |left| left.behind),
            });
            self.note(EventKind::Bone, *at, Some(region));
        }
        // A needle that bends finds its shape with bone as one of its contacts.
        if self.needle.is_flexible() {
            self.tip.row = Some(TipRow {
                shares: [(0, 0.0); 4],
                compliance_mm_per_n: 1.0 / bone.stiffness_n_per_mm,
                reference: *at,
                slider: Slider::new(State::Stuck),
            });
        }
    }

    /// Keeps the tip from going deeper into bone than it may, and forgets bone that it has left. True if the base has moved.
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

    /// Where the tissue at the tip is at rest, mm; none outside.
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
