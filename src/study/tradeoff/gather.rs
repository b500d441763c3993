//! All studies, run in sequence into one report.

use std::time::Instant;

use super::Rates;
use super::entry::{AnyEntry, Context};
use super::report::{Chapter, Missing, Report};
use crate::stability::Effort;
use insonify_base::machine::{self, Machine};
use insonify_gpu::{AdapterChoice, Gpu, GpuError, Needs, adapter};

/// Callback that receives the current task of a study and the completed fraction.
pub type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// Devices available for measurements.
#[derive(Default)]
pub struct Devices {
    /// Devices that could be opened.
    pub gpus: Vec<Gpu>,
    /// Devices that are not measured, and why.
    pub missing: Vec<String>,
    /// Whether the CPU is not measured.
    pub skips_cpu: bool,
}

impl Devices {
    /// Opens all hardware devices of this machine; software devices run on the CPU.
    pub fn here() -> Self {
        let mut devices = Devices::default();
        for report in adapter::list() {
            let name = format!("{} ({})", report.name, report.backend);
            if report.software {
                let reason = format!("{name} was not measured: it is {}", adapter::SOFTWARE);
                devices.missing.push(reason);
                continue;
            }
            match Gpu::open(&AdapterChoice::named(name.clone()), &Needs::default()) {
                Ok(gpu) => devices.gpus.push(gpu),
                Err(error) => devices.missing.push(format!("{name} was not measured: {error}")),
            }
        }
        if devices.gpus.is_empty() && devices.missing.is_empty() {
            let reason = format!("no GPU was measured: {}", GpuError::NoAdapter);
            devices.missing.push(reason);
        }
        devices
    }
}

/// Runs every study of a list and derives the recommendations at a pace. `progress` receives the current task and the
/// completed fraction, increasing from 0 to 1. A study that fails is listed in the report with its error; the others
/// continue.
pub fn gather(
    entries: &[&dyn AnyEntry],
    devices: &Devices,
    effort: Effort,
    pace: Rates,
    progress: Progress<'_>,
) -> Report {
    let start = Instant::now();
    let (mut chapters, mut missing) = (Vec::new(), Vec::new());
    for (index, entry) in entries.iter().enumerate() {
        let about = entry.about();
        // Equal shares for studies of unequal length: how long one takes on
        // this machine is not known beforehand.
        let mut entry_progress = |step: &str, share: f64| {
            progress(
                &format!("{}: {step}", about.name),
                (index as f64 + share) / entries.len() as f64,
            );
        };
        let context = Context {
            devices,
            warn: &|_| (),
            progress: &mut entry_progress,
        };
        let begun = Instant::now();
        match entry.run_in_report(effort, context) {
            Ok(study) => chapters.push(Chapter {
                name: about.name,
                question: about.question,
                seconds: begun.elapsed().as_secs_f64(),
                pace,
                study,
            }),
            Err(error) => missing.push(Missing {
                name: about.name,
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
        notes: devices.missing.clone(),
        missing,
        chapters,
    }
}
