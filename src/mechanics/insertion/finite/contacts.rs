//! All contacts of the needle, and the points where forces act on it.

use nalgebra::{Point3, Vector3};

use super::body::CutTissue;
use super::contact::{Contact, SAMPLE_MM, Slider, State};
use super::joint::{Joint, MAX_RELEASED};
use crate::insertion::ShaftLoad;
use crate::needle::CentreLine;

/// Motion of the instruments in which a node that lies beside the line comes nearer by a factor of e, mm.
const APPROACH_MM: f64 = 5.0;
/// Distance from the tip from which on a node is held across the shaft without yielding, mm, and way that the needle is
/// withdrawn until others yield.
pub(super) const HELD_MM: f64 = 1.0;
/// Least such distance that counts, mm.
const LEAST_HELD_MM: f64 = 1e-3;
/// Force below which a released load is dropped, N.
const FADED_N: f64 = 1e-12;

/// Nodes on the needle and the forces along it. Buffers are kept from step to step, to avoid allocation.
#[derive(Debug, Default)]
pub(super) struct Contacts {
    /// Nodes on the needle, base first.
    pub nodes: Vec<Contact>,
    /// Forces on the tissue at the nodes, at the tip, on the guide, and of released loads, N.
    pub forces: Vec<Vector3<f64>>,
    /// Whether `forces` has entries for tip and guide.
    pub has_others: [bool; 2],
    /// Arcs of released nodes that still load the needle, mm; their forces are last in `forces`.
    pub released: Vec<f64>,
    /// Arcs of the nodes at the beginning of the substep, mm.
    pub starts: Vec<f64>,
    /// Arcs where `forces` act, mm.
    pub arcs: Vec<f64>,
    /// Forces at the beginning of the iteration, N.
    before: Vec<Vector3<f64>>,
}

impl Contacts {
    /// Records the arcs at the beginning of a substep.
    pub(super) fn start(&mut self) {
        self.starts.clear();
        self.starts.extend(self.nodes.iter().map(|contact| contact.arc));
    }

    /// Lets nodes approach the line after a motion (mm) of the instruments.
    pub(super) fn approach(&mut self, motion_mm: f64) {
        let share = (-motion_mm / APPROACH_MM).exp();
        self.nodes.iter_mut().for_each(|contact| contact.aside *= share);
    }

    /// Softens the nodes near the tip (at arc `tip`, mm) of a needle that was withdrawn by `withdrawn_mm` since it last
    /// advanced, by the compliance of the tissue there (mm/N), so that none is released with a force.
    pub(super) fn soften(&mut self, tip: f64, withdrawn_mm: f64, compliance_mm_per_n: f64) {
        let compliance = compliance_mm_per_n * (withdrawn_mm / HELD_MM).powi(2);
        for contact in &mut self.nodes {
            let distance_mm = (tip - contact.arc).clamp(LEAST_HELD_MM, HELD_MM);
            contact.softness_mm_per_n = compliance * (HELD_MM / distance_mm - 1.0).powi(2);
        }
    }

    /// Extrapolates the sliding of nodes that slip: a warm start that saves iterations.
    pub(crate) fn extrapolate(&mut self, advance: f64) {
        for contact in &mut self.nodes {
            if matches!(contact.slider.state, State::Slipping(direction) if direction * advance > 0.0) {
                contact.arc += contact.drift * advance;
            }
        }
    }

    /// Records the sliding of the nodes in this substep.
    pub(crate) fn note_drift(&mut self, advance: f64) {
        for (contact, start) in self.nodes.iter_mut().zip(&self.starts) {
            let drift = (contact.arc - start) / advance;
            contact.drift = if drift.is_finite() {
                drift.clamp(-2.0, 0.0)
            } else {
                -1.0
            };
        }
    }

    /// Lets nodes that have slipped stick again at rest, where static friction exceeds sliding friction.
    pub(crate) fn stick_again(&mut self) {
        for contact in &mut self.nodes {
            let slider = &mut contact.slider;
            if slider.static_limits[1] < slider.sliding[1] {
                slider.state = State::Stuck;
            }
        }
    }

    /// Writes the arcs at which forces act.
    pub(crate) fn write_arcs(&mut self, line: &CentreLine, has_tip: bool, guide: Option<Point3<f64>>) {
        let guide = guide.map(|guide| line.nearest(&guide));
        self.arcs.clear();
        self.arcs.extend(self.nodes.iter().map(|contact| contact.arc));
        self.arcs.extend(has_tip.then(|| line.length_mm()));
        self.arcs.extend(guide);
        self.arcs.extend_from_slice(&self.released);
    }

    /// Makes room for the forces at the tip and on the guide behind those at the nodes; existing ones are kept. The
    /// cutting force (N) passes between the tip and the node that was made there.
    pub(crate) fn set_others(&mut self, [has_tip, has_guide]: [bool; 2], line: &CentreLine, cutting: impl Fn() -> f64) {
        let [had_tip, had_guide] = self.has_others;
        let index = self.nodes.len();
        if has_tip && !had_tip {
            // Until now the last node carried the cutting force, too: that part moves to the tip, at most all of what
            // pushes ahead.
            let cutting = cutting();
            let mut share = Vector3::zeros();
            if let Some(last) = self.forces[..index].last_mut() {
                let tangent = line.point_at_arc(line.length_mm()).tangent;
                share = tangent.into_inner() * tangent.dot(last).clamp(0.0, cutting);
                *last -= share;
            }
            self.forces.insert(index, share);
        } else if had_tip && !has_tip {
            let force = self.forces.remove(index);
            if let Some(last) = self.forces[..index].last_mut() {
                *last += force;
            }
        }
        let index = index + usize::from(has_tip);
        if has_guide && !had_guide {
            self.forces.insert(index, Vector3::zeros());
        } else if had_guide && !has_guide {
            self.forces.remove(index);
        }
        self.has_others = [has_tip, has_guide];
    }

