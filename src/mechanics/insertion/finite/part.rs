//! A step, cut into parts: instruments go on a little, contacts settle, the tip finds its way.

use faer::Mat;
use nalgebra::{Isometry3, Point3, Vector3};

use super::joint::Yielding;
use super::slider::State;
use super::{Finite, Memory};
use crate::mechanics::needle::{Load, Row};

/// After so many iterations the forces change by ever less of what is asked: a needle that buckles does not swing for ever.
const UNDAMPED: usize = 8;
/// The farthest that an iteration may bend the needle, mm: beyond, its flexibility is another.
const FARTHEST_MM: f64 = 5.0;
/// Solutions in a row whose states do not settle, after which a part of a step is given up.
const MOST_UNSETTLED: usize = 3;
/// The least share of the way to a solution that an iteration goes.
const LEAST_SHARE: f64 = 1e-3;
/// What still moves by more when its iterations end is given up, mm.
const LOST_MM: f64 = 0.1;
/// Halves of a way that does not settle are halved again while they are longer, mm,
const LEAST_PART_MM: f64 = 0.01;
/// and while all attempts together have taken no more than so many times the iterations of one.
const MOST_ATTEMPTS: usize = 6;
/// A load that fades is gone below this, N.
const FADED_N: f64 = 1e-12;

/// What iterations have ended at.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Found {
    /// An equilibrium that holds.
    Rest,
    /// Almost one, or one that a touch would end: the needle buckles.
    Near,
    Nothing,
}

impl Finite {
    /// Goes to where the instruments are now, in parts short enough that no element is passed unseen.
    pub(super) fn travel(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>) {
        let from = self.base.unwrap_or(*base);
        let probe_from = self.press.as_ref().and_then(|press| press.pose);
        let mut way = farthest(&from, base, self.needle.length_mm());
        if let (Some(from), Some(to), Some(press)) = (&probe_from, probe, &self.press) {
            way = way.max(farthest(from, to, press.length_mm()));
        }
        let parts = (way / self.options.part_mm)
            .ceil()
            .clamp(1.0, self.options.most_parts as f64);
        for part in 1..=parts as usize {
            let share = part as f64 / parts;
            // The end is where the hand is, to the bit.
            let between = |from: &Isometry3<f64>, to: &Isometry3<f64>| {
                if share < 1.0 { from.lerp_slerp(to, share) } else { *to }
            };
            let probe = probe.map(|to| between(probe_from.as_ref().unwrap_or(to), to));
            self.part(&between(&from, base), probe.as_ref());
            self.outcome.substeps += 1;
        }
        self.base = Some(*base);
    }

    fn part(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>) {
        self.memory.starts.clear();
        self.memory
            .starts
            .extend(self.contacts.iter().map(|contact| contact.arc));
        self.press(probe);
        let advance = self.advance_of(base);
        self.foresee(advance);
        self.settle(base);
        self.note_drift(advance);
        if self.hold_at_bone() {
            self.settle(base);
        }
        if self.release() {
            self.settle(base);
        }
        if self.advance() {
            self.settle(base);
        }
        self.stick_again();
    }

    /// How far the base goes on along the shaft, mm.
    fn advance_of(&self, base: &Isometry3<f64>) -> f64 {
        let axis = base.rotation * Vector3::z();
        let before = self.tip.base.as_ref();
        before.map_or(0.0, |before| {
            axis.dot(&(base.translation.vector - before.translation.vector))
        })
    }

    /// Nodes that slip go on as they did: a start that spares iterations.
    fn foresee(&mut self, advance: f64) {
        for contact in &mut self.contacts {
            if matches!(contact.slider.state, State::Slipping(direction) if direction * advance > 0.0) {
                contact.arc += contact.drift * advance;
            }
        }
    }

    /// Notes how nodes have slipped in this part.
    fn note_drift(&mut self, advance: f64) {
        for (contact, start) in self.contacts.iter_mut().zip(&self.memory.starts) {
            let drift = (contact.arc - start) / advance;
            contact.drift = if drift.is_finite() {
                drift.clamp(-2.0, 0.0)
            } else {
                -1.0
            };
        }
    }

