//! Equilibrium iteration of a substep: consistent forces, contact states and needle shape.

use nalgebra::{Isometry3, Vector3};

use super::Finite;
use super::contact::Slider;
use super::contacts::Contacts;
use super::needle::PlacedNeedle;
use super::tip::{Dent, Tip};
use crate::insertion::Work;
use crate::needle::CentreLine;

/// Iterations before damping: after them the forces change by an ever smaller share, so that a buckling needle does not
/// oscillate for ever.
const UNDAMPED: usize = 8;
/// Maximum bending of the needle in one iteration, mm: beyond, its flexibility differs.
const FARTHEST_MM: f64 = 5.0;
/// Consecutive solutions with unsettled states after which a substep is given up.
const MAX_UNSETTLED: usize = 3;
/// Least step length towards a solution.
const MIN_SHARE: f64 = 1e-3;
/// Motion in the last iteration above which an attempt is given up, mm.
const LOST_MM: f64 = 0.1;
/// Length above which a substep that does not settle is bisected, mm.
const MIN_PART_MM: f64 = 0.01;
/// Iterations of all attempts of a substep, as a multiple of those of one, beyond which there is no further bisection.
const MAX_ATTEMPTS: usize = 6;

/// Outcome of the iterations.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Convergence {
    /// A stable equilibrium.
    Converged,
    /// Nearly an equilibrium, or an unstable one: the needle buckles.
    Marginal,
    /// No equilibrium.
    Failed,
}

/// Lines and states of an attempt. Buffers are kept from step to step, to avoid allocation.
#[derive(Debug, Default)]
pub(super) struct Attempt {
    /// Centre line at the beginning of the iteration.
    before: CentreLine,
    start: Start,
}

/// State at the beginning of an attempt.
#[derive(Debug, Default)]
struct Start {
    base: Option<Isometry3<f64>>,
    line: CentreLine,
    forces: Vec<Vector3<f64>>,
    /// Arcs and sliders.
    contacts: Vec<(f64, Slider)>,
    tip: Option<Slider>,
}

impl Start {
    fn keep(&mut self, contacts: &Contacts, needle: &PlacedNeedle, tip: &Tip) {
        self.base = needle.base;
        self.line.clone_from(&needle.line);
        self.forces.clone_from(&contacts.forces);
        self.contacts.clear();
        let nodes = contacts.nodes.iter();
        self.contacts.extend(nodes.map(|contact| (contact.arc, contact.slider)));
        self.tip = tip.force.row().map(|row| row.slider);
    }

    fn restore(&self, contacts: &mut Contacts, needle: &mut PlacedNeedle, tip: &mut Tip) {
        needle.line.clone_from(&self.line);
        contacts.forces.clone_from(&self.forces);
        for (contact, (arc, slider)) in contacts.nodes.iter_mut().zip(&self.contacts) {
            (contact.arc, contact.slider) = (*arc, *slider);
        }
        if let (Some(row), Some(slider)) = (tip.force.row_mut(), self.tip) {
            row.slider = slider;
        }
        needle.base = self.base;
    }
}

impl Finite {
    /// Moves the needle to a base and settles it there, in halves if it would jump or oscillate.
    pub(super) fn settle(&mut self, base: &Isometry3<f64>) {
        let max_iterations = self.log.outcome.iterations + MAX_ATTEMPTS * self.options.most_iterations;
        let base = self.tip.stopped(base);
        self.settle_within(&base, max_iterations);
        // Only now: a reverted attempt restores its loads.
        self.contacts.drop_faded_releases();
        self.take_forces();
        self.log.cost.count(Work::Condensation);
    }

    fn settle_within(&mut self, base: &Isometry3<f64>, max_iterations: usize) {
        let start = self.needle.base;
        let convergence = self.attempt(base);
        if convergence == Convergence::Converged {
            return;
        }
        let start = start.filter(|start| super::farthest(start, base, self.needle.length_mm()) > MIN_PART_MM);
        if let Some(start) = start.filter(|_| self.log.outcome.iterations < max_iterations) {
            self.put_back();
            let middle = start.lerp_slerp(base, 0.5);
            self.settle_within(&middle, max_iterations);
            self.contacts.start();
            self.settle_within(base, max_iterations);
        } else {
            self.log.outcome.converged = false;
            if convergence == Convergence::Failed {
                self.put_back();
                self.needle.move_to(base);
                self.write_arcs();
            }
        }
    }

    fn put_back(&mut self) {
        self.attempt
            .start
            .restore(&mut self.contacts, &mut self.needle, &mut self.tip);
    }

