//! Constraint switching: each contact degree of freedom has either its force or its displacement prescribed, and the
//! other is unknown. With D the degrees of freedom of prescribed displacement and F the rest,
//!
//! ```text
//! f_D = K_DD^-1 (u_D - K_DF f_F)        u_F = K_FD f_D + K_FF f_F
//! ```
//!
//! Two solvers implement one trait: [`Pivots`] exchanges one degree of freedom at a time in a tableau, [`Refactorised`]
//! factors K_DD at every switch. Both refuse a degree of freedom whose displacement, with those already prescribed
//! fixed, can hardly be changed by a force on it. This remaining compliance is the pivot; relative to the diagonal of
//! K^c it must exceed a limit ([`PIVOT_LIMIT`]), as the relative rounding error of the forces grows with its inverse.

mod pivots;
mod refactorised;
#[cfg(test)]
mod tests;

use faer::{Mat, MatRef};

use super::condensed::Condensed;

pub use pivots::Pivots;
pub use refactorised::Refactorised;

/// Smallest pivot relative to the diagonal where K^c is accurate to f64 rounding: rounding, 2.2e-16, divided by it
/// still leaves forces better than 1e-9. For K^c from an inverse in f32, whose entries have errors of 6e-8, use 1e-3.
pub const PIVOT_LIMIT: f64 = 1e-6;

/// Quantity prescribed at a degree of freedom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prescribed {
    /// The force (N) is prescribed, the displacement unknown.
    Force,
    /// The displacement (mm) is prescribed, the force unknown.
    Displacement,
}

/// Forces and displacements of all contact degrees of freedom, in the frames of their nodes and in the order of K^c.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ContactState {
    /// Forces on the tissue, N.
    pub force_n: Vec<f64>,
    /// Displacements, mm.
    pub displacement_mm: Vec<f64>,
}

/// Solver with switchable prescribed forces and displacements.
pub trait ConstraintSolver {
    /// Quantity prescribed at each degree of freedom.
    fn prescribed(&self) -> &[Prescribed];

    /// Changes the quantity prescribed at some degrees of freedom, in this order. Those that already agree are skipped.
    ///
    /// # Errors
    /// [`SwitchError`] when an index is out of range or a displacement cannot be prescribed beside the others; nothing
    /// changes then.
    fn switch(&mut self, changes: &[(usize, Prescribed)]) -> Result<(), SwitchError>;

    /// Solves for prescribed values, force (N) or displacement (mm) as set at each degree of freedom. They are returned
    /// unchanged to the bit.
    ///
    /// # Errors
    /// [`SwitchError`] when there is not one value per degree of freedom, or a value or a result is not finite.
    fn solve_into(&mut self, values: &[f64], state: &mut ContactState) -> Result<(), SwitchError>;

    /// Solves as [`solve_into`](Self::solve_into) does, into new vectors.
    ///
    /// # Errors
    /// Those of [`solve_into`](Self::solve_into).
    fn solve(&mut self, values: &[f64]) -> Result<ContactState, SwitchError> {
        let mut state = ContactState::default();
        self.solve_into(values, &mut state)?;
        Ok(state)
    }
}

/// Error in switching constraints or solving for them.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SwitchError {
    /// A displacement is determined by the others prescribed.
    #[error(
        "the displacement of contact node {node} along its axis {axis} cannot be prescribed beside the others: they leave it a \
         compliance of {pivot:e} mm/N of {diagonal:e}, not above {limit:e} of it; prescribe its force, or release a neighbour"
    )]
    Dependent {
        /// Index of the node.
        node: u32,
        /// Axis of the node's frame, 0 to 2.
        axis: usize,
        /// Remaining compliance, mm/N.
        pivot: f64,
        /// Diagonal entry of K^c, mm/N.
        diagonal: f64,
        /// Smallest accepted ratio of remaining compliance to diagonal entry.
        limit: f64,
    },
    /// An index is beyond the contacts.
    #[error("contact degree of freedom {dof}, but there are {size}: valid are 0 to {size} - 1")]
    OutOfRange {
        /// Index given.
        dof: usize,
        /// Number of contact degrees of freedom.
        size: usize,
    },
    /// There is not one value per contact degree of freedom.
    #[error("{found} values for {expected} contact degrees of freedom")]
    Count {
        /// Number of values given.
        found: usize,
        /// Number of contact degrees of freedom.
        expected: usize,
    },
    /// A value is infinite or undefined.
    #[error("{what} of contact node {node} along its axis {axis} is {found}; it must be finite")]
    NotFinite {
        /// Name of the quantity.
        what: &'static str,
        /// Index of the node.
        node: u32,
        /// Axis of the node's frame, 0 to 2.
        axis: usize,
        /// Value found.
        found: f64,
    },
}

