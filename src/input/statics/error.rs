//! Errors of problem files.

use super::file::ProblemFile;
use super::selection::Odd;
use crate::base::document::{Fault, InvalidFile, NoRegion};
use crate::mechanics::mesh::file::MeshFileError;
use crate::mechanics::mesh::quality::UnusableMesh;
use crate::mechanics::tissue::error::LinearError;
use crate::mechanics::tissue::material::InvalidMaterial;
use crate::mechanics::tissue::nonlinear::NonlinearError;

/// Error of a static problem: the cause, the key concerned and its place in the file.
pub type StaticsError = Fault<Wrong>;

/// Cause of a static problem's error.
#[derive(Debug, thiserror::Error)]
pub enum Wrong {
    /// The file cannot be read or parsed.
    #[error(transparent)]
    Text(#[from] InvalidFile),
    /// The mesh file cannot be read.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// The mesh can be read, but is unsuitable for computation.
    #[error(transparent)]
    Unusable(#[from] UnusableMesh),
    /// A material is invalid.
    #[error(transparent)]
    Material(#[from] InvalidMaterial),
    /// An unknown region name or number.
    #[error(transparent)]
    Region(#[from] NoRegion),
    /// A node number outside the mesh.
    #[error("found node {found}; the mesh has {nodes} nodes, numbered from 0")]
    Node {
        /// The node number found.
        found: i64,
        /// Number of nodes.
        nodes: usize,
    },
    /// The problem has no solution.
    #[error(transparent)]
    Solve(#[from] LinearError),
    /// The mesh does not form a valid body.
    #[error(transparent)]
    Body(#[from] NonlinearError),
    /// A step of the history failed.
    #[error("at {time_s} s: {cause}")]
    Step {
        /// The end of the step, s.
        time_s: f64,
        /// Cause of the failure.
        cause: NonlinearError,
    },
}

impl StaticsError {
    /// Whether the machine is at fault rather than the input.
    pub fn is_machine(&self) -> bool {
        match self.problem() {
            Wrong::Text(error) => error.is_machine(),
            Wrong::Mesh(error) => error.is_machine(),
            Wrong::Solve(error) => error.is_machine(),
            Wrong::Step { cause, .. } => cause.is_machine(),
            _ => false,
        }
    }
}

impl ProblemFile {
    /// Creates an error about a selection of nodes or axes.
    #[allow(clippy::boxed_local, reason = "the boxed error of a result")]
    pub(super) fn odd(&self, odd: Odd) -> StaticsError {
        self.fault(odd.0, odd.1)
    }

    /// Checks that a number is finite and no larger than `most`.
    pub(super) fn within(&self, key: &str, found: f64, most: f64, expected: &'static str) -> Result<(), StaticsError> {
        match found.abs() <= most {
            true => Ok(()),
            false => Err(self.fault(key, InvalidFile::number(found, expected))),
        }
    }

    /// Checks that each component of a vector is finite and no larger than `most`.
    pub(super) fn vector(
        &self,
        key: &str,
        vector: &[f64; 3],
        most: f64,
        expected: &'static str,
    ) -> Result<(), StaticsError> {
        let check = |(at, found): (usize, &f64)| self.within(&format!("{key}[{at}]"), *found, most, expected);
        vector.iter().enumerate().try_for_each(check)
    }
}
