//! Every study after the other, into one report.
//!
//! [`STUDIES`] is the one place where a study is made known: what is not in it has no row, no plot and no advice anywhere. Nothing
//! beyond this list knows what studies compare.

use std::error::Error;
use std::time::Instant;

use super::report::{Chapter, Missing, Report};
use super::{Pace, Study, beam, history, image, insertion, remesh, tissue};
use crate::gpu::{AdapterChoice, Gpu, GpuError, Needs, adapter};
use crate::study::machine::{self, Machine};
use crate::study::stability::Effort;

/// Is told what a study does, and the share that is done.
pub type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// Why a study could not be made.
pub type Unmeasured = Box<dyn Error + Send + Sync>;

/// A study that takes part.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// Its name, as that of its subcommand.
    pub name: &'static str,
    /// Heading of its chapter.
    pub title: &'static str,
    /// What a reader learns from it.
    pub question: &'static str,
    /// Makes it.
    pub run: fn(&Means, Effort, Progress<'_>) -> Result<Study, Unmeasured>,
}

/// All that take part, in the order in which they are shown.
pub const STUDIES: &[Entry] = &[
    image::ENTRY,
    remesh::ENTRY,
    insertion::ENTRY,
    tissue::ENTRY,
    beam::ENTRY,
    history::ENTRY,
];

/// What the machine has to measure on.
#[derive(Default)]
pub struct Means {
    /// Devices that open.
    pub gpus: Vec<Gpu>,
    /// What is not measured, and why.
    pub missing: Vec<String>,
}

impl Means {
    /// All hardware devices of this machine; software ones run on the CPU.
    pub fn here() -> Self {
        let mut means = Means::default();
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

/// Makes every study of a list, and says what to take at a pace. `progress` is told what is being done and the share that is done, ascending from 0 to 1. A study
/// that cannot be made is named in the report with its reason; the others go on.
pub fn gather(entries: &[Entry], means: &Means, effort: Effort, pace: Pace, progress: Progress<'_>) -> Report {
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
                name: entry.name.to_owned(),
                reason: error.to_string(),
            }),
        }
    }
    progress("done", 1.0);
    Report {
        format: Report::FORMAT,
        program: concat!("insonify ", env!("CARGO_PKG_VERSION")).to_owned(),
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
