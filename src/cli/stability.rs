//! `insonify stability`: stability tests on hard cases.

use std::path::{Path, PathBuf};

use clap::Args;
use insonify_study::stability::{Effort, GROUPS, HardCase, StabilityReport, run, select};

use super::failure::{Error, Failure, usage};
use super::output::{Force, text};
use super::study::watched;
use super::terminal;

const TEACHING: &str = "\
Every case is hard for numerical methods: slivers, near incompressibility, 5,000 remeshes. Each has
a criterion from theory; what is measured is shown beside it:

  figure   the measured value nearest to its limit
  limit    the largest figure that meets the criterion
  margin   limit over figure; below 1x the case fails. `exact`: the figure is zero, as required
  verdict  holds or FAILS. NaN and infinity fail; an input that must be rejected fails its case if it is accepted, or rejected for another reason

Examples:
  insonify stability                         every case at the counts that its criterion names: minutes
  insonify stability --quick                 the same cases with smaller counts: seconds
  insonify stability --only remeshing        cases whose name, or whose group's, contains this
  insonify stability -o report               every figure: report/index.html, margins.svg, report.md and results.json

Seeds are fixed and shown, so a run can be repeated. Exit status: 0 all hold; 1 some do not; 2 wrong arguments.";

/// Files of a report.
const FILES: [&str; 4] = ["index.html", "margins.svg", "report.md", "results.json"];

/// Runs the hard cases of the numerics and shows the limit of each, the measured value, and the margin
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct Stability {
    /// Write index.html, margins.svg, report.md and results.json, with every value, into this folder
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Smaller problems: seconds instead of minutes
    #[arg(long)]
    quick: bool,
    /// Only the cases whose name or group contains TEXT
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Print JSON with every value
    #[arg(long)]
    json: bool,
}

impl Stability {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let cases = select(GROUPS, self.only.as_deref());
        if cases.is_empty() {
            return Err(none_selected(self.only.as_deref().unwrap_or_default()));
        }
        let folder = self.force.requested_folder(&self.output, "stability", &FILES, &[])?;
        let report = self.measure(&cases);
        if let Some(folder) = folder {
            write(&report, folder.path())?;
            folder.install()?;
        }
        terminal::print(&report, self.json)?;
        match report.failed() {
            0 => Ok(()),
            failed => Err(Failure::Unstable {
                failed,
                cases: report.cases.len(),
            }
            .into()),
        }
    }

    fn measure(&self, cases: &[(&str, &HardCase)]) -> StabilityReport {
        let effort = if self.quick { Effort::Quick } else { Effort::Whole };
        watched(|progress| run(cases, effort, progress))
    }
}

/// Writes a report into a folder, each file atomically.
fn write(report: &StabilityReport, folder: &Path) -> Result<(), Error> {
    let results = terminal::pretty(report)?;
    let texts = [report.page()?, report.plot()?, report.markdown(), results + "\n"];
    FILES
        .iter()
        .zip(texts)
        .try_for_each(|(name, content)| text(&folder.join(name), &content))
}

fn none_selected(only: &str) -> Error {
    let names = GROUPS.iter().map(|group| {
        let names: Vec<&str> = group.cases.iter().map(|case| case.name).collect();
        format!("{}: {}", group.name, names.join(", "))
    });
    let names: Vec<String> = names.collect();
    usage(format!("no case has `{only}` in its name"), names.join("\n"))
}