    /// Brings the needle to a base and settles it there, in halves if it would jump or swing.
    fn settle(&mut self, base: &Isometry3<f64>) {
        let most = self.outcome.iterations + MOST_ATTEMPTS * self.options.most_iterations;
        let base = self.tip.held(base);
        self.settle_within(&base, most);
    }

    fn settle_within(&mut self, base: &Isometry3<f64>, most: usize) {
        let from = self.tip.base;
        let found = self.attempt(base);
        if found == Found::Rest {
            return;
        }
        let from = from.filter(|from| farthest(from, base, self.needle.length_mm()) > LEAST_PART_MM);
        if let Some(from) = from.filter(|_| self.outcome.iterations < most) {
            self.put_back();
            let middle = from.lerp_slerp(base, 0.5);
            self.settle_within(&middle, most);
            let arcs = self.contacts.iter().map(|contact| contact.arc);
            self.memory.starts.clear();
            self.memory.starts.extend(arcs);
            self.settle_within(base, most);
        } else {
            self.outcome.converged = false;
            if found == Found::Nothing {
                self.put_back();
                self.carry_line(base);
                self.write_arcs();
                self.carry();
            }
        }
    }

    /// Finds forces, states and shape that belong together.
    fn attempt(&mut self, base: &Isometry3<f64>) -> Found {
        self.take_tip();
        self.take_compliance();
        self.keep();
        self.carry_line(base);
        let mut holds = true;
        let mut change = f64::INFINITY;
        let mut unsettled = 0;
        for iteration in 0..self.options.most_iterations {
            self.outcome.iterations += 1;
            self.memory.before.clone_from(&self.line);
            self.write_arcs();
            self.bound();
            self.joint.turn(&self.memory.arcs, &self.line, &self.forces);
            let ways = self.linearise();
            let solved = self.joint.solve(
                &mut self.contacts,
                self.tip.row.as_mut(),
                &self.memory.starts,
                &self.line,
                ways.map(|_| &self.yielding),
            );
            self.memory.forces.clone_from(&self.forces);
            let mut share = if iteration < UNDAMPED {
                1.0
            } else {
                UNDAMPED as f64 / (iteration + 1) as f64
            };
            self.take_forces(share);
            if ways.is_some() {
                loop {
                    self.bend();
                    let shift = self.line.distance(&self.memory.before);
                    if !(shift > FARTHEST_MM && share > LEAST_SHARE) {
                        break;
                    }
                    share = (share * (FARTHEST_MM / shift).min(0.5)).max(LEAST_SHARE);
                    self.take_forces(share);
                    self.line.clone_from(&self.memory.before);
                }
            }
            holds = ways.is_none_or(|ways| solved.signs.dependent > 0 || solved.signs.negative >= ways);
            change = self.slide(share).max(self.line.distance(&self.memory.before));
            unsettled = if solved.settled { 0 } else { unsettled + 1 };
            if unsettled > 0 {
                change = f64::INFINITY;
            }
            if change <= self.options.tolerance_mm || unsettled == MOST_UNSETTLED {
                break;
            }
        }
        self.forget_faded();
        self.carry();
        match change {
            _ if change <= self.options.tolerance_mm && holds => Found::Rest,
            _ if change <= LOST_MM => Found::Near,
            _ => Found::Nothing,
        }
    }

    /// Brings the needle to its base, bent as it is.
    fn carry_line(&mut self, base: &Isometry3<f64>) {
        match self.tip.base.replace(*base) {
            Some(before) if self.needle.is_flexible() => self.line.transform(&(base * before.inverse())),
            _ => self.needle.place(base, self.entry.as_ref(), &[], &[], &mut self.line),
        }
    }

