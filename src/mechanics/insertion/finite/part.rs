//! A step, cut into parts: instruments go on a little, contacts settle, the tip finds its way.

use faer::Mat;
use nalgebra::{Isometry3, Vector3};

use super::contact::State;
use super::{EventKind, Finite};
use crate::mechanics::needle::{Load, Row};

/// After so many iterations the forces change by ever less of what is asked: a needle that buckles does not swing for ever.
const UNDAMPED: usize = 8;

impl Finite {
    /// Goes to where the instruments are now, in parts short enough that no element is passed unseen.
    pub(super) fn travel(&mut self, base: &Isometry3<f64>, probe: Option<&Isometry3<f64>>) {
        let from = self.base.unwrap_or(*base);
        let probe_from = self.press.as_ref().and_then(|press| press.pose);
        let reach = self.needle.length_mm();
        let mut way = farthest(&from, base, reach);
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
            if matches!(contact.state, State::Slipping(direction) if direction * advance > 0.0) {
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

    /// Finds forces, states and shape that belong together.
    fn settle(&mut self, base: &Isometry3<f64>) {
        let base = self.tip.held(base);
        self.tip.base = Some(base);
        self.take_compliance();
        self.forces.resize(self.contacts.len(), Vector3::zeros());
        self.place(&base);
        let taken = self.push_of_last();
        let mut change = f64::INFINITY;
        for iteration in 0..self.options.most_iterations {
            self.outcome.iterations += 1;
            let length = self.line.length_mm();
            self.interactions
                .set_limits(&mut self.contacts, length, self.tip.region(), taken);
            self.joint.turn(&self.contacts, &self.line, &self.forces);
            let yields = self.write_flexibility();
            let solved = self.joint.solve(
                &mut self.contacts,
                &self.memory.starts,
                &self.line,
                yields.then_some(&self.flexibility),
            );
            let share = if iteration < UNDAMPED {
                1.0
            } else {
                UNDAMPED as f64 / (iteration + 1) as f64
            };
            for (at, force) in self.forces.iter_mut().enumerate() {
                *force += (self.joint.force(at) - *force) * share;
            }
            change = if solved.settled { self.slide() } else { f64::INFINITY };
            self.memory.before.clone_from(&self.line);
            self.place(&base);
            change = change.max(self.line.distance(&self.memory.before));
            if change <= self.options.tolerance_mm {
                break;
            }
        }
        self.outcome.converged &= change <= self.options.tolerance_mm;
        self.carry();
    }

    /// What the last node pushes tissue ahead with, N.
    fn push_of_last(&self) -> f64 {
        let pairs = self.contacts.last().zip(self.forces.last());
        pairs.map_or(0.0, |(contact, force)| self.line.at(contact.arc).tangent.dot(force))
    }

    /// Brings the places along the shaft up to date with the last solution. The largest change, mm.
    fn slide(&mut self) -> f64 {
        let mut largest = 0.0f64;
        for (at, contact) in self.contacts.iter_mut().enumerate() {
            let arc = match contact.state {
                State::Stuck => self.memory.starts[at],
                State::Slipping(_) => self.line.nearest(&(contact.reference + self.joint.displacement(at))),
            };
            largest = largest.max((arc - contact.arc).abs());
            contact.arc = arc;
        }
        largest
    }

    /// Bends the needle under the forces at hand.
    fn place(&mut self, base: &Isometry3<f64>) {
        let loads = &mut self.memory.loads;
        loads.clear();
        for (contact, force) in self.contacts.iter().zip(&self.forces) {
            loads.push(Load {
                arc_mm: contact.arc,
                force_n: -force,
            });
        }
        if self.tip.in_bone() {
            loads.push(Load {
                arc_mm: self.needle.length_mm(),
                force_n: self.tip.bone_force(&self.line),
            });
        }
        self.needle.place(base, self.entry.as_ref(), loads, &mut self.line);
    }

    /// Writes the flexibility across the shaft at the contacts. Whether there is any.
    fn write_flexibility(&mut self) -> bool {
        if !self.needle.is_flexible() || self.contacts.is_empty() {
            return false;
        }
        let rows = &mut self.memory.rows;
        rows.clear();
        for (contact, frame) in self.contacts.iter().zip(self.joint.frames()) {
            for axis in [1, 2] {
                rows.push(Row {
                    arc_mm: contact.arc,
                    direction: frame.column(axis).into_owned(),
                });
            }
        }
        let flexibility = &mut self.flexibility;
        if flexibility.nrows() == rows.len() {
            flexibility.fill(0.0);
        } else {
            *flexibility = Mat::zeros(rows.len(), rows.len());
        }
        self.needle.flexibility(&self.line, rows, flexibility);
        true
    }

    /// Takes in the compliance at the contacts, if it has changed.
    pub(super) fn take_compliance(&mut self) {
        if self.condensed == Some(self.version) {
            return;
        }
        let (probes, rows) = self
            .press
            .as_ref()
            .map_or((0, &[][..]), |press| (press.nodes().len(), press.rows()));
        let condensed = self.adaptation.remesher().condensed();
        self.joint.condense(condensed, probes, rows);
        self.condensed = Some(self.version);
        self.joint
            .press(self.press.iter().flat_map(|press| press.displacements()));
    }

    /// Where static friction is more than sliding friction, a node that has slipped holds again once it rests.
    fn stick_again(&mut self) {
        for contact in &mut self.contacts {
            if contact.holding[1] > contact.sliding[1] {
                contact.state = State::Stuck;
            }
        }
    }

    /// Moves the probe.
    fn press(&mut self, probe: Option<&Isometry3<f64>>) {
        let Some(press) = &mut self.press else { return };
        if press.move_to(probe, &self.joint, &self.forces, &self.adaptation) {
            // The rows are taken in, with what they prescribe, when the compliance is.
            self.version += 1;
        } else {
            self.joint.press(press.displacements());
        }
    }

    /// Tells that a surface is broken.
    pub(super) fn break_surfaces(&mut self) {
        for at in 0..self.contacts.len() {
            let contact = &mut self.contacts[at];
            if contact.surface.is_some() && contact.state == State::Slipping(1.0) {
                contact.surface = None;
                let region = contact.region;
                let place = contact.reference + self.joint.displacement(at);
                self.note(EventKind::Puncture, place, Some(region));
            }
        }
    }
}

/// The farthest that a point of an instrument of this length (mm) along z moves, mm, at most.
fn farthest(from: &Isometry3<f64>, to: &Isometry3<f64>, length: f64) -> f64 {
    let shift = (to.translation.vector - from.translation.vector).norm();
    shift + length * from.rotation.angle_to(&to.rotation)
}