/// K^c and the nodes of its rows, shared by both solvers.
#[derive(Clone, Debug)]
struct System {
    matrix: Mat<f64>,
    nodes: Vec<u32>,
    limit: f64,
}

impl System {
    fn new(condensed: &Condensed, limit: f64) -> Result<Self, SwitchError> {
        let system = Self {
            matrix: condensed.matrix().to_owned(),
            nodes: condensed.contacts().iter().map(|contact| contact.node).collect(),
            limit: limit.max(f64::EPSILON),
        };
        for column in 0..system.size() {
            system.check_finite("the compliance", system.column(column))?;
        }
        Ok(system)
    }

    fn size(&self) -> usize {
        3 * self.nodes.len()
    }

    fn column(&self, j: usize) -> &[f64] {
        column(self.matrix.as_ref(), j)
    }

    fn diagonal(&self, dof: usize) -> f64 {
        self.matrix[(dof, dof)]
    }

    /// Computes y = K^c x.
    fn multiply(&self, x: &[f64], y: &mut [f64]) {
        multiply(self.matrix.as_ref(), x, y);
    }

    fn check_changes(&self, changes: &[(usize, Prescribed)]) -> Result<(), SwitchError> {
        let size = self.size();
        match changes.iter().find(|change| change.0 >= size) {
            Some(&(dof, _)) => Err(SwitchError::OutOfRange { dof, size }),
            None => Ok(()),
        }
    }

    fn check_count(&self, found: usize) -> Result<(), SwitchError> {
        let expected = self.size();
        if found == expected {
            Ok(())
        } else {
            Err(SwitchError::Count { found, expected })
        }
    }

    fn check_finite(&self, what: &'static str, values: &[f64]) -> Result<(), SwitchError> {
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(()),
            Some(dof) => Err(SwitchError::NotFinite {
                what,
                node: self.nodes[dof / 3],
                axis: dof % 3,
                found: values[dof],
            }),
        }
    }

    fn check_values(&self, values: &[f64]) -> Result<(), SwitchError> {
        self.check_count(values.len())?;
        self.check_finite("the prescribed value", values)
    }

    fn check_state(&self, state: &ContactState) -> Result<(), SwitchError> {
        self.check_finite("the force", &state.force_n)?;
        self.check_finite("the displacement", &state.displacement_mm)
    }

    /// Checks that a displacement can be prescribed where the others leave this compliance.
    fn check_pivot(&self, dof: usize, pivot: f64) -> Result<(), SwitchError> {
        let [diagonal, limit] = [self.diagonal(dof), self.limit];
        if diagonal > 0.0 && pivot > limit * diagonal {
            return Ok(());
        }
        Err(SwitchError::Dependent {
            node: self.nodes[dof / 3],
            axis: dof % 3,
            pivot,
            diagonal,
            limit,
        })
    }
}

/// Returns a column as a slice.
fn column(matrix: MatRef<'_, f64>, j: usize) -> &[f64] {
    match matrix.col(j).try_as_col_major() {
        Some(column) => column.as_slice(),
        None => unreachable!("a matrix of its own is stored by columns"),
    }
}

/// Computes y = A x, column by column.
fn multiply(matrix: MatRef<'_, f64>, x: &[f64], y: &mut [f64]) {
    y.fill(0.0);
    for (j, &x) in x.iter().enumerate().filter(|(_, x)| **x != 0.0) {
        y.iter_mut()
            .zip(column(matrix, j))
            .for_each(|(y, &entry)| *y += entry * x);
    }
}