    /// Forgets the loads of nodes that came off, once the needle lies without them.
    fn forget_faded(&mut self) {
        let first = self.forces.len() - self.fading.len();
        if self.forces[first..].iter().all(|force| force.norm() < FADED_N) {
            self.forces.truncate(first);
            self.memory.arcs.truncate(first);
            self.fading.clear();
        }
    }

    /// Keeps forces, places and states as they are before a part of a step.
    fn keep(&mut self) {
        let kept = &mut self.memory.kept;
        kept.base = self.tip.base;
        kept.line.clone_from(&self.line);
        kept.forces.clone_from(&self.forces);
        kept.contacts.clear();
        kept.contacts
            .extend(self.contacts.iter().map(|contact| (contact.arc, contact.slider)));
        kept.tip = self.tip.row.as_ref().map(|row| row.slider);
    }

    /// Goes back to what there was before an attempt.
    fn put_back(&mut self) {
        let kept = &self.memory.kept;
        self.line.clone_from(&kept.line);
        self.forces.clone_from(&kept.forces);
        for (contact, (arc, slider)) in self.contacts.iter_mut().zip(&kept.contacts) {
            (contact.arc, contact.slider) = (*arc, *slider);
        }
        if let (Some(row), Some(slider)) = (&mut self.tip.row, kept.tip) {
            row.slider = slider;
        }
        self.tip.base = kept.base;
    }

    /// Goes a share of the way to the forces of the solution.
    fn take_forces(&mut self, share: f64) {
        for (at, (force, before)) in self.forces.iter_mut().zip(&self.memory.forces).enumerate() {
            *force = before + (self.joint.force(at) - before) * share;
        }
    }

    /// Brings the places along the shaft up to date with the last solution, a share of the way. The largest change, mm.
    fn slide(&mut self, share: f64) -> f64 {
        let mut largest = 0.0f64;
        for (at, contact) in self.contacts.iter_mut().enumerate() {
            let mut arc = self.memory.starts[at];
            if !contact.slider.is_stuck() {
                let found = self.line.nearest(&(contact.reference + self.joint.displacement(at)));
                arc = contact.arc + (found - contact.arc) * share;
            }
            largest = largest.max((arc - contact.arc).abs());
            contact.arc = arc;
        }
        largest
    }

    /// Where along the shaft the forces act: contacts, tip, guide.
    fn write_arcs(&mut self) {
        let guide = self.guide().map(|guide| self.line.nearest(&guide));
        let arcs = &mut self.memory.arcs;
        arcs.clear();
        arcs.extend(self.contacts.iter().map(|contact| contact.arc));
        arcs.extend(self.tip.row.as_ref().map(|_| self.line.length_mm()));
        arcs.extend(guide);
        arcs.extend_from_slice(&self.fading);
    }

    /// The hole that the needle runs through, if it can bend.
    fn guide(&self) -> Option<Point3<f64>> {
        self.guide.filter(|_| self.needle.is_flexible())
    }

    /// What bends the needle: the forces at hand.
    fn write_loads(&mut self) {
        let loads = &mut self.memory.loads;
        loads.clear();
        let pairs = self.memory.arcs.iter().zip(&self.forces);
        loads.extend(pairs.map(|(arc_mm, force)| Load {
            arc_mm: *arc_mm,
            force_n: -force,
        }));
        if self.tip.in_bone() {
            loads.push(Load {
                arc_mm: self.needle.length_mm(),
                force_n: self.tip.bone_force(&self.line),
            });
        }
    }

    /// Goes one step of the needle's own to where the forces at hand have it, from where it was linearised.
    fn bend(&mut self) {
        self.write_loads();
        let Some(base) = &self.tip.base else { return };
        let Memory { loads, about, .. } = &self.memory;
        self.needle
            .place(base, self.entry.as_ref(), about, loads, &mut self.line);
    }

