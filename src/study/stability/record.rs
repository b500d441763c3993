//! What a case measures.

use std::fmt::Display;

use serde::{Serialize, Serializer};

use super::case::Effort;
use crate::random::{hash3, seed_words};

/// One figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measure {
    /// What was measured.
    pub what: String,
    /// The figure.
    #[serde(serialize_with = "number")]
    pub figure: f64,
    /// The largest figure that holds; none where it is only reported.
    pub limit: Option<f64>,
    /// What else there is to say, such as the words of an error.
    pub note: Option<String>,
}

/// JSON has no NaN and no infinity, and `null` would hide which it was.
fn number<S: Serializer>(figure: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if figure.is_finite() {
        serializer.serialize_f64(*figure)
    } else {
        serializer.collect_str(figure)
    }
}

impl Measure {
    /// Whether it is finite, and at most its limit.
    pub fn holds(&self) -> bool {
        self.figure.is_finite() && self.limit.is_none_or(|limit| self.figure <= limit)
    }

    /// How many times larger the figure might be: limit over figure. None where there is no limit, or nothing to compare: the
    /// figure is exactly zero, or must be.
    pub fn margin(&self) -> Option<f64> {
        let margin = self.limit? / self.figure;
        (margin.is_finite() && margin > 0.0).then_some(margin)
    }
}

/// Why a case could not go on: an error that it does not expect.
#[derive(Clone, Debug, PartialEq)]
pub struct Unexpected(String);

impl<E: std::error::Error> From<E> for Unexpected {
    fn from(error: E) -> Self {
        Unexpected(error.to_string())
    }
}

impl Unexpected {
    /// In other words than those of an error.
    pub fn new(what: impl Into<String>) -> Self {
        Unexpected(what.into())
    }
}

/// What a case writes its figures to.
pub struct Record<'a> {
    effort: Effort,
    seed: u64,
    measures: Vec<Measure>,
    progress: &'a mut dyn FnMut(f64),
}

impl<'a> Record<'a> {
    /// An empty one. `progress` is told the share of the case that is done.
    pub fn new(effort: Effort, seed: u64, progress: &'a mut dyn FnMut(f64)) -> Self {
        Record {
            effort,
            seed,
            measures: Vec::new(),
            progress,
        }
    }

    /// How long to run.
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// The seed of the case.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// A number in [-1, 1) that depends on the case's seed and this index alone.
    pub fn noise(&self, index: u64) -> f64 {
        noise(self.seed, index)
    }

    /// Notes a figure that must not exceed a limit.
    pub fn under(&mut self, what: impl Into<String>, figure: f64, limit: f64) {
        self.note(what, figure, Some(limit), None);
    }

    /// Notes a figure that must be exactly zero: a count of what is wrong, or a difference.
    pub fn zero(&mut self, what: impl Into<String>, figure: f64) {
        self.under(what, figure.abs(), 0.0);
    }

    /// Notes a figure that the criterion does not bound.
    pub fn report(&mut self, what: impl Into<String>, figure: f64) {
        self.note(what, figure, None, None);
    }

    /// Notes whether something is refused with the error expected: a wrong answer counts 1, where 0 must be.
    pub fn refused<T, E: Display>(
        &mut self,
        what: impl Into<String>,
        answer: Result<T, E>,
        expected: impl Fn(&E) -> bool,
    ) {
        let (wrong, note) = match answer {
            Ok(_) => (1.0, "not refused".to_owned()),
            Err(error) if expected(&error) => (0.0, format!("refused: {error}")),
            Err(error) => (1.0, format!("refused for another reason: {error}")),
        };
        self.note(what, wrong, Some(0.0), Some(note));
    }

    /// Notes an error that was not expected.
    pub fn fail(&mut self, Unexpected(error): Unexpected) {
        self.note("unexpected error", 1.0, Some(0.0), Some(error));
    }

    /// Tells how much of the case is done, 0 to 1.
    pub fn done(&mut self, share: f64) {
        (self.progress)(share);
    }

    /// All figures, in the order in which they came.
    pub fn into_measures(self) -> Vec<Measure> {
        self.measures
    }

    fn note(&mut self, what: impl Into<String>, figure: f64, limit: Option<f64>, note: Option<String>) {
        self.measures.push(Measure {
            what: what.into(),
            figure,
            limit,
            note,
        });
    }
}

/// A number in [-1, 1) that depends on its arguments alone.
pub fn noise(seed: u64, index: u64) -> f64 {
    let [low, high] = seed_words(index);
    let words = hash3([low as i32, high as i32, 0], seed_words(seed));
    let bits = u64::from(words[0]) << 20 | u64::from(words[1] >> 12);
    bits as f64 / (1u64 << 51) as f64 - 1.0
}

/// The largest magnitude; NaN where there is one. Zero of none.
pub fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    let larger = |a: f64, b: f64| {
        if a.is_nan() || b.is_nan() {
            f64::NAN
        } else {
            a.max(b.abs())
        }
    };
    values.into_iter().fold(0.0, larger)
}

/// The largest difference over the largest magnitude of `expected`; zero of equals, even where all are zero.
pub fn relative(found: &[f64], expected: &[f64]) -> f64 {
    let difference = largest(found.iter().zip(expected).map(|(found, expected)| found - expected));
    if difference == 0.0 && found.len() == expected.len() {
        return 0.0;
    }
    difference / largest(expected.iter().copied())
}
