//! Increments in parts, where iterations do not converge on the whole: laws of finite strain have no stress in inverted
//! elements, and a body may have several equilibria under the same loads, of which the one that the state leads to is
//! sought.

use super::super::NonlinearError;
use super::{Contact, Scheme, Solver, Target};

/// Largest number of halvings of an increment.
const HALVINGS: i32 = 10;

/// Largest number of iterations in a part: where more are needed, shorter parts take fewer in all.
const ITERATIONS: usize = 25;

impl<const D: usize, const N: usize> Solver<D, N> {
    /// Whether an increment that failed for this reason is tried in parts.
    pub(super) fn may_be_parted(&self, error: &NonlinearError) -> bool {
        let iterates = !matches!(self.options.scheme, Scheme::Euler { .. });
        let diverged = matches!(
            error,
            NonlinearError::NotConverged { .. } | NonlinearError::Inverted { .. } | NonlinearError::Unstable { .. }
        );
        iterates && diverged && !self.body.has_secants()
    }

    /// Advances from the start of the increment by Newton's method, in parts that are halved where iterations fail and
    /// doubled where they converge.
    pub(super) fn advance_in_parts(&mut self, target: &Target<'_>) -> Result<(), NonlinearError> {
        let max_iterations = self.options.iterations;
        self.options.iterations = max_iterations.min(ITERATIONS);
        let mut iterations = self.progress.iterations;
        let peak = self.peak;
        let result = self.parts(target, &mut iterations);
        (self.options.iterations, self.progress.iterations) = (max_iterations, iterations);
        if result.is_err() {
            self.peak = peak;
        }
        result
    }

    fn parts(&mut self, target: &Target<'_>, iterations: &mut usize) -> Result<(), NonlinearError> {
        self.state.take(&self.start);
        // Loads begin with the contact force that balanced the start, so a contact begins without force.
        self.state.contact = 0.0;
        let displacement = &self.start.displacement;
        let prescribed_dofs = self.supports.prescribed().iter();
        let first_prescribed: Vec<f64> = prescribed_dofs.map(|&dof| displacement[dof as usize]).collect();
        let first_place = target.contact.map_or(0.0, |contact| contact.along(displacement));
        let (mut reached, mut part) = (0.0, 0.5);
        // Near an inverted element the shortest parts may fail for want of digits; the element is what to tell.
        let mut inverted = None;
        while reached < 1.0 {
            let share = f64::min(reached + part, 1.0);
            let between = |from: f64, to: f64| if share == 1.0 { to } else { from + share * (to - from) };
            let all_between = |from: &[f64], to: &[f64]| -> Vec<f64> {
                from.iter().zip(to).map(|(from, to)| between(*from, *to)).collect()
            };
            let loads = all_between(&self.applied, target.loads);
            let prescribed = all_between(&first_prescribed, target.prescribed);
            let contact = target.contact.map(|contact| Contact {
                weights: contact.weights.clone(),
                place_mm: between(first_place, contact.place_mm),
            });
            // `start` stays that of the whole increment.
            let before = self.state.clone();
            self.progress.iterations = 0;
            let result = self.newton(&Target {
                loads: &loads,
                prescribed: &prescribed,
                contact: contact.as_ref(),
                offset: None,
            });
            *iterations += self.progress.iterations;
            match result {
                Ok(()) => {
                    (reached, part, inverted) = (share, 2.0 * part, None);
                    self.take_peak();
                }
                Err(error) if self.may_be_parted(&error) && part > 0.5f64.powi(HALVINGS) => {
                    self.state.take(&before);
                    part *= 0.5;
                    if let NonlinearError::Inverted { .. } = error {
                        inverted = Some(error);
                    }
                }
                Err(error) => return Err(inverted.unwrap_or(error)),
            }
        }
        Ok(())
    }
}
