//! All studies, run in sequence into one report.
//!
//! [`STUDIES`] is the only registry of studies: one that is not listed has no row, plot or advice anywhere. No code outside this list knows
//! what the studies compare.

use std::error::Error;
use std::time::Instant;

use super::report::{Chapter, Missing, Report};
use super::{Rates, Study, beam, history, image, insertion, motion, planning, remesh, tissue};
use crate::stability::Effort;
use insonify_base::machine::{self, Machine};
use insonify_gpu::{AdapterChoice, Gpu, GpuError, Needs, adapter};

/// Callback that receives the current task of a study and the completed fraction.
pub type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// Error of a study that failed.
pub(crate) type StudyFailure = Box<dyn Error + Send + Sync>;

/// Registration of a study.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Name of the study and of its subcommand.
    pub name: &'static str,
    /// Title of its chapter.
    pub title: &'static str,
    /// Question that the study answers.
    pub question: &'static str,
    /// Function that runs the study.
    pub run: fn(&Devices, Effort, Progress<'_>) -> Result<Study, StudyFailure>,
}

/// All studies, in display order.
pub const STUDIES: &[Entry] = &[
    image::ENTRY,
    remesh::ENTRY,
    insertion::ENTRY,
    tissue::ENTRY,
    beam::ENTRY,
    history::ENTRY,
    motion::ENTRY,
    planning::ENTRY,
];

/// Devices available for measurements.
#[derive(Default)]
pub struct Devices {
    /// Devices that could be opened.
    pub gpus: Vec<Gpu>,
    /// Devices that are not measured, and why.
    pub missing: Vec<String>,
}

impl Devices {
    /// Opens all hardware devices of this machine; software devices run on the CPU.
    pub fn here() -> Self {
        let mut means = Devices::default();
        for found in adapter::list() {
            let name = format!("{} ({})", found.name, found.backend);
            if found.software {
                means
                    .missing
                    .push(format!("{name} was not measured: it is {}", adapter::SOFTWARE));
                continue;
            }
            match Gpu::open(&AdapterChoice::named(name.clone()), &Needs::default()) {
                Ok(gpu) => means.gpus.push(gpu),
                Err(error) => means.missing.push(format!("{name} was not measured: {error}")),
            }
        }
        if means.gpus.is_empty() && means.missing.is_empty() {
            means
                .missing
                .push(format!("no GPU was measured: {}", GpuError::NoAdapter));
        }
        means
    }
}

/// Runs every study of a list and derives the recommendations at a pace. `progress` receives the current task and the completed fraction,
/// increasing from 0 to 1. A study that fails is listed in the report with its error; the others continue.
pub fn gather(entries: &[Entry], means: &Devices, effort: Effort, pace: Rates, progress: Progress<'_>) -> Report {
    let start = Instant::now();
    let (mut chapters, mut missing) = (Vec::new(), Vec::new());
    for (at, entry) in entries.iter().enumerate() {
        let mut inner = |what: &str, share: f64| {
            progress(
                &format!("{}: {what}", entry.name),
                (at as f64 + share) / entries.len() as f64,
            );
        };
        let begun = Instant::now();
        match (entry.run)(means, effort, &mut inner) {
            Ok(study) => chapters.push(Chapter::of(entry.name, entry.question, &study, &pace, begun.elapsed())),
            Err(error) => missing.push(Missing {
                name: entry.name,
                reason: error.to_string(),
            }),
        }
    }
    progress("done", 1.0);
    Report {
        format: Report::FORMAT,
        program: format!("insonify {}", insonify_base::VERSION),
        date: machine::today(),
        effort,
        pace,
        machine: Machine::here(),
        seconds: start.elapsed().as_secs_f64(),
        notes: means.missing.clone(),
        missing,
        chapters,
    }
}
