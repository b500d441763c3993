//! Constraint switching by Cholesky factorisation of K_DD at every switch: O(|D|^3), but without accumulated rounding.
//!
//! K_DD is scaled to unit diagonal, so its pivots are the remaining relative compliances, with the same limit for all.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::{factor, solve};
use faer::{Mat, MatMut, Par};

use super::{Condensed, ConstraintSolver, ContactState, Prescribed, SwitchError, System};

/// Constraint solver that factors K_DD at every switch.
#[derive(Clone, Debug)]
pub struct Refactorised {
    system: System,
    prescribed: Vec<Prescribed>,
    factor: Factor,
}

/// K_DD = S^-1 L L^T S^-1 with D in the order in which its members were added.
#[derive(Clone, Debug)]
struct Factor {
    members: Vec<usize>,
    scales: Vec<f64>,
    lower: Mat<f64>,
}

impl Refactorised {
    /// Creates a solver with all forces prescribed. `limit` is the smallest relative pivot, as
    /// [`PIVOT_LIMIT`](super::PIVOT_LIMIT).
    ///
    /// # Errors
    /// [`SwitchError::NotFinite`] when an entry of K^c is not finite.
    pub fn new(condensed: &Condensed, limit: f64) -> Result<Self, SwitchError> {
        let system = System::new(condensed, limit)?;
        Ok(Self {
            prescribed: vec![Prescribed::Force; system.size()],
            factor: Factor::new(&system, Vec::new())?,
            system,
        })
    }
}

impl Factor {
    fn new(system: &System, members: Vec<usize>) -> Result<Self, SwitchError> {
        let mut scales = Vec::with_capacity(members.len());
        for &dof in &members {
            // Without compliance there is no scale.
            system.check_pivot(dof, system.diagonal(dof))?;
            scales.push(1.0 / system.diagonal(dof).sqrt());
        }
        let size = members.len();
        let entry = |i: usize, j: usize| system.matrix[(members[i], members[j])] * scales[i] * scales[j];
        let mut lower = Mat::from_fn(size, size, entry);
        // Pivots up to the limit are set to one, so that the first of them can be found afterwards.
        let regularization = factor::LltRegularization {
            dynamic_regularization_delta: 1.0,
            dynamic_regularization_epsilon: system.limit,
        };
        let need = factor::cholesky_in_place_scratch::<f64>(size, Par::Seq, Default::default());
        let mut memory = MemBuffer::new(need);
        let stack = MemStack::new(&mut memory);
        let done = factor::cholesky_in_place(lower.as_mut(), regularization, Par::Seq, stack, Default::default());
        let factor = Self { members, scales, lower };
        if done.is_ok_and(|info| info.dynamic_regularization_count == 0) {
            return Ok(factor);
        }
        let rounding = size as f64 * f64::EPSILON;
        let met = |&k: &usize| factor.pivot(k) <= system.limit + rounding;
        let first = (0..size).find(met).unwrap_or(size - 1);
        let dof = factor.members[first];
        // Recomputed, it may exceed the limit by rounding.
        let pivot = factor.pivot(first).min(system.limit) * system.diagonal(dof);
        system.check_pivot(dof, pivot).map(|()| factor)
    }

    /// Returns the part of the unit diagonal left by the earlier members.
    fn pivot(&self, k: usize) -> f64 {
        1.0 - (0..k).map(|j| self.lower[(k, j)].powi(2)).sum::<f64>()
    }

    /// Computes K_DD^-1 b in place.
    fn solve(&self, rhs: &mut [f64]) {
        let size = rhs.len();
        let scale = |rhs: &mut [f64]| rhs.iter_mut().zip(&self.scales).for_each(|(b, scale)| *b *= scale);
        scale(rhs);
        let columns = MatMut::from_column_major_slice_mut(rhs, size, 1);
        solve::solve_in_place(self.lower.as_ref(), columns, Par::Seq, MemStack::new(&mut []));
        scale(rhs);
    }
}

impl ConstraintSolver for Refactorised {
    fn prescribed(&self) -> &[Prescribed] {
        &self.prescribed
    }

    fn switch(&mut self, changes: &[(usize, Prescribed)]) -> Result<(), SwitchError> {
        self.system.check_changes(changes)?;
        let mut prescribed = self.prescribed.clone();
        let mut members = self.factor.members.clone();
        for &(dof, change) in changes {
            if prescribed[dof] != change {
                prescribed[dof] = change;
                match change {
                    Prescribed::Displacement => members.push(dof),
                    Prescribed::Force => members.retain(|&member| member != dof),
                }
            }
        }
        self.factor = Factor::new(&self.system, members)?;
        self.prescribed = prescribed;
        Ok(())
    }

    fn solve_into(&mut self, values: &[f64], state: &mut ContactState) -> Result<(), SwitchError> {
        self.system.check_values(values)?;
        let ContactState {
            force_n: force,
            displacement_mm: displacement,
        } = state;
        force.clear();
        force.extend_from_slice(values);
        displacement.clear();
        displacement.resize(values.len(), 0.0);
        let members = &self.factor.members;
        members.iter().for_each(|&dof| force[dof] = 0.0);
        self.system.multiply(force, displacement);
        let mut sought: Vec<f64> = members.iter().map(|&dof| values[dof] - displacement[dof]).collect();
        self.factor.solve(&mut sought);
        members
            .iter()
            .zip(&sought)
            .for_each(|(&dof, &value)| force[dof] = value);
        self.system.multiply(force, displacement);
        members.iter().for_each(|&dof| displacement[dof] = values[dof]);
        self.system.check_state(state)
    }
}