    /// Iterates to consistent forces, states and shape.
    fn attempt(&mut self, base: &Isometry3<f64>) -> Convergence {
        self.log.cost.count(Work::Search);
        self.take_tip();
        self.take_compliance();
        self.log.cost.count(Work::Condensation);
        self.attempt.start.keep(&self.contacts, &self.needle, &self.tip);
        self.needle.move_to(base);
        let Dent {
            withdrawn_mm,
            compliance_mm_per_n,
            ..
        } = self.tip.dent;
        self.contacts
            .soften(self.needle.line.length_mm(), withdrawn_mm, compliance_mm_per_n);
        let mut holds = true;
        let mut change = f64::INFINITY;
        let mut unsettled = 0;
        for iteration in 0..self.options.most_iterations {
            self.log.outcome.iterations += 1;
            self.attempt.before.clone_from(&self.needle.line);
            self.write_arcs();
            let Finite {
                contacts,
                needle,
                tip,
                joint,
                ..
            } = self;
            tip.bound(contacts, &needle.line, &self.body);
            joint.turn(&contacts.arcs, &needle.line, &contacts.forces);
            let modes = needle.linearise(contacts, tip, joint.frames());
            let solved = joint.solve(
                &mut contacts.nodes,
                tip.force.row_mut(),
                &contacts.starts,
                &needle.line,
                modes.map(|_| &needle.yielding),
            );
            contacts.keep_forces();
            self.log.cost.count(Work::Friction);
            let share = self.bend(iteration, modes.is_some());
            holds = modes.is_none_or(|modes| solved.signs.dependent > 0 || solved.signs.negative >= modes);
            let slid = self.contacts.slide(&self.joint, &self.needle.line, share);
            change = slid.max(self.needle.line.distance(&self.attempt.before));
            self.log.cost.count(Work::Bending);
            unsettled = if solved.settled { 0 } else { unsettled + 1 };
            // States that still change give forces of no equilibrium, however little the line moves.
            if unsettled > 0 {
                change = f64::INFINITY;
            }
            if change <= self.options.tolerance_mm || unsettled == MAX_UNSETTLED {
                break;
            }
        }
        match change {
            _ if change <= self.options.tolerance_mm && holds => Convergence::Converged,
            _ if change <= LOST_MM => Convergence::Marginal,
            _ => Convergence::Failed,
        }
    }

    /// Moves the forces towards the last solution and bends a flexible needle under them. Returns the share of the
    /// step.
    fn bend(&mut self, iteration: usize, is_flexible: bool) -> f64 {
        let mut share = if iteration < UNDAMPED {
            1.0
        } else {
            UNDAMPED as f64 / (iteration + 1) as f64
        };
        self.contacts.step_forces(&self.joint, share);
        if !is_flexible {
            return share;
        }
        loop {
            self.needle.bend(&self.contacts, &self.tip);
            let shift = self.needle.line.distance(&self.attempt.before);
            if !(shift > FARTHEST_MM && share > MIN_SHARE) {
                return share;
            }
            share = (share * (FARTHEST_MM / shift).min(0.5)).max(MIN_SHARE);
            self.contacts.step_forces(&self.joint, share);
            self.needle.line.clone_from(&self.attempt.before);
        }
    }

    /// Writes the arcs at which forces act.
    pub(super) fn write_arcs(&mut self) {
        let (line, guide) = (&self.needle.line, self.needle.guide());
        self.contacts.write_arcs(line, self.tip.force.row().is_some(), guide);
    }

    pub(super) fn take_tip(&mut self) {
        let tangent = self.tip_tangent();
        self.tip
            .add_to_system(&tangent, &self.contacts, &mut self.tissue, &self.body);
    }

    fn tip_tangent(&self) -> Vector3<f64> {
        let direction = self.needle.line.direction();
        direction.map_or_else(Vector3::z, |tangent| tangent.into_inner())
    }

    /// Takes the compliance of the tissue, and makes room for the forces.
    pub(super) fn take_compliance(&mut self) {
        let tangent = self.tip_tangent();
        self.tissue.find_own(&self.contacts, &self.tip);
        let (contacts, row, guide) = (&mut self.contacts, self.tip.force.row(), self.needle.guide());
        let [nodes, released] = [contacts.nodes.len(), contacts.released.len()];
        self.joint
            .take_compliance(&self.tissue, nodes, row, guide, released, &tangent);
        let others = [row.is_some(), guide.is_some()];
        contacts.set_others(others, &self.needle.line, || self.tip.cutting(&self.body));
    }

    /// Passes the forces of the last solution to the tissue.
    pub(super) fn take_forces(&mut self) {
        self.tissue.take_forces(&self.joint.tissue, &self.contacts, &self.tip);
    }
}
