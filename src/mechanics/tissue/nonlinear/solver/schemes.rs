//! The three ways to go through an increment.

use super::super::error::NonlinearError;
use super::super::tangent::Kind;
use super::{Slope, Solver, Target};

/// Iterations that leave more than this of the residual, each on average, have modified Newton-Raphson factor anew: a
/// factorisation costs as much as some twenty solves, and twenty solves at this rate gain six digits.
const SLOW: f64 = 0.5;

/// Iterations with a factor before it is judged slow.
const TRIAL: usize = 4;

/// How often a full Newton step is halved at most.
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
            // Only what the loads gain: the body is taken to balance those before.
            for (rest, &dof) in self.rest.iter_mut().zip(self.supports.free()) {
                *rest = target.loads[dof as usize] - self.applied[dof as usize];
            }
            if let Some(contact) = target.contact {
                contact.add_free(self.state.contact, &self.supports, &mut self.rest);
            }
        }
        self.propose(target, kind)?;
        self.change(target);
        let residual = self.residual(target);
        self.progress.residuals.push(residual);
        self.finite(residual)
    }

    pub(super) fn modified(&mut self, target: &Target<'_>, memory: usize) -> Result<(), NonlinearError> {
        let mut residual = self.residual(target);
        let mut pending = self.pending(target);
        // Whether the factor is that of this very state; iterations with it in this increment, and the residual before them.
        let (mut own, mut tried, mut first) = (false, 0, residual);
        self.anderson.clear();
        loop {
            self.progress.residuals.push(residual);
            if residual <= self.options.tolerance && !pending {
                return Ok(());
            }
            self.more(residual)?;
            self.before.take(&self.state);
            self.propose(target, Kind::Scalar)?;
            if !pending {
                self.anderson.improve(memory, &mut self.change);
            }
            self.change(target);
            let mut next = self.residual(target);
            // What is prescribed arrives at once, and may throw forces out of balance that were in it.
            if pending {
                (own, tried, first) = (false, 0, next);
            } else if next > self.options.tolerance || next.is_nan() {
                tried += 1;
                let worse = next >= residual || next.is_nan();
                if worse {
                    self.anderson.clear();
                }
                if worse && own {
                    next = self.backtrack(target, residual, next);
                } else if worse && tried == 1 {
                    self.state.take(&self.before);
                }
                let slow = tried >= TRIAL && next > SLOW.powi(tried as i32) * first;
                if (worse && !own) || slow {
                    self.factor(Kind::Scalar)?;
                    self.anderson.clear();
                    residual = self.residual(target);
                    (own, tried, first) = (true, 0, residual);
                    continue;
                }
                own = false;
            }
            self.finite(next)?;
            (residual, pending) = (next, self.pending(target));
        }
    }

    pub(super) fn newton(&mut self, target: &Target<'_>) -> Result<(), NonlinearError> {
        let mut residual = self.residual(target);
        let mut pending = self.pending(target);
        loop {
            self.progress.residuals.push(residual);
            if residual <= self.options.tolerance && !pending {
                return Ok(());
            }
            self.more(residual)?;
            self.factor(Kind::Consistent)?;
            self.before.take(&self.state);
            self.propose(target, Kind::Consistent)?;
            self.change(target);
            let mut next = self.residual(target);
            if !pending {
                next = self.backtrack(target, residual, next);
            }
            self.finite(next)?;
            (residual, pending) = (next, self.pending(target));
        }
    }

    /// Half the way from the state before, as long as the whole way leads no nearer; the residual there.
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
