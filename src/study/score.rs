//! Score of an insertion: ten metrics over the period in which the needle is in the body (Zhu et al. 2007, table 1;
//! definitions in docs/metrics.md), from the table of steps of a run.

pub mod exercise;
pub mod groups;
pub mod hands;
pub mod page;
#[cfg(test)]
mod tests;

use std::path::{Path, PathBuf};

use nalgebra::{Point3, Vector3};
use serde::{Serialize, Serializer};

use crate::StudyError;
use insonify::Error;
use insonify::run::{Observer, Step};
use insonify_base::csv::{Csv, CsvError, Row};

/// Number of metrics.
pub(crate) const COUNT: usize = 10;
/// Names of the metrics.
pub const NAMES: [&str; COUNT] = ["m1", "m2", "m3", "m4", "m5", "m6", "m7", "m8", "m9", "m10"];
/// Units of the metrics.
pub(crate) const UNITS: [&str; COUNT] = ["mm", "deg", "mm", "deg", "deg", "mm", "deg", "%", "mm", "mm"];
/// Meanings of the metrics.
pub(crate) const MEANINGS: [&str; COUNT] = [
    "distance of the tip from the line from entry to target",
    "angle between needle and that line",
    "distance of the tip from the image plane",
    "angle between needle and image plane",
    "turn of the image plane since the entry",
    "distance of the measured from the constrained tip",
    "angle between measured and constrained needle",
    "time in which the image shows the target",
    "distance of the target from the image plane",
    "least distance of the tip from the target",
];

/// Values of the metrics, in the order of [`NAMES`]: means, but for m10, a minimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics(pub [f64; COUNT]);

impl Serialize for Metrics {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(NAMES.iter().zip(self.0))
    }
}

/// Geometry of one step within the body; points in the world, mm.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    time_s: f64,
    tip: Point3<f64>,
    direction: Vector3<f64>,
    measured_tip: Point3<f64>,
    measured_direction: Vector3<f64>,
    array: Point3<f64>,
    normal: Vector3<f64>,
    /// At rest, and carried by the tissue.
    entry: [Point3<f64>; 2],
    target: [Point3<f64>; 2],
    shown: bool,
    clearance_mm: Option<f64>,
    base_force_n: f64,
}

/// Score of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Score {
    /// Folder or table of the run.
    pub run: PathBuf,
    /// Metrics with entry and target as the tissue carries them.
    #[serde(flatten)]
    pub metrics: Metrics,
    /// Metrics with entry and target where they lie at rest.
    pub at_rest: Metrics,
    /// Units of the metrics.
    pub units: std::collections::BTreeMap<&'static str, &'static str>,
    /// First and last moment of the period, s.
    pub during_s: [f64; 2],
    /// Moment of the closest approach to the target, s.
    pub nearest_s: f64,
    /// Whether the needle was withdrawn within the run.
    pub withdrawn: bool,
    /// Least distance of the tip from a critical structure, mm; `None` if none is near.
    pub clearance_mm: Option<f64>,
    /// Number of times that the tip entered a critical structure.
    pub critical_entries: usize,
    /// Largest force on the hand, N.
    pub max_force_n: f64,
    /// End of the run, s.
    #[serde(skip)]
    pub end_s: f64,
    /// Geometry of the period.
    #[serde(skip)]
    pub samples: Vec<Sample>,
}

/// Columns of three numbers.
fn three(row: Row<'_>, name: &str, unit: &str) -> Result<[f64; 3], CsvError> {
    let columns = ["x", "y", "z"].map(|axis| format!("{name}{axis}{unit}"));
    row.numbers(columns.each_ref().map(String::as_str))
}

/// Columns that a table of steps must have; those of three numbers are looked up by their first.
const REQUIRED: [&str; 8] = [
    "time_s",
    "inserted_mm",
    "tip_x_mm",
    "base_dx",
    "tip_dx",
    "plane_nx",
    "target_x_mm",
    "target_shown",
];

/// Reason for which a run without a target is not scored.
const NO_TARGET: &str = "has no target: name one in the scenario (`needle.target` or `[[plan.target]]`)";

/// Error of a run (its folder or table) that cannot be scored.
fn unscored(run: &Path, reason: &str) -> Error {
    StudyError::refused(format!("{} {reason}", run.display()))
}

impl Score {
    /// Scores a run from its folder, or from its table of steps.
    ///
    /// # Errors
    /// [`CsvError`] if the table cannot be read; [`StudyError::Refused`] if the run has no target, or the needle never
    /// is in the body.
    pub fn of(run: &Path) -> Result<Self, Error> {
        let file = if run.is_dir() {
            run.join("steps.csv")
        } else {
            run.to_owned()
        };
        let table = Csv::open(&file, &REQUIRED)?;
        let mut samples = Vec::new();
        let (mut withdrawn, mut end_s) = (false, 0.0);
        for row in table.rows() {
            end_s = row.number("time_s")?;
            if row.number("inserted_mm")? <= 0.0 {
                withdrawn |= !samples.is_empty();
                continue;
            }
            if row.text("target_x_mm").is_empty() {
                return Err(unscored(run, NO_TARGET));
            }
            samples.push(Sample::read(row)?);
        }
        Self::of_samples(run, samples, withdrawn, end_s)
    }

