//! Record of the figures measured by a case.

use std::fmt::Display;

use serde::{Serialize, Serializer};

use super::Effort;
use insonify_base::random::{hash3, seed_words};

/// Measured figure.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measure {
    /// Measured quantity, in words.
    pub what: String,
    /// Value; NaN and infinity are serialised as text.
    #[serde(serialize_with = "number")]
    pub figure: f64,
    /// Largest acceptable value; `None` if the figure is only reported.
    pub limit: Option<f64>,
    /// Additional information, such as the text of an error.
    pub note: Option<String>,
    /// Limit over figure; `None` if there is no limit, or if the figure is exactly zero or must be.
    pub margin: Option<f64>,
    /// Whether the figure is finite and at most its limit.
    pub holds: bool,
}

/// Serialises a number; NaN and infinity, which JSON lacks, are distinguished, as `null` would not.
fn number<S: Serializer>(figure: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if figure.is_finite() {
        serializer.serialize_f64(*figure)
    } else {
        serializer.collect_str(figure)
    }
}

/// Unexpected error that ends a case.
#[derive(Clone, Debug, PartialEq)]
pub struct Unexpected(String);

impl<E: std::error::Error> From<E> for Unexpected {
    fn from(error: E) -> Self {
        Unexpected(error.to_string())
    }
}

impl Unexpected {
    /// Creates an error from a description.
    pub fn new(what: impl Into<String>) -> Self {
        Unexpected(what.into())
    }
}

/// Collector of the figures of a case.
pub struct Record<'a> {
    effort: Effort,
    seed: u64,
    measures: Vec<Measure>,
    progress: &'a mut dyn FnMut(f64),
}

impl<'a> Record<'a> {
    /// Creates an empty record. `progress` receives the completed fraction of the case.
    pub fn new(effort: Effort, seed: u64, progress: &'a mut dyn FnMut(f64)) -> Self {
        Record {
            effort,
            seed,
            measures: Vec::new(),
            progress,
        }
    }

    /// Returns the length of the run.
    pub fn effort(&self) -> Effort {
        self.effort
    }

    /// Returns the seed of the case.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Returns a number in [-1, 1) that depends only on the case's seed and this index.
    pub fn noise(&self, index: u64) -> f64 {
        noise(self.seed, index)
    }

    /// Records a figure that must not exceed a limit.
    pub fn under(&mut self, what: impl Into<String>, figure: f64, limit: f64) {
        self.note(what, figure, Some(limit), None);
    }

    /// Records a figure that must be exactly zero: a count of errors, or a difference.
    pub fn zero(&mut self, what: impl Into<String>, figure: f64) {
        self.under(what, figure.abs(), 0.0);
    }

    /// Records a figure that the criterion does not bound.
    pub fn report(&mut self, what: impl Into<String>, figure: f64) {
        self.note(what, figure, None, None);
    }

    /// Records whether something is refused with the expected error: 1 for a wrong answer, where 0 is required.
    pub fn refused<T, E: Display>(
        &mut self,
        what: impl Into<String>,
        answer: Result<T, E>,
        expected: impl Fn(&E) -> bool,
    ) {
        let (failures, note) = match answer {
            Ok(_) => (1.0, "not refused".to_owned()),
            Err(error) if expected(&error) => (0.0, format!("refused: {error}")),
            Err(error) => (1.0, format!("refused for another reason: {error}")),
        };
        self.note(what, failures, Some(0.0), Some(note));
    }

    /// Records an unexpected error.
    pub fn fail(&mut self, Unexpected(error): Unexpected) {
        self.note("unexpected error", 1.0, Some(0.0), Some(error));
    }

    /// Reports the completed fraction of the case, 0 to 1.
    pub fn done(&mut self, share: f64) {
        (self.progress)(share);
    }

    /// Returns all figures in the order of recording.
    pub fn into_measures(self) -> Vec<Measure> {
        self.measures
    }

    fn note(&mut self, what: impl Into<String>, figure: f64, limit: Option<f64>, note: Option<String>) {
        self.measures.push(Measure {
            what: what.into(),
            figure,
            limit,
            note,
            margin: limit
                .map(|limit| limit / figure)
                .filter(|margin| margin.is_finite() && *margin > 0.0),
            holds: figure.is_finite() && limit.is_none_or(|limit| figure <= limit),
        });
    }
}

/// Returns a number in [-1, 1) that depends only on its arguments.
pub fn noise(seed: u64, index: u64) -> f64 {
    let [low, high] = seed_words(index);
    let words = hash3([low as i32, high as i32, 0], seed_words(seed));
    let bits = u64::from(words[0]) << 20 | u64::from(words[1] >> 12);
    bits as f64 / (1u64 << 51) as f64 - 1.0
}

/// Returns the largest magnitude; NaN if any value is NaN, zero for no values.
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

/// Returns the largest difference relative to the largest magnitude of `expected`; zero for equal values, even if all
/// are zero.
pub fn relative(values: &[f64], expected: &[f64]) -> f64 {
    let difference = largest(values.iter().zip(expected).map(|(value, expected)| value - expected));
    if difference == 0.0 && values.len() == expected.len() {
        return 0.0;
    }
    difference / largest(expected.iter().copied())
}
