//! Common interface of elastic and viscous bodies.

use super::creep::Creep;
use super::solver::{Contact, Progress, Solver, Target};
use crate::mechanics::tissue::nonlinear::NonlinearError;

/// Body advanced in time; an elastic one ignores the time step.
#[derive(Clone, Debug)]
pub enum Structure<const D: usize, const N: usize> {
    /// Body without memory.
    Elastic(Box<Solver<D, N>>),
    /// Body with fractional viscosity.
    Viscous(Box<Creep<D, N>>),
}

impl<const D: usize, const N: usize> Structure<D, N> {
    /// Advances by `step_s` seconds to the loads, prescribed displacements (as in [`Target`]) and contact at the end of
    /// the step.
    ///
    /// # Errors
    /// [`NonlinearError`]; the body is then unchanged.
    pub fn step(
        &mut self,
        step_s: f64,
        loads: &[f64],
        prescribed: &[f64],
        contact: Option<&Contact>,
    ) -> Result<&Progress, NonlinearError> {
        match self {
            Structure::Elastic(solver) => Ok(solver.step(&Target {
                loads,
                prescribed,
                contact,
                offset: None,
            })?),
            Structure::Viscous(creep) => creep.step(step_s, loads, prescribed, contact),
        }
    }

    /// Exports the state as numbers, with the history of a viscous body. Cached data are recomputed, so that this body
    /// continues as one that [imports](Self::take_state) the state.
    ///
    /// # Errors
    /// [`NonlinearError`] where the stiffness cannot be factored.
    pub fn put_state(&mut self) -> Result<[Vec<f64>; 2], NonlinearError> {
        match self {
            Structure::Elastic(solver) => Ok([solver.put_state(false)?, Vec::new()]),
            Structure::Viscous(creep) => creep.put_state(),
        }
    }

    /// Imports the state of another body of this kind: the same steps then give the same bits.
    ///
    /// # Errors
    /// [`NonlinearError`] for numbers that do not fit such a body.
    pub fn take_state(&mut self, state: [&[f64]; 2]) -> Result<(), NonlinearError> {
        match self {
            Structure::Elastic(solver) => Ok(solver.take_state(state[0], false)?),
            Structure::Viscous(creep) => creep.take_state(state),
        }
    }

    /// Solver, with the body and its supports.
    pub fn solver(&self) -> &Solver<D, N> {
        match self {
            Structure::Elastic(solver) => solver,
            Structure::Viscous(creep) => creep.solver(),
        }
    }

    /// Displacements, mm.
    pub fn displacement(&self) -> &[f64] {
        self.solver().displacement()
    }

    /// Forces on all degrees of freedom, N: loads at free ones, loads plus reactions at prescribed ones.
    pub fn forces(&self) -> &[f64] {
        match self {
            Structure::Elastic(solver) => solver.forces(),
            Structure::Viscous(creep) => creep.forces(),
        }
    }

    /// Contact force along its direction, N.
    pub fn contact_force(&self) -> f64 {
        match self {
            Structure::Elastic(solver) => solver.contact_force(),
            Structure::Viscous(creep) => creep.contact_force(),
        }
    }
}
