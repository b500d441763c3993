//! Why an increment cannot be solved.

use crate::mechanics::tissue::factor::FactorError;

/// Why an increment of a nonlinear problem cannot be solved. The solver is then as before it.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NonlinearError {
    /// The iterations ended before the forces balanced.
    #[error(
        "forces do not balance after {iterations} iterations: what is left is {residual:.1e} of the largest force, expected at \
         most {tolerance:.0e}; take smaller increments, or more iterations"
    )]
    NotConverged {
        /// Iterations made.
        iterations: usize,
        /// The largest force out of balance over the largest force.
        residual: f64,
        /// What was asked for.
        tolerance: f64,
    },
    /// Displacements or forces beyond the range of numbers.
    #[error("displacements or forces are no finite numbers after {iterations} iterations; take smaller increments")]
    Overflow {
        /// Iterations made.
        iterations: usize,
    },
    /// A list of another length than the body asks for.
    #[error("{found} {what}; expected {expected}")]
    Length {
        /// What there are too many or too few of.
        what: &'static str,
        /// How many were given.
        found: usize,
        /// How many there should be.
        expected: usize,
    },
    /// A value that is NaN or infinite.
    #[error("{what} {at} is {found}; expected a finite number")]
    NotFinite {
        /// Which list.
        what: &'static str,
        /// The place in it.
        at: usize,
        /// The value.
        found: f64,
    },
    /// A contact that no free displacement answers.
    #[error("the contact touches nothing that can move")]
    DeadContact,
    /// More entries than 32-bit indices can name.
    #[error("the tangent has too many entries for 32-bit indices")]
    TooLarge,
    /// The tangent cannot be factored.
    #[error(transparent)]
    Factor(#[from] FactorError),
}

impl NonlinearError {
    /// Whether memory ran out, rather than the problem being wrong.
    pub fn is_machine(&self) -> bool {
        matches!(self, NonlinearError::Factor(FactorError::Memory { .. }))
    }
}
