//! Definition of a hard case and of groups of cases.

use serde::{Deserialize, Serialize};

use super::record::{Record, Unexpected};

/// Length of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Effort {
    /// Reduced counts, used by the tests.
    Quick,
    /// Full counts, as stated in the criterion.
    Whole,
}

impl Effort {
    /// Returns the value for this effort.
    pub fn pick<T>(self, quick: T, whole: T) -> T {
        match self {
            Effort::Quick => quick,
            Effort::Whole => whole,
        }
    }
}

/// Hard case.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// Short description of the difficulty.
    pub name: &'static str,
    /// Acceptance criterion in words.
    pub criterion: &'static str,
    /// Backends and precisions covered, such as `cpu f64`.
    pub covers: &'static [&'static str],
    /// Seed of the random numbers.
    pub seed: u64,
    /// Function that runs the case and records its figures.
    pub run: fn(&mut Record<'_>) -> Result<(), Unexpected>,
}

/// Cases on one subject.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// Subject.
    pub name: &'static str,
    /// Cases in display order.
    pub cases: &'static [Case],
}
