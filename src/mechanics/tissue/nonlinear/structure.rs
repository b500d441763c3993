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
