//! One iteration: change of the displacements, and its residual.

use super::super::NonlinearError;
use super::super::tangent::Kind;
use super::linear::Equations;
use super::{Contact, Solver, State, Target};

/// Largest change of a displacement gradient that an increment of tissue of finite strain may propose at first; beyond,
/// it is made in parts.
const FARTHEST: f64 = 0.4;

impl<const D: usize, const N: usize> Solver<D, N> {
    /// Computes a change of the displacements, with that of the contact force at its end, from linear equations:
    /// prescribed displacements and the contact reach their targets.
    pub(super) fn propose(&mut self, target: &Target<'_>, equations: Equations) -> Result<(), NonlinearError> {
        self.progress.iterations += 1;
        self.change.fill(0.0);
        for (&dof, value) in self.supports.prescribed().iter().zip(target.prescribed) {
            self.change[dof as usize] = value - self.state.displacement[dof as usize];
        }
        let (body, supports) = (&*self.body, &self.supports);
        if self.change.iter().any(|change| *change != 0.0) {
            self.linear.subtract(
                body,
                supports,
                equations,
                &self.change[..supports.all()],
                &mut self.residual,
            );
        }
        self.linear.solve(body, supports, equations, &mut self.residual);
        for (&dof, value) in supports.free().iter().zip(&self.residual) {
            self.change[dof as usize] = *value;
        }
        let dof_count = supports.all();
        if let Some(contact) = target.contact {
            let contact_response = self.linear.contact_response(body, supports, equations, contact);
            let compliance = contact.along_free(supports, contact_response);
            if compliance.is_nan() || compliance <= 0.0 {
                return Err(NonlinearError::DeadContact);
            }
            let gap = contact.place_mm - contact.along(&self.state.displacement) - contact.along(&self.change);
            let force = gap / compliance;
            for (&dof, response) in supports.free().iter().zip(contact_response) {
                self.change[dof as usize] += force * response;
            }
            self.change[dof_count] = force;
        }
        // The first proposal tells how far the increment goes: from farther away, iterations may end in another
        // equilibrium.
        let is_first = self.progress.iterations == 1 && !self.body.has_secants();
        if is_first && self.body.largest_finite_change(&self.change) > FARTHEST {
            return Err(self.not_converged(self.progress.residual()));
        }
        Ok(())
    }

    /// Applies the computed change.
    pub(super) fn change(&mut self, target: &Target<'_>) {
        let State {
            displacement, contact, ..
        } = &mut self.state;
        let unknowns = displacement.iter_mut().chain([contact]);
        unknowns.zip(&self.change).for_each(|(value, change)| *value += change);
        self.respond(target);
    }

    pub(super) fn respond(&mut self, target: &Target<'_>) {
        let offset = target.offset.map(|_| &*self.offset);
        let State {
            displacement,
            forces,
            responses,
            ..
        } = &mut self.state;
        self.body.respond(displacement, offset, forces, responses);
    }

    pub(super) fn factor(&mut self, kind: Kind) -> Result<(), NonlinearError> {
        self.progress.factorisations += 1;
        self.forget();
        self.linear.factor(&self.body, &self.state.responses, kind)
    }

    /// Writes the unbalanced free forces to `rest`, and returns the largest relative to the largest force so far. The
    /// current forces would not do as a reference: those of an unloaded body are only rounding.
    pub(super) fn residual(&mut self, target: &Target<'_>) -> f64 {
        let largest = |values: &[f64]| {
            values.iter().fold(0.0, |a: f64, x| {
                if a.is_nan() || x.is_nan() {
                    f64::NAN
                } else {
                    a.max(x.abs())
                }
            })
        };
        for (residual, &dof) in self.residual.iter_mut().zip(self.supports.free()) {
            *residual = target.loads[dof as usize] - self.state.forces[dof as usize];
        }
        if let Some(contact) = target.contact {
            contact.add_free(self.state.contact, &self.supports, &mut self.residual);
        }
        let left = largest(&self.residual);
        if left <= self.rounding_n {
            return 0.0;
        }
        left / self.peak.max(largest(&self.state.forces)).max(largest(target.loads))
    }

    /// Whether a prescribed displacement or the contact has yet to reach its target.
    pub(super) fn pending(&self, target: &Target<'_>) -> bool {
        let displacement = &self.state.displacement;
        let mut prescribed = self.supports.prescribed().iter().zip(target.prescribed);
        let away = |contact: &Contact| {
            let place_mm = contact.along(displacement);
            (place_mm - contact.place_mm).abs() > 1e-12 * (place_mm.abs() + contact.place_mm.abs())
        };
        prescribed.any(|(&dof, value)| displacement[dof as usize] != *value) || target.contact.is_some_and(away)
    }

    pub(super) fn more(&self, residual: f64) -> Result<(), NonlinearError> {
        if self.progress.iterations < self.options.iterations {
            return Ok(());
        }
        Err(self.not_converged(residual))
    }

    fn not_converged(&self, residual: f64) -> NonlinearError {
        NonlinearError::NotConverged {
            iterations: self.progress.iterations,
            residual,
            tolerance: self.options.tolerance,
        }
    }

    pub(super) fn finite(&self, residual: f64) -> Result<(), NonlinearError> {
        if residual.is_finite() && self.state.displacement.iter().all(|u| u.is_finite()) {
            return Ok(());
        }
        let finite = self.state.displacement.iter().all(|u| u.is_finite());
        match self
            .body
            .inverted(&self.state.displacement)
            .filter(|_| finite && !self.body.has_secants())
        {
            Some(element) => Err(NonlinearError::Inverted { element }),
            None => Err(NonlinearError::Overflow {
                iterations: self.progress.iterations,
            }),
        }
    }
}
