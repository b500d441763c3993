//! Incremental solver: balanced displacements for given loads, prescribed displacements and contact.

mod approximate;
mod iteration;
mod linear;
mod parts;
mod schemes;
mod target;

pub use target::{Contact, Target};

use std::sync::Arc;

use super::anderson::Anderson;
use super::body::{NonlinearBody, Responses};
use super::predictor::Predictor;
use super::refactorisation::RefactorisationPolicy;
use super::tangent::Kind;
use super::{NonlinearError, Supports};
use linear::{Equations, Linear};

/// Body with its supports and state.
#[derive(Clone, Debug)]
pub struct Solver<const D: usize, const N: usize> {
    body: Arc<NonlinearBody<D, N>>,
    supports: Supports<D>,
    options: SolverOptions,
    linear: Linear<D>,
    state: State<D>,
    /// State before the iteration; `start` is that before the increment.
    before: State<D>,
    start: State<D>,
    /// Loads and contact force at the end of the last increment.
    applied: Vec<f64>,
    offset: Vec<f64>,
    /// Change in an iteration: displacements, then the contact force.
    change: Vec<f64>,
    anderson: Anderson,
    predictor: Predictor,
    policy: RefactorisationPolicy,
    residual: Vec<f64>,
    progress: Progress,
    /// Largest nodal force so far, N.
    peak: f64,
    /// Unbalanced force that is only rounding, N.
    rounding_n: f64,
}

/// Displacements and derived quantities.
#[derive(Clone, Debug)]
struct State<const D: usize> {
    displacement: Vec<f64>,
    /// Forces that balance the displacements.
    forces: Vec<f64>,
    responses: Responses<D>,
    /// Contact force, N.
    contact: f64,
}

impl<const D: usize> State<D> {
    fn take(&mut self, source: &State<D>) {
        self.displacement.copy_from_slice(&source.displacement);
        self.forces.copy_from_slice(&source.forces);
        self.responses.take(&source.responses);
        self.contact = source.contact;
    }
}

impl<const D: usize, const N: usize> Solver<D, N> {
    /// Creates a solver for a body at rest.
    ///
    /// # Errors
    /// [`NonlinearError::TooLarge`]; [`NonlinearError::Factor`] where memory does not suffice, or the tangent is not
    /// positive definite because rigid motions are free.
    ///
    /// # Panics
    /// If the supports have another number of nodes.
    pub fn new(
        body: Arc<NonlinearBody<D, N>>,
        supports: Supports<D>,
        options: SolverOptions,
    ) -> Result<Self, NonlinearError> {
        assert_eq!(body.nodes().len(), supports.nodes(), "supports of another body");
        let dof_count = supports.all();
        let state = State {
            displacement: vec![0.0; dof_count],
            forces: vec![0.0; dof_count],
            responses: body.at_rest(),
            contact: 0.0,
        };
        let linear = Linear::new(&body, &supports, &state.responses)?;
        Ok(Solver {
            linear,
            options,
            before: state.clone(),
            start: state.clone(),
            state,
            applied: vec![0.0; dof_count],
            offset: vec![0.0; dof_count],
            change: vec![0.0; dof_count + 1],
            anderson: Anderson::default(),
            predictor: Predictor::default(),
            policy: RefactorisationPolicy::default(),
            residual: vec![0.0; supports.free().len()],
            progress: Progress::default(),
            peak: 0.0,
            rounding_n: body.rounding_n(),
            supports,
            body,
        })
    }

    /// Body to be solved.
    pub fn body(&self) -> &Arc<NonlinearBody<D, N>> {
        &self.body
    }

    /// Free and prescribed degrees of freedom.
    pub fn supports(&self) -> &Supports<D> {
        &self.supports
    }

    /// Displacements, mm.
    pub fn displacement(&self) -> &[f64] {
        &self.state.displacement
    }

    /// Forces that balance the displacements, N: loads at free degrees of freedom, loads plus reactions at prescribed
    /// ones.
    pub fn forces(&self) -> &[f64] {
        &self.state.forces
    }

    /// Contact force along its direction, N; 0 without a contact.
    pub fn contact_force(&self) -> f64 {
        self.state.contact
    }

    /// Convergence record of the last increment.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Returns the response of the unstrained body to loads (N): displacements (mm) with all prescribed ones 0, and the
    /// forces that balance them. The state is unchanged.
    ///
    /// # Errors
    /// [`NonlinearError`] for a wrong number of loads or one that is not finite, or where the stiffness cannot be
    /// factored.
    pub(super) fn at_rest(&mut self, loads: &[f64]) -> Result<(Vec<f64>, Vec<f64>), NonlinearError> {
        target::list("loads", loads, self.supports.all())?;
        let responses = self.body.at_rest();
        self.linear.factor(&self.body, &responses, Kind::Scalar)?;
        self.forget();
        self.supports.gather(loads, &mut self.residual);
        let exact = Equations::Tangent {
            kind: Kind::Scalar,
            closeness: schemes::CLOSEST,
        };
        self.linear.solve(&self.body, &self.supports, exact, &mut self.residual);
        let mut displacement = vec![0.0; loads.len()];
        for (&dof, value) in self.supports.free().iter().zip(&self.residual) {
            displacement[dof as usize] = *value;
        }
        let mut forces = vec![0.0; loads.len()];
        self.body.scalar(&responses, &displacement, &mut forces);
        // At prescribed degrees of freedom, forces are loads plus reactions; at free ones the loads are exact.
        for &dof in self.supports.free() {
            forces[dof as usize] = loads[dof as usize];
        }
        Ok((displacement, forces))
    }