    /// Adds a node at the tip.
    pub(super) fn add(&mut self, node: u32, reference: Point3<f64>, arc: f64, state: State, region: Option<i32>) {
        self.forces.insert(self.nodes.len(), Vector3::zeros());
        self.nodes.push(Contact {
            node,
            reference,
            aside: Vector3::zeros(),
            softness_mm_per_n: 0.0,
            arc,
            slider: Slider::new(state),
            region,
            drift: -1.0,
            layers: Vec::new(),
        });
        self.starts.push(arc);
    }

    /// Removes the last node if it lies beyond an arc (mm), and returns it. A flexible needle still lies under its
    /// force, which fades as a solution without it is found.
    pub(crate) fn release_beyond(&mut self, arc: f64, is_flexible: bool) -> Option<u32> {
        let contact = self.nodes.pop_if(|contact| contact.arc > arc)?;
        let force = self.forces.remove(self.nodes.len());
        if let Some(last) = self.forces[..self.nodes.len()].last_mut() {
            *last += force;
        } else if is_flexible {
            self.fade(contact.arc, force);
        }
        self.starts.pop();
        Some(contact.node)
    }

    fn fade(&mut self, arc: f64, force: Vector3<f64>) {
        if let (MAX_RELEASED, Some(last)) = (self.released.len(), self.forces.last_mut()) {
            *last += force;
        } else {
            self.released.push(arc);
            self.forces.push(force);
        }
    }

    /// Drops the loads of released nodes, once the needle lies without them.
    pub(crate) fn drop_faded_releases(&mut self) {
        let first_released = self.forces.len() - self.released.len();
        if self.forces[first_released..].iter().all(|force| force.norm() < FADED_N) {
            self.forces.truncate(first_released);
            self.arcs.truncate(first_released);
            self.released.clear();
        }
    }

    /// Writes the forces of the tissue on the needle, N: each on the shaft from its node to the next, the last to the
    /// arc `end` (mm), and that at the tip of `line`.
    pub(super) fn shaft_loads(&self, line: &CentreLine, end: f64, into: &mut Vec<ShaftLoad>) {
        for (index, contact) in self.nodes.iter().enumerate() {
            // A node may lie beyond the tip until the tissue has caught up.
            let from_mm = contact.arc.min(end);
            let next = self.nodes.get(index + 1).map_or(end, |next| next.arc.min(end));
            into.push(ShaftLoad {
                from_mm,
                to_mm: next.max(from_mm),
                force_n: -self.forces[index],
            });
        }
        let length = line.length_mm();
        let mut at_tip = Vector3::zeros();
        if self.has_others[0] {
            at_tip = -self.forces[self.nodes.len()];
        }
        into.push(ShaftLoad {
            from_mm: length,
            to_mm: length,
            force_n: at_tip,
        });
    }

    /// Records the forces at the beginning of an iteration.
    pub(crate) fn keep_forces(&mut self) {
        self.before.clone_from(&self.forces);
    }

    /// Moves the forces from those at the beginning of the iteration by a share of the step to the solution.
    pub(crate) fn step_forces(&mut self, joint: &Joint, share: f64) {
        for (index, (force, before)) in self.forces.iter_mut().zip(&self.before).enumerate() {
            *force = before + (joint.force(index) - before) * share;
        }
    }

    /// Moves the arcs of slipping nodes by a share of the step to the solution. Returns the largest change, mm.
    pub(super) fn slide(&mut self, joint: &Joint, line: &CentreLine, share: f64) -> f64 {
        let mut largest = 0.0f64;
        for (index, contact) in self.nodes.iter_mut().enumerate() {
            let mut arc = self.starts[index];
            if !contact.slider.is_stuck() {
                let nearest_arc = line.nearest(&(contact.reference + contact.aside + joint.displacement(index)));
                arc = contact.arc + (nearest_arc - contact.arc) * share;
            }
            largest = largest.max((arc - contact.arc).abs());
            contact.arc = arc;
        }
        largest
    }

    /// Extends the path from the last node to the tip, which has moved in the reference state from `before` to `now`,
    /// or shortens it.
    pub(crate) fn extend_path(&mut self, body: &CutTissue, length: f64, before: &Point3<f64>, now: &Point3<f64>) {
        let Some(last) = self.nodes.last_mut() else { return };
        let beyond = length - last.arc;
        let path = last.path_mm();
        if beyond <= path {
            last.shorten(beyond);
            return;
        }
        let pieces = ((beyond - path) / SAMPLE_MM).ceil().max(1.0);
        for piece in 0..pieces as usize {
            let middle = before + (now - before) * ((piece as f64 + 0.5) / pieces);
            let region = body.anatomy.region(&middle);
            // The shaft does not enter bone.
            let is_bone = body.interaction(region).bone.is_some();
            let behind = last.layers.last().map_or(last.region, |layer| layer.region);
            last.lengthen(if is_bone { behind } else { region }, (beyond - path) / pieces);
        }
    }
}
