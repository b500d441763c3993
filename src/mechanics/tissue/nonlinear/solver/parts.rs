//! Increments in parts, where iterations do not converge on the whole: laws of finite strain have no stress in inverted elements, and
//! a body may have several equilibria under the same loads.

use super::super::NonlinearError;
use super::{Contact, Scheme, Solver, Target};

/// Largest number of halvings of an increment.
const HALVINGS: i32 = 10;

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

    /// Advances from the start of the increment by Newton's method, in parts that are halved where iterations fail and doubled where
    /// they converge.
    pub(super) fn advance_in_parts(&mut self, target: &Target<'_>) -> Result<(), NonlinearError> {
        self.state.take(&self.start);
        self.state.contact = 0.0;
        let displacement = &self.start.displacement;
        let prescribed_dofs = self.supports.prescribed().iter();
        let first_prescribed: Vec<f64> = prescribed_dofs.map(|&dof| displacement[dof as usize]).collect();
        let first_place = target.contact.map_or(0.0, |contact| contact.along(displacement));
        let between = |from: f64, to: f64, share: f64| if share == 1.0 { to } else { from + share * (to - from) };
        let (mut reached, mut part) = (0.0, 0.5);
        let mut iterations = std::mem::take(&mut self.progress.iterations);
        while reached < 1.0 {
            let share = f64::min(reached + part, 1.0);
            // Loads begin with the contact force that balanced the start: a contact begins without force.
            let loads: Vec<f64> = self
                .applied
                .iter()
                .zip(target.loads)
                .map(|(from, to)| between(*from, *to, share))
                .collect();
            let prescribed = first_prescribed
                .iter()
                .zip(target.prescribed)
                .map(|(from, to)| between(*from, *to, share));
            let contact = target.contact.map(|contact| Contact {
                weights: contact.weights.clone(),
                place_mm: between(first_place, contact.place_mm, share),
            });
            let partial = Target {
                loads: &loads,
                prescribed: &prescribed.collect::<Vec<f64>>(),
                contact: contact.as_ref(),
                offset: None,
            };
            // The state after the last part that converged; `start` is that before the whole increment.
            let before = self.state.clone();
            let result = self.newton(&partial);
            iterations += std::mem::take(&mut self.progress.iterations);
            match result {
                Ok(()) => (reached, part) = (share, 2.0 * part),
                Err(error) if self.may_be_parted(&error) && part > 0.5f64.powi(HALVINGS) => {
                    self.state.take(&before);
                    part *= 0.5;
                }
                Err(error) => {
                    self.progress.iterations = iterations;
                    return Err(error);
                }
            }
        }
        self.progress.iterations = iterations;
        Ok(())
    }
}
