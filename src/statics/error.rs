//! What can be wrong with a problem file.

use super::file::ProblemFile;
use super::selection::Odd;
use crate::document::{Fault, NoRegion, Unreadable};
use crate::mechanics::mesh::file::MeshFileError;
use crate::mechanics::mesh::quality::UnusableMesh;
use crate::mechanics::tissue::material::InvalidMaterial;
use crate::mechanics::tissue::nonlinear::creep::CreepError;
use crate::mechanics::tissue::nonlinear::{InvalidBody, InvalidStiffening};
use crate::mechanics::tissue::problem::SolveError;

/// Why a static problem cannot be solved: what is wrong, the key that it is about and where that stands in the file.
pub type StaticsError = Fault<Wrong>;

/// What is wrong with a static problem.
#[derive(Debug, thiserror::Error)]
pub enum Wrong {
    /// The file cannot be read, or says what no problem says.
    #[error(transparent)]
    Text(#[from] Unreadable),
    /// The mesh cannot be read.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// The mesh can be read, but not calculated on.
    #[error(transparent)]
    Unusable(#[from] UnusableMesh),
    /// A material is none.
    #[error(transparent)]
    Material(#[from] InvalidMaterial),
    /// A name or number of no region.
    #[error(transparent)]
    Region(#[from] NoRegion),
    /// A node that the mesh does not have.
    #[error("found node {found}; the mesh has {nodes} nodes, numbered from 0")]
    Node {
        /// The number.
        found: i64,
        /// How many there are.
        nodes: usize,
    },
    /// A number that is none.
    #[error("found {found}; expected {expected}")]
    Number {
        /// The number.
        found: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// Keys that contradict each other, or do not say enough.
    #[error("found {found}; expected {expected}")]
    Keys {
        /// What is there.
        found: String,
        /// What should be.
        expected: String,
    },
    /// The problem has no solution.
    #[error(transparent)]
    Solve(#[from] SolveError),
    /// A material that stiffens is none.
    #[error(transparent)]
    Stiffening(#[from] InvalidStiffening),
    /// The mesh makes no body.
    #[error(transparent)]
    Body(#[from] InvalidBody),
    /// A step of the history cannot be made.
    #[error("at {time_s} s: {cause}")]
    Step {
        /// The end of the step, s.
        time_s: f64,
        /// Why.
        cause: CreepError,
    },
}

impl StaticsError {
    /// Whether the machine failed rather than the input.
    pub fn is_machine(&self) -> bool {
        match self.problem() {
            Wrong::Text(error) => error.is_machine(),
            Wrong::Mesh(error) => error.is_machine(),
            Wrong::Solve(error) => error.is_machine(),
            Wrong::Step {
                cause: CreepError::Nonlinear(error),
                ..
            } => error.is_machine(),
            _ => false,
        }
    }
}

impl ProblemFile {
    /// An error about a key of this file.
    pub(super) fn fault(&self, key: impl Into<String>, wrong: impl Into<Wrong>) -> StaticsError {
        StaticsError::new(wrong).at_key(key, self.source.as_ref())
    }

    /// As [`ProblemFile::fault`], for keys that contradict each other or do not say enough.
    pub(super) fn wrong_keys(
        &self,
        key: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> StaticsError {
        let (found, expected) = (found.into(), expected.into());
        self.fault(key, Wrong::Keys { found, expected })
    }

    /// An error about a choice of nodes or axes.
    #[allow(clippy::boxed_local, reason = "the boxed error of a result")]
    pub(super) fn odd(&self, odd: Odd) -> StaticsError {
        self.fault(odd.0, odd.1)
    }

    /// Checks that a number is finite and no larger than `most`.
    pub(super) fn within(&self, key: &str, found: f64, most: f64, expected: &'static str) -> Result<(), StaticsError> {
        match found.abs() <= most {
            true => Ok(()),
            false => Err(self.fault(key, Wrong::Number { found, expected })),
        }
    }

    /// The same of each component of a vector.
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
