//! Hard cases for the numerics: acceptance criteria, measured figures and verdicts.
//!
//! One table serves both the `stability` command, which runs every case at full length, and the tests, which run them
//! quickly. Each [`Group`] of cases has a file of its own and is registered only in [`GROUPS`]. A case runs on a
//! [`Record`] and adds figures to it; each figure that the criterion bounds carries its limit. NaN and infinity never
//! pass, even in a figure that is only reported, and an error that a case does not expect is a failed figure.
//!
//! | module | contents |
//! |---|---|
//! | [`record`] | figures, limits, margins |
//! | [`report`] | results as text, Markdown and JSON |
//! | `solving` | elements, solvers, the dense inverse |
//! | `laws` | tissue laws: compression, near incompressibility, inverted elements |
//! | `remeshing` | remeshing and constraints |
//! | `contact` | contact, needle, time |
//! | `memory` | fading memory, stiffening at a knee |
//! | `images` | image synthesis |
//! | `motion` | motion from radio-frequency echoes |
//! | `planning` | paths, a driven guide, measured and identified needles |

mod contact;
pub mod fixtures;
mod images;
mod laws;
mod memory;
mod motion;
mod planning;
pub mod record;
mod remeshing;
pub mod report;
mod solving;

use std::time::Instant;

use serde::Serialize;

use insonify_base::machine::Machine;
pub use record::{Record, Unexpected};
pub use report::{CaseReport, StabilityReport};

/// All groups, in display order.
pub const GROUPS: &[Group] = &[
    solving::GROUP,
    laws::GROUP,
    remeshing::GROUP,
    contact::GROUP,
    memory::GROUP,
    images::GROUP,
    motion::GROUP,
    planning::GROUP,
];

/// Returns the cases whose name or group name contains `part_of_name`, ignoring case, each with its group's name; all
/// cases if `None`.
pub fn select<'a>(groups: &'a [Group], part_of_name: Option<&str>) -> Vec<(&'a str, &'a HardCase)> {
    let part_of_name = part_of_name.unwrap_or("").to_lowercase();
    let pairs = groups
        .iter()
        .flat_map(|group| group.cases.iter().map(|case| (group.name, case)));
    pairs
        .filter(|(group, case)| {
            [group, case.name]
                .iter()
                .any(|name| name.to_lowercase().contains(&part_of_name))
        })
        .collect()
}

/// Runs cases one after another. `progress` receives the name of the current case and the completed fraction of the
/// run, 0 to 1.
pub fn run(cases: &[(&str, &HardCase)], effort: Effort, progress: &mut dyn FnMut(&str, f64)) -> StabilityReport {
    let mut reports = Vec::with_capacity(cases.len());
    for (index, (group, case)) in cases.iter().enumerate() {
        let mut case_progress =
            |share: f64| progress(case.name, (index as f64 + share.clamp(0.0, 1.0)) / cases.len() as f64);
        case_progress(0.0);
        reports.push(run_case(group, case, effort, &mut case_progress));
    }
    StabilityReport {
        effort,
        machine: Machine::here(),
        cases: reports,
    }
}

fn run_case(group: &str, case: &HardCase, effort: Effort, progress: &mut dyn FnMut(f64)) -> CaseReport {
    let start = Instant::now();
    let mut record = Record::new(effort, case.seed, progress);
    if let Err(unexpected) = (case.run)(&mut record) {
        record.fail(unexpected);
    }
    CaseReport::new(group, case, start.elapsed().as_secs_f64(), record.into_measures())
}

/// Length of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
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
pub struct HardCase {
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
    pub cases: &'static [HardCase],
}

#[cfg(test)]
mod tests;