    /// Writes how the needle yields along and across the shaft wherever forces act. In how many ways it would buckle were it not
    /// held; none if it does not bend.
    fn linearise(&mut self) -> Option<usize> {
        if !self.needle.is_flexible() {
            return None;
        }
        self.write_loads();
        let memory = &mut self.memory;
        std::mem::swap(&mut memory.loads, &mut memory.about);
        if memory.arcs.is_empty() {
            return Some(0);
        }
        memory.rows.clear();
        for (arc_mm, frame) in memory.arcs.iter().zip(self.joint.frames()) {
            memory.rows.extend([0, 1, 2].map(|axis| Row {
                arc_mm: *arc_mm,
                direction: frame.column(axis).into_owned(),
            }));
        }
        let Yielding { flexibility, drift } = &mut self.yielding;
        let count = memory.rows.len();
        drift.resize(count, 0.0);
        if flexibility.nrows() == count {
            flexibility.fill(0.0);
        } else {
            *flexibility = Mat::zeros(count, count);
        }
        Some(
            self.needle
                .linearise(&self.line, &memory.about, &memory.rows, drift, flexibility),
        )
    }

    /// Takes in the compliance at the contacts, if it has changed, and the tissue at the tip.
    pub(super) fn take_compliance(&mut self) {
        let (probes, rows) = match &self.press {
            None => (0, &[][..]),
            Some(press) => (press.nodes().len(), press.rows()),
        };
        let condensed = self.adaptation.remesher().condensed();
        if self.condensed != Some(self.version) {
            self.joint.tissue.condense(condensed, probes, self.contacts.len(), rows);
            self.condensed = Some(self.version);
        }
        let guide = self.guide();
        let fading = self.fading.len();
        self.joint.tissue.set_tip(condensed, probes, self.tip.row.as_ref());
        self.joint.set_others(guide, fading);
        self.joint
            .tissue
            .press(self.press.iter().flat_map(|press| press.displacements()));
        self.lay_forces();
    }

    /// Makes room for the forces at the tip and on the guide behind those at the contacts; those that stay are kept.
    fn lay_forces(&mut self) {
        let [had_tip, had_guide] = self.laid;
        let [has_tip, has_guide] = [self.tip.row.is_some(), self.guide().is_some()];
        let at = self.contacts.len();
        // What is cut passes between the tip and the node that was made there.
        if has_tip && !had_tip {
            let cutting = self.interactions.cutting(self.tip.region(), None)[0];
            let mut share = Vector3::zeros();
            if let Some(last) = self.forces[..at].last_mut() {
                let tangent = self.line.at(self.line.length_mm()).tangent;
                share = tangent.into_inner() * tangent.dot(last).clamp(0.0, cutting);
                *last -= share;
            }
            self.forces.insert(at, share);
        } else if had_tip && !has_tip {
            let force = self.forces.remove(at);
            if let Some(last) = self.forces[..at].last_mut() {
                *last += force;
            }
        }
        let at = at + usize::from(has_tip);
        if has_guide && !had_guide {
            self.forces.insert(at, Vector3::zeros());
        } else if had_guide && !has_guide {
            self.forces.remove(at);
        }
        self.laid = [has_tip, has_guide];
    }

    /// Where static friction is more than sliding friction, a node that has slipped holds again once it rests.
    fn stick_again(&mut self) {
        for contact in &mut self.contacts {
            let slider = &mut contact.slider;
            if slider.holding[1] < slider.sliding[1] {
                slider.state = State::Stuck;
            }
        }
    }

    /// Moves the probe.
    fn press(&mut self, probe: Option<&Isometry3<f64>>) {
        let Some(press) = &mut self.press else { return };
        let condensed = self.adaptation.remesher().condensed();
        if press.move_to(probe, condensed, &self.memory.contact_forces) {
            self.version += 1;
        }
    }
}

/// The farthest that a point of an instrument of this length (mm) along z moves, mm, at most.
fn farthest(from: &Isometry3<f64>, to: &Isometry3<f64>, length: f64) -> f64 {
    let shift = (to.translation.vector - from.translation.vector).norm();
    shift + length * from.rotation.angle_to(&to.rotation)
}
