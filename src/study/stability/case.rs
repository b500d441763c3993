//! What a hard case is.

use serde::{Deserialize, Serialize};

use super::record::{Record, Unexpected};

/// How long a case runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Effort {
    /// Smaller counts: what the tests always run.
    Quick,
    /// The counts that the criterion names.
    Whole,
}

impl Effort {
    /// One value for each.
    pub fn pick<T>(self, quick: T, whole: T) -> T {
        match self {
            Effort::Quick => quick,
            Effort::Whole => whole,
        }
    }
}

/// One hard case.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// What is hard, in a few words.
    pub name: &'static str,
    /// What must hold, in words.
    pub criterion: &'static str,
    /// Backends and precisions that it covers, such as `cpu f64`.
    pub covers: &'static [&'static str],
    /// What its random numbers come from.
    pub seed: u64,
    /// Measures it.
    pub run: fn(&mut Record<'_>) -> Result<(), Unexpected>,
}

/// Cases of one theme.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// The theme.
    pub name: &'static str,
    /// Its cases, in the order in which they are shown.
    pub cases: &'static [Case],
}
