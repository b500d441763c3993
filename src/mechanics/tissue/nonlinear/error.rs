//! Errors of nonlinear tissue.

use crate::mechanics::tissue::element::DegenerateElement;
use crate::mechanics::tissue::error::LinearError;
use crate::mechanics::tissue::viscoelastic::HistoryError;

/// Why a nonlinear body cannot be made, or an increment of it not be solved. The solver is then unchanged.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NonlinearError {
    #[error("the body has no elements")]
    Empty,
    #[error("{found} materials for {expected} elements")]
    Materials { found: usize, expected: usize },
    #[error("element {element} names node {node}, but there are only {nodes} nodes (numbered from 0)")]
    Node { element: usize, node: u32, nodes: usize },
    /// An element has no usable area or volume.
    #[error("element {element}: {cause}")]
    Element { element: usize, cause: DegenerateElement },
    #[error("the thickness is {found} mm; expected a finite number above 0")]
    Thickness { found: f64 },
    /// The largest unbalanced force, relative to the largest force, is above the tolerance.
    #[error(
        "forces do not balance after {iterations} iterations: what is left is {residual:.1e} of the largest force, expected at \
         most {tolerance:.0e}; take smaller increments, or more iterations"
    )]
    NotConverged {
        iterations: usize,
        residual: f64,
        tolerance: f64,
    },
    #[error("displacements or forces are no finite numbers after {iterations} iterations; take smaller increments")]
    Overflow { iterations: usize },
    /// A list has the wrong length.
    #[error("{found} {what}; expected {expected}")]
    Length {
        what: &'static str,
        found: usize,
        expected: usize,
    },
    /// Value `at` of a list (`what`) is NaN or infinite.
    #[error("{what} {at} is {found}; expected a finite number")]
    NotFinite { what: &'static str, at: usize, found: f64 },
    /// The contact does not act on any free displacement.
    #[error("the contact touches nothing that can move")]
    DeadContact,
    /// The tangent has more entries than 32-bit indices can address.
    #[error("the tangent has too many entries for 32-bit indices")]
    TooLarge,
    /// The tangent cannot be factored.
    #[error(transparent)]
    Factor(#[from] LinearError),
    /// The history rejects the order, the rule or a step.
    #[error(transparent)]
    History(#[from] HistoryError),
    /// The body is already strained.
    #[error("the body is displaced; a history starts at rest")]
    Displaced,
}

impl NonlinearError {
    /// Whether memory ran out, as opposed to an error in the problem.
    pub fn is_machine(&self) -> bool {
        matches!(self, NonlinearError::Factor(error) if error.is_machine())
    }
}
