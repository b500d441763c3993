//! A body that is elastic or viscous, behind one door.

use super::creep::{Creep, CreepError};
use super::solver::{Contact, Progress, Solver, Target};

/// A body, stepped in time; an elastic one does not heed it.
#[derive(Clone, Debug)]
pub enum Structure<const D: usize, const N: usize> {
    /// Without memory.
    Elastic(Box<Solver<D, N>>),
    /// With fractional viscosity.
    Viscous(Box<Creep<D, N>>),
}

impl<const D: usize, const N: usize> Structure<D, N> {
    /// Goes on by `step_s` seconds to loads, prescribed displacements (as in [`Target`]) and a contact as they are then.
    ///
    /// # Errors
    /// [`CreepError`]; the body is then as before.
    pub fn step(
        &mut self,
        step_s: f64,
        loads: &[f64],
        prescribed: &[f64],
        contact: Option<&Contact>,
    ) -> Result<&Progress, CreepError> {
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

    /// The state as numbers, and what a viscous body remembers. What is kept for speed is made anew, so that this body goes on as one
    /// that [takes](Self::take_state) it will.
    ///
    /// # Errors
    /// [`CreepError`] where the stiffness cannot be factored.
    pub fn put_state(&mut self) -> Result<[Vec<f64>; 2], CreepError> {
        match self {
            Structure::Elastic(solver) => Ok([solver.put_state(false)?, Vec::new()]),
            Structure::Viscous(creep) => creep.put_state(),
        }
    }

    /// Takes over the state of another body like this: the same steps then have the same bits.
    ///
    /// # Errors
    /// [`CreepError`] for numbers that are not of such a body.
    pub fn take_state(&mut self, state: [&[f64]; 2]) -> Result<(), CreepError> {
        match self {
            Structure::Elastic(solver) => Ok(solver.take_state(state[0], false)?),
            Structure::Viscous(creep) => creep.take_state(state),
        }
    }

    /// The solver, whose body and supports these are.
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

    /// Forces on all degrees of freedom, N: the loads, and at prescribed ones loads and what holds them.
    pub fn forces(&self) -> &[f64] {
        match self {
            Structure::Elastic(solver) => solver.forces(),
            Structure::Viscous(creep) => creep.forces(),
        }
    }

    /// Force of the contact along its direction, N.
    pub fn contact_force(&self) -> f64 {
        match self {
            Structure::Elastic(solver) => solver.contact_force(),
            Structure::Viscous(creep) => creep.contact_force(),
        }
    }
}
