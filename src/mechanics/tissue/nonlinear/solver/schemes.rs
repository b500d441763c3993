//! Solution schemes of an increment.

use super::super::NonlinearError;
use super::super::tangent::Kind;
use super::linear::Equations;
use super::{Slope, Solver, Target};

/// Average ratio of successive residuals above which modified Newton-Raphson refactors: a factorisation costs
/// as much as some twenty solves, and twenty solves at this rate gain six digits.
const SLOW: f64 = 0.5;

/// Iterations with a factor before its convergence is judged.
const TRIAL: usize = 4;

/// Relative residual of the linear equations in an increment without iterations: near rounding.
pub(super) const CLOSEST: f64 = 1e-12;

/// Consecutive full Newton steps under laws of finite strain that may unbalance forces more than the best so far.
const TOLERATED: usize = 4;

/// Largest number of halvings of a full Newton step.
const HALVINGS: usize = 8;

impl<const D: usize, const N: usize> Solver<D, N> {
    pub(super) fn euler(&mut self, target: &Target<'_>, slope: Slope, corrected: bool) -> Result<(), NonlinearError> {
        let kind = match slope {
            Slope::Scalar => Kind::Scalar,
            Slope::Consistent => Kind::Consistent,
        };
        let residual = self.residual(target);
        self.progress.residuals.push(residual);
        self.factor(kind)?;
        if !corrected && target.offset.is_none() {
            // Only the increase of the loads: the body is assumed to balance those before.
            for (residual, &dof) in self.residual.iter_mut().zip(self.supports.free()) {
                *residual = target.loads[dof as usize] - self.applied[dof as usize];
            }
            if let Some(contact) = target.contact {
                contact.add_free(self.state.contact, &self.supports, &mut self.residual);
            }
        }
        self.propose(
            target,
            Equations::Tangent {
                kind,
                closeness: CLOSEST,
            },
        )?;
        self.change(target);
        let residual = self.residual(target);
        self.progress.residuals.push(residual);
        self.finite(residual)
    }

    /// Method of Kobayashi et al. if `memory` is 0; otherwise accelerated by earlier iterations and increments.
    pub(super) fn modified(&mut self, target: &Target<'_>, memory: usize) -> Result<(), NonlinearError> {
        let learns = memory > 0;
        // Whether the factor is that of exactly this state.
        let mut is_fresh = learns && self.policy.is_due();
        if is_fresh {
            self.factor(Kind::Scalar)?;
        }
        let mut residual = self.residual(target);
        let mut pending = self.pending(target);
        // Iterations with the factor in this increment, and the residual before them.
        let (mut tries, mut first) = (0, residual);
        self.anderson.clear();
        loop {
            self.progress.residuals.push(residual);
            if residual <= self.options.tolerance && !pending {
                self.learn();
                return Ok(());
            }
            self.more(residual)?;
            self.before.take(&self.state);
            self.propose(target, Equations::Kept)?;
            let mut predicted = false;
            // Only the first proposal misses what that of the last increment missed; the later ones correct each other.
            if learns && self.progress.iterations == 1 {
                let contact = target.contact.map_or(&[][..], |contact| &contact.weights);
                predicted = self.predictor.apply(&mut self.change, contact);
            } else if !pending {
                self.anderson.accelerate(memory, &mut self.change);
            }
            self.change(target);
            let mut next = self.residual(target);
            let lost = next.is_nan();
            let worse = next >= residual || lost;
            let balanced = next <= self.options.tolerance;
            // Prescribed displacements arrive at once and may unbalance forces, by as much as the largest force.
            let misled = if pending {
                next > 1.0 || lost
            } else {
                worse && !balanced
            };
            if predicted && misled {
                // This increment is unlike the last one.
                self.predictor.clear();
                self.state.take(&self.before);
                residual = self.residual(target);
                continue;
            }
            if pending {
                (is_fresh, tries, first) = (false, 0, next);
            } else if !balanced {
                tries += 1;
                if worse && is_fresh {
                    next = self.backtrack(target, residual, next);
                }
                let stuck = next >= residual || next.is_nan();
                if stuck {
                    self.state.take(&self.before);
                }
                if stuck && is_fresh {
                    // Even its own factor makes no progress from here; the derivative does.
                    return self.newton(target);
                }
                // Slow convergence is known only after a few iterations: single ones alternate.
                let slow = tries >= TRIAL && next > SLOW.powi(tries as i32) * first;
                if stuck || slow {
                    self.factor(Kind::Scalar)?;
                    residual = self.residual(target);
                    (is_fresh, tries, first) = (true, 0, residual);
                    continue;
                }
                is_fresh = false;
            }
            self.finite(next)?;
            (residual, pending) = (next, self.pending(target));
        }
    }

    /// Records a balanced increment for use in the next.
    fn learn(&mut self) {
        if self.progress.iterations > 0 {
            self.policy.record_iterations(self.progress.iterations);
            let (now, before) = (&self.state, &self.start);
            let now = now.displacement.iter().chain([&now.contact]);
            let before = before.displacement.iter().chain([&before.contact]);
            self.predictor.record(now.zip(before).map(|(now, before)| now - before));
        }
    }

    pub(super) fn newton(&mut self, target: &Target<'_>) -> Result<(), NonlinearError> {
        let mut residual = self.residual(target);
        let mut pending = self.pending(target);
        let (mut best, mut tolerated) = (f64::INFINITY, 0);
        loop {
            self.progress.residuals.push(residual);
            if residual <= self.options.tolerance && !pending {
                return self.stable();
            }
            self.more(residual)?;
            self.factor(Kind::Consistent)?;
            self.before.take(&self.state);
            // The linear equations need not be more accurate than Newton's error, which this iteration squares.
            let tangent = Equations::Tangent {
                kind: Kind::Consistent,
                closeness: residual.clamp(1e-10, 1e-3),
            };
            self.propose(target, tangent)?;
            self.change(target);
            let mut next = self.residual(target);
            if !pending {
                // Full steps of tissue of finite strain that hardly changes its volume unbalance forces at first, and
                // come out ahead of short ones.
                let tolerates = !self.body.has_secants() && tolerated < TOLERATED && !next.is_nan();
                if !tolerates {
                    next = self.backtrack(target, residual, next);
                }
                tolerated = if next < best { 0 } else { tolerated + 1 };
                best = best.min(next);
            }
            self.finite(next)?;
            (residual, pending) = (next, self.pending(target));
        }
    }

    /// Whether balance is stable: the tangent of the last iteration, in laws of finite strain, is positive definite.
    fn stable(&self) -> Result<(), NonlinearError> {
        let iterations = self.progress.iterations;
        if self.body.has_secants() || iterations == 0 || self.linear.is_definite() {
            Ok(())
        } else {
            Err(NonlinearError::Unstable { iterations })
        }
    }

    /// Halves the step from the previous state while it does not reduce the residual; returns the final residual.
    fn backtrack(&mut self, target: &Target<'_>, residual: f64, mut next: f64) -> f64 {
        for _ in 0..HALVINGS {
            if next < residual || next <= self.options.tolerance {
                break;
            }
            let half = |state: &mut f64, before: &f64| *state = 0.5 * (*state + before);
            let pairs = self.state.displacement.iter_mut().zip(&self.before.displacement);
            pairs.for_each(|(state, before)| half(state, before));
            half(&mut self.state.contact, &self.before.contact);
            self.respond(target);
            next = self.residual(target);
        }
        next
    }
}