    /// Scores the steps of a run in which the needle is in the body.
    fn of_samples(run: &Path, samples: Vec<Sample>, withdrawn: bool, end_s: f64) -> Result<Self, Error> {
        let (Some(first_sample), Some(last_sample)) = (samples.first(), samples.last()) else {
            return Err(unscored(run, "never has the needle in the body"));
        };
        let nearest = samples
            .iter()
            .min_by(|a, b| a.target_distance(1).total_cmp(&b.target_distance(1)));
        let clearances = samples.iter().filter_map(|sample| sample.clearance_mm);
        let inside = samples.iter().map(|sample| sample.clearance_mm == Some(0.0));
        let entries = inside.fold((0, false), |(count, was_inside), is_inside| {
            (count + usize::from(is_inside && !was_inside), is_inside)
        });
        Ok(Self {
            run: run.to_owned(),
            metrics: metrics(&samples, 1),
            at_rest: metrics(&samples, 0),
            units: NAMES.into_iter().zip(UNITS).collect(),
            during_s: [first_sample.time_s, last_sample.time_s],
            nearest_s: nearest.map_or(f64::NAN, |sample| sample.time_s),
            withdrawn,
            clearance_mm: clearances.reduce(f64::min),
            critical_entries: entries.0,
            max_force_n: samples.iter().map(|sample| sample.base_force_n).fold(0.0, f64::max),
            end_s,
            samples,
        })
    }
}

/// Collects the samples of a run.
#[derive(Default)]
pub(super) struct Collector {
    samples: Vec<Sample>,
    withdrawn: bool,
    end_s: f64,
}

impl Observer for Collector {
    type Error = Error;

    fn step(&mut self, step: &Step<'_>) -> Result<(), Error> {
        let sample = Sample::of(step);
        self.end_s = step.time_s;
        self.withdrawn |= sample.is_none() && !self.samples.is_empty();
        self.samples.extend(sample);
        Ok(())
    }
}

impl Collector {
    pub(crate) fn score(self, run: &Path) -> Result<Score, Error> {
        Score::of_samples(run, self.samples, self.withdrawn, self.end_s)
    }
}

impl Sample {
    fn read(row: Row<'_>) -> Result<Self, CsvError> {
        let point = |name: &str| three(row, name, "_mm").map(Point3::from);
        let vector = |name: &str| three(row, name, "").map(Vector3::from);
        let force = three(row, "base_force_", "_n")?;
        Ok(Self {
            time_s: row.number("time_s")?,
            tip: point("tip_")?,
            direction: vector("tip_d")?,
            measured_tip: point("measured_tip_")?,
            measured_direction: vector("base_d")?,
            array: point("array_")?,
            normal: vector("plane_n")?,
            entry: [point("entry_at_rest_")?, point("entry_")?],
            target: [point("target_at_rest_")?, point("target_")?],
            shown: row.count("target_shown")? > 0,
            clearance_mm: match row.text("clearance_mm") {
                "" => None,
                _ => Some(row.number("clearance_mm")?),
            },
            base_force_n: Vector3::from(force).norm(),
        })
    }

    /// Sample of a step; `None` while the needle is outside, or without a target.
    fn of(step: &Step<'_>) -> Option<Self> {
        let (outcome, guidance) = (step.outcome, &step.guidance);
        if outcome.inserted_mm <= 0.0 {
            return None;
        }
        Some(Self {
            time_s: step.time_s,
            tip: outcome.tip_mm,
            direction: guidance.direction,
            measured_tip: guidance.measured_tip,
            measured_direction: step.base.rotation * Vector3::z(),
            array: guidance.array,
            normal: guidance.normal,
            entry: guidance.entry?,
            target: guidance.target?,
            shown: guidance.shown,
            clearance_mm: guidance.clearance_mm,
            base_force_n: outcome.on_hand.force_n.norm(),
        })
    }

    fn target_distance(&self, state: usize) -> f64 {
        (self.tip - self.target[state]).norm()
    }

    /// Values whose means are the metrics; `normal` is that of the plane at entry.
    fn values(&self, state: usize, normal: &Vector3<f64>) -> [f64; COUNT] {
        let (entry, target) = (self.entry[state], self.target[state]);
        let line = (target - entry).try_normalize(0.0).unwrap_or_default();
        let out_of_plane_mm = |point: &Point3<f64>| self.normal.dot(&(point - self.array)).abs();
        // The sine is rounded to at most 1.
        let tilt = self.direction.dot(&self.normal).abs().min(1.0).asin();
        [
            (self.tip - entry).cross(&line).norm(),
            self.direction.angle(&line).to_degrees(),
            out_of_plane_mm(&self.tip),
            tilt.to_degrees(),
            // Planes have no sides.
            90.0 - (90.0 - self.normal.angle(normal).to_degrees()).abs(),
            (self.measured_tip - self.tip).norm(),
            self.measured_direction.angle(&self.direction).to_degrees(),
            100.0 * f64::from(u8::from(self.shown)),
            out_of_plane_mm(&target),
            self.target_distance(state),
        ]
    }
}

/// Metrics with entry and target at rest (0) or as carried by the tissue (1). Steps have the same length.
fn metrics(samples: &[Sample], state: usize) -> Metrics {
    let normal = samples.first().map_or(Vector3::z(), |sample| sample.normal);
    let mut sums = [0.0; COUNT];
    let mut least = f64::INFINITY;
    for sample in samples {
        let values = sample.values(state, &normal);
        sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        least = least.min(values[COUNT - 1]);
    }
    let mut means = sums.map(|sum| sum / samples.len() as f64);
    means[COUNT - 1] = least;
    Metrics(means)
}
