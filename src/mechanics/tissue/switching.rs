//! Constraint switching: each contact degree of freedom has either its force or its displacement prescribed, and the other
//! is sought. With D those of prescribed displacement and F the rest,
//!
//! ```text
//! f_D = K_DD^-1 (u_D - K_DF f_F)        u_F = K_FD f_D + K_FF f_F
//! ```
//!
//! Two ways behind one trait: [`Pivots`] exchanges one degree of freedom at a time in a tableau, [`Refactorised`] factors
//! K_DD at every switch. Both refuse the same: a degree of freedom whose displacement, those already prescribed held fixed,
//! can hardly be changed by a force on it. That remaining compliance is the pivot; relative to the diagonal of K^c it must
//! exceed a limit ([`PIVOT_LIMIT`]), for the relative rounding error of the forces grows with its inverse.

mod pivots;
mod refactorised;
#[cfg(test)]
mod tests;

use faer::{Mat, MatRef};

use super::condensed::Condensed;

pub use pivots::Pivots;
pub use refactorised::Refactorised;

/// The smallest pivot relative to the diagonal where K^c is exact to f64 rounding: rounding, 2.2e-16, divided by it still
/// leaves forces better than 1e-9. Where K^c comes from an inverse in f32, whose entries carry 6e-8, take 1e-3.
pub const PIVOT_LIMIT: f64 = 1e-6;

/// Which of the two is prescribed at a degree of freedom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prescribed {
    /// The force (N); the displacement is sought.
    Force,
    /// The displacement (mm); the force is sought.
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

/// A way to switch between prescribed forces and displacements.
pub trait ConstraintSolver {
    /// What is prescribed at each degree of freedom.
    fn prescribed(&self) -> &[Prescribed];

    /// Changes what is prescribed at some degrees of freedom, in this order. What is so already stays.
    ///
    /// # Errors
    /// [`SwitchError`] when an index does not fit or a displacement cannot be prescribed beside the others; then nothing
    /// is changed.
    fn switch(&mut self, changes: &[(usize, Prescribed)]) -> Result<(), SwitchError>;

    /// Takes another K^c, and what is prescribed at each of its degrees of freedom.
    ///
    /// # Errors
    /// [`SwitchError`] when K^c is not usable, the lengths differ or a displacement cannot be prescribed; then nothing is
    /// changed.
    fn replace(&mut self, condensed: &Condensed, prescribed: &[Prescribed]) -> Result<(), SwitchError>;

    /// Solves for the prescribed values, force (N) or displacement (mm) as each degree of freedom has it. They come back
    /// unchanged to the bit.
    ///
    /// # Errors
    /// [`SwitchError`] when there is not one value a degree of freedom, or a value or a result is not finite.
    fn solve_into(&mut self, values: &[f64], state: &mut ContactState) -> Result<(), SwitchError>;

    /// As [`solve_into`](Self::solve_into), into new vectors.
    ///
    /// # Errors
    /// As [`solve_into`](Self::solve_into).
    fn solve(&mut self, values: &[f64]) -> Result<ContactState, SwitchError> {
        let mut state = ContactState::default();
        self.solve_into(values, &mut state)?;
        Ok(state)
    }
}

/// Why constraints cannot be switched or solved for.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SwitchError {
    /// A displacement that the others prescribed leave no room for.
    #[error(
        "the displacement of contact node {node} along its axis {axis} cannot be prescribed beside the others: they leave it a \
         compliance of {pivot:e} mm/N of {diagonal:e}, not above {limit:e} of it; prescribe its force, or release a neighbour"
    )]
    Dependent {
        /// The node.
        node: u32,
        /// The axis of its frame, 0 to 2.
        axis: usize,
        /// The compliance that is left, mm/N.
        pivot: f64,
        /// Its own compliance: the diagonal entry of K^c, mm/N.
        diagonal: f64,
        /// The smallest ratio of the two that is accepted.
        limit: f64,
    },
    /// An index beyond the contacts.
    #[error("contact degree of freedom {dof}, but there are {size}: valid are 0 to {size} - 1")]
    OutOfRange {
        /// As given.
        dof: usize,
        /// Contact degrees of freedom.
        size: usize,
    },
    /// Not one value a contact degree of freedom.
    #[error("{found} values for {expected} contact degrees of freedom")]
    Count {
        /// As given.
        found: usize,
        /// Contact degrees of freedom.
        expected: usize,
    },
    /// A value that is infinite or undefined.
    #[error("{what} of contact node {node} along its axis {axis} is {found}; it must be finite")]
    NotFinite {
        /// Which value.
        what: &'static str,
        /// The node.
        node: u32,
        /// The axis of its frame, 0 to 2.
        axis: usize,
        /// The value.
        found: f64,
    },
}

/// K^c and the names of its rows: what both ways share.
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

    /// y = K^c x.
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

    /// Whether a displacement can be prescribed where the others leave this compliance.
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

/// A column as a slice.
fn column(matrix: MatRef<'_, f64>, j: usize) -> &[f64] {
    match matrix.col(j).try_as_col_major() {
        Some(column) => column.as_slice(),
        None => unreachable!("a matrix of its own is stored by columns"),
    }
}

/// y = A x, column by column.
fn multiply(matrix: MatRef<'_, f64>, x: &[f64], y: &mut [f64]) {
    y.fill(0.0);
    for (j, &x) in x.iter().enumerate().filter(|(_, x)| **x != 0.0) {
        y.iter_mut()
            .zip(column(matrix, j))
            .for_each(|(y, &entry)| *y += entry * x);
    }
}
