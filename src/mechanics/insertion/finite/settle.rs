//! A part of a step settles: forces, states and shape that belong together.

use nalgebra::Isometry3;

use super::Finite;
use super::part::farthest;

/// After so many iterations the forces change by ever less of what is asked: a needle that buckles does not swing for ever.
const UNDAMPED: usize = 8;
/// The farthest that an iteration may bend the needle, mm: beyond, its flexibility is another.
const FARTHEST_MM: f64 = 5.0;
/// Solutions in a row whose states do not settle, after which a part of a step is given up.
const MOST_UNSETTLED: usize = 3;
/// The least share of the way to a solution that an iteration goes.
const LEAST_SHARE: f64 = 1e-3;
/// Motion in the last iteration above which an attempt is given up, mm.
const LOST_MM: f64 = 0.1;
/// Halves of a way that does not settle are halved again while they are longer, mm,
const LEAST_PART_MM: f64 = 0.01;
/// and while all attempts together have taken no more than so many times the iterations of one.
const MOST_ATTEMPTS: usize = 6;
/// A load that fades is gone below this, N.
const FADED_N: f64 = 1e-12;

/// Outcome of the iterations.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Found {
    /// An equilibrium that holds.
    Rest,
    /// Almost one, or one that a touch would end: the needle buckles.
    Near,
    Nothing,
}

impl Finite {
    /// Brings the needle to a base and settles it there, in halves if it would jump or swing.
    pub(super) fn settle(&mut self, base: &Isometry3<f64>) {
        let most = self.outcome.iterations + MOST_ATTEMPTS * self.options.most_iterations;
        let base = self.tip.held(base);
        self.settle_within(&base, most);
        // Not before: an attempt that is taken back brings its loads back.
        self.forget_faded();
        self.carry();
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
}
