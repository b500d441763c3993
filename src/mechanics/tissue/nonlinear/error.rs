//! Errors of a nonlinear increment.

use crate::mechanics::tissue::factor::FactorError;

/// Why an increment of a nonlinear problem cannot be solved. The solver is then unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NonlinearError {
    /// The iterations ended before the forces balanced.
    #[error(
        "forces do not balance after {iterations} iterations: what is left is {residual:.1e} of the largest force, expected at \
         most {tolerance:.0e}; take smaller increments, or more iterations"
    )]
    NotConverged {
        /// Number of iterations.
        iterations: usize,
        /// Largest unbalanced force relative to the largest force.
        residual: f64,
        /// Tolerance required.
        tolerance: f64,
    },
    /// Displacements or forces overflow.
    #[error("displacements or forces are no finite numbers after {iterations} iterations; take smaller increments")]
    Overflow {
        /// Number of iterations.
        iterations: usize,
    },
    /// A list has the wrong length.
    #[error("{found} {what}; expected {expected}")]
    Length {
        /// Items of the list.
        what: &'static str,
        /// Number of items given.
        found: usize,
        /// Number of items expected.
        expected: usize,
    },
    /// A value is NaN or infinite.
    #[error("{what} {at} is {found}; expected a finite number")]
    NotFinite {
        /// Name of the list.
        what: &'static str,
        /// Index in the list.
        at: usize,
        /// Value found.
        found: f64,
    },
    /// The contact does not act on any free displacement.
    #[error("the contact touches nothing that can move")]
    DeadContact,
    /// The tangent has more entries than 32-bit indices can address.
    #[error("the tangent has too many entries for 32-bit indices")]
    TooLarge,
    /// The tangent cannot be factored.
    #[error(transparent)]
    Factor(#[from] FactorError),
}

impl NonlinearError {
    /// Whether memory ran out, as opposed to an error in the problem.
    pub fn is_machine(&self) -> bool {
        matches!(self, NonlinearError::Factor(FactorError::Memory { .. }))
    }
}
