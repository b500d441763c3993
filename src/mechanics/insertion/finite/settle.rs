//! Equilibrium iteration of a substep: consistent forces, contact states and needle shape.

use nalgebra::Isometry3;

use super::Finite;
use super::substep::farthest;

/// Iterations before damping: after them the forces change by an ever smaller share, so that a buckling needle does not
/// oscillate for ever.
const UNDAMPED: usize = 8;
/// Maximum bending of the needle in one iteration, mm: beyond, its flexibility differs.
const FARTHEST_MM: f64 = 5.0;
/// Consecutive solutions with unsettled states after which a substep is given up.
const MOST_UNSETTLED: usize = 3;
/// Least step length towards a solution.
const LEAST_SHARE: f64 = 1e-3;
/// Motion in the last iteration above which an attempt is given up, mm.
const LOST_MM: f64 = 0.1;
/// Length above which a substep that does not settle is bisected, mm.
const LEAST_PART_MM: f64 = 0.01;
/// Iterations of all attempts of a substep, as a multiple of those of one, beyond which there is no further bisection.
const MOST_ATTEMPTS: usize = 6;
/// Force below which a fading load is dropped, N.
const FADED_N: f64 = 1e-12;

/// Outcome of the iterations.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Found {
    /// A stable equilibrium.
    Rest,
    /// Nearly an equilibrium, or an unstable one: the needle buckles.
    Near,
    Nothing,
}

impl Finite {
    /// Moves the needle to a base and settles it there, in halves if it would jump or oscillate.
    pub(super) fn settle(&mut self, base: &Isometry3<f64>) {
        let most = self.outcome.iterations + MOST_ATTEMPTS * self.options.most_iterations;
        let base = self.tip.held(base);
        self.settle_within(&base, most);
        // Only now: a reverted attempt restores its loads.
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

    /// Iterates to consistent forces, states and shape.
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

    /// Moves the needle to its base, in its bent shape.
    fn carry_line(&mut self, base: &Isometry3<f64>) {
        match self.tip.base.replace(*base) {
            Some(before) if self.needle.is_flexible() => self.line.transform(&(base * before.inverse())),
            _ => self.needle.place(base, self.entry.as_ref(), &[], &[], &mut self.line),
        }
    }

    /// Drops the loads of released nodes, once the needle lies without them.
    fn forget_faded(&mut self) {
        let first = self.forces.len() - self.fading.len();
        if self.forces[first..].iter().all(|force| force.norm() < FADED_N) {
            self.forces.truncate(first);
            self.memory.arcs.truncate(first);
            self.fading.clear();
        }
    }

    /// Stores forces, arcs and states before an attempt.
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

    /// Restores forces, arcs and states from before an attempt.
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

    /// Moves the forces by a share of the way to the solution.
    fn take_forces(&mut self, share: f64) {
        for (at, (force, before)) in self.forces.iter_mut().zip(&self.memory.forces).enumerate() {
            *force = before + (self.joint.force(at) - before) * share;
        }
    }

    /// Moves the arcs of slipping contacts by a share of the way to the last solution. Returns the largest change, mm.
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