    /// Solves for the next loads, prescribed displacements and contact from the current state.
    ///
    /// # Errors
    /// [`NonlinearError`]; the state is then unchanged.
    pub fn step(&mut self, target: &Target<'_>) -> Result<&Progress, NonlinearError> {
        target.check(&self.supports)?;
        let by_secants = target.offset.is_some()
            || matches!(
                self.options.scheme,
                Scheme::Euler {
                    slope: Slope::Scalar,
                    ..
                }
            );
        if by_secants && !self.body.has_secants() {
            return Err(NonlinearError::NoSecant);
        }
        self.start.take(&self.state);
        self.progress.iterations = 0;
        self.progress.factorisations = 0;
        self.progress.residuals.clear();
        let result = match self.advance(target) {
            Err(error) if self.may_be_parted(&error) => self.advance_in_parts(target),
            result => result,
        };
        if let Err(error) = result {
            self.state.take(&self.start);
            return Err(error);
        }
        self.take_peak();
        self.applied.copy_from_slice(target.loads);
        if let Some(contact) = target.contact {
            contact.add(self.state.contact, &mut self.applied);
        }
        Ok(&self.progress)
    }

    /// Exports the state as numbers for a solver of the same body to [import](Self::import_state). The factor is
    /// recomputed, so that both continue identically; `offset` is whether increments have offsets.
    ///
    /// # Errors
    /// [`NonlinearError::Factor`] where the tangent cannot be factored.
    pub(super) fn export_state(&mut self, offset: bool) -> Result<Vec<f64>, NonlinearError> {
        self.renew(offset)?;
        let parts = [&self.state.displacement, &self.offset, &self.applied].map(|part| &part[..]);
        Ok([&parts.concat()[..], &[self.state.contact, self.peak]].concat())
    }

    /// Imports a state.
    ///
    /// # Errors
    /// [`NonlinearError`] for numbers that do not fit such a body.
    pub(super) fn import_state(&mut self, state: &[f64], offset: bool) -> Result<(), NonlinearError> {
        let dof_count = self.supports.all();
        target::list("numbers of a state", state, 3 * dof_count + 2)?;
        self.state.displacement.copy_from_slice(&state[..dof_count]);
        self.offset.copy_from_slice(&state[dof_count..2 * dof_count]);
        self.applied.copy_from_slice(&state[2 * dof_count..3 * dof_count]);
        (self.state.contact, self.peak) = (state[3 * dof_count], state[3 * dof_count + 1]);
        self.renew(offset)
    }

    /// Recomputes everything that follows from the displacements.
    fn renew(&mut self, offset: bool) -> Result<(), NonlinearError> {
        let State {
            displacement,
            forces,
            responses,
            ..
        } = &mut self.state;
        let offset = offset.then_some(&self.offset[..]);
        self.body.respond(displacement, offset, forces, responses);
        self.linear.renew(&self.body, &self.state.responses)?;
        self.forget();
        Ok(())
    }

    /// Discards what was learnt with another factor, or in another state.
    fn forget(&mut self) {
        self.anderson.clear();
        self.predictor.clear();
        self.policy.reset();
    }

    fn take_peak(&mut self) {
        self.peak = self.state.forces.iter().fold(self.peak, |a, force| a.max(force.abs()));
    }

    fn advance(&mut self, target: &Target<'_>) -> Result<(), NonlinearError> {
        if target.contact.is_none() {
            self.state.contact = 0.0;
        }
        match target.offset {
            Some(offset) => self.offset.copy_from_slice(offset),
            None => self.offset.fill(0.0),
        }
        self.respond(target);
        match self.options.scheme {
            Scheme::Euler { slope, corrected } => self.euler(target, slope, corrected),
            Scheme::Modified { memory } => self.modified(target, memory),
            Scheme::Newton => self.newton(target),
        }
    }
}

/// Tangent of an Euler step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Slope {
    /// Kobayashi et al.'s tangent: element stiffness times 1 + a (e_r - e0)^2 + 2 a (e_r - e0) e_r.
    #[default]
    Scalar,
    /// The derivative of the law.
    Consistent,
}

/// Solution scheme of an increment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// One solve with the tangent at the start; the remaining imbalance is reported, not iterated on.
    Euler {
        /// Tangent of the step.
        slope: Slope,
        /// Whether to add the imbalance of earlier increments to this one, which Kobayashi et al. do not. With an
        /// offset of displacements it is always added.
        corrected: bool,
    },
    /// Iterations with a factor of the scalar tangent that is kept while it converges.
    Modified {
        /// Number of iterations used in Anderson's acceleration; 0 for the plain method of Kobayashi et al.
        memory: usize,
    },
    /// Iterations with the consistent tangent, factored in each.
    #[default]
    Newton,
}

impl Scheme {
    /// Modified Newton-Raphson with the most effective memory.
    pub const MODIFIED: Scheme = Scheme::Modified { memory: 6 };
}

/// Options of a solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolverOptions {
    /// Solution scheme.
    pub scheme: Scheme,
    /// Largest unbalanced force relative to the largest nodal force so far. Default 1e-9.
    pub tolerance: f64,
    /// Largest number of iterations in an increment. Default 60; full Newton needs no more than ten where modified
    /// needs all.
    pub iterations: usize,
}

impl Default for SolverOptions {
    fn default() -> Self {
        SolverOptions {
            scheme: Scheme::default(),
            tolerance: 1e-9,
            iterations: 60,
        }
    }
}

/// Convergence record of an increment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Progress {
    /// Number of iterations (changes of the displacements).
    pub iterations: usize,
    /// Number of factorisations.
    pub factorisations: usize,
    /// Largest unbalanced force relative to the largest nodal force, before each iteration and at the end.
    pub residuals: Vec<f64>,
}

impl Progress {
    /// Residual at the end.
    pub fn residual(&self) -> f64 {
        self.residuals.last().copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests;
