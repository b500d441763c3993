//! `insonify stability`: hard cases, and whether they hold.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use indicatif::ProgressBar;
use insonify::output::atomic;
use insonify::study::stability::{Case, Effort, GROUPS, Report, run, select};

use super::failure::Failure;
use super::terminal;

const TEACHING: &str = "\
Every case is something that breaks numerics: slivers, near incompressibility, 5,000 remeshes, contacts that depend on each
other. Each has a criterion from theory; what is measured is shown beside it:

  figure   what came out, the measurement nearest to its limit
  limit    the largest figure that meets the criterion
  margin   how many times larger the figure might be; below 1x it fails. `exact`: zero, as it must be
  verdict  holds or FAILS. NaN and infinity fail; a case that must be refused fails if it is not, or for another reason

Examples:
  insonify stability                         every case at the counts that its criterion names: minutes
  insonify stability --quick                 the same cases with smaller counts: seconds
  insonify stability --only remeshing        cases whose name, or whose group's, contains this
  insonify stability -o report               every figure: report/report.md and report/results.json

Seeds are fixed and shown, so a run can be repeated. Exit status: 0 all hold; 1 some do not; 2 wrong arguments.";

/// Runs the hard cases of the numerics and shows what each must hold to, what was measured, and the margin
#[derive(Args)]
#[command(after_help = TEACHING)]
pub struct Stability {
    /// Write report.md and results.json, with every figure, into this folder
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Smaller counts: seconds instead of minutes
    #[arg(long)]
    quick: bool,
    /// Only the cases whose name, or whose group's, contains TEXT
    #[arg(long, value_name = "TEXT")]
    only: Option<String>,
    /// Print JSON with every figure
    #[arg(long)]
    json: bool,
}

impl Stability {
    pub fn run(&self) -> Result<(), Failure> {
        let cases = select(GROUPS, self.only.as_deref());
        if cases.is_empty() {
            return Err(none_selected(self.only.as_deref().unwrap_or_default()));
        }
        if let Some(folder) = &self.output {
            std::fs::create_dir_all(folder).map_err(|cause| Failure::Folder {
                path: folder.clone(),
                cause,
            })?;
        }
        let report = self.measure(&cases);
        if let Some(folder) = &self.output {
            let results = serde_json::to_string_pretty(&report).map_err(|error| Failure::Output(error.into()))?;
            atomic::write(&folder.join("report.md"), |file| {
                file.write_all(report.markdown().as_bytes())
            })?;
            atomic::write(&folder.join("results.json"), |file| writeln!(file, "{results}"))?;
        }
        if self.json {
            terminal::emit_json(&report)?;
        } else {
            terminal::emit(&report.to_string())?;
        }
        match report.failed() {
            0 => Ok(()),
            failed => Err(Failure::Unstable {
                failed,
                cases: report.cases.len(),
            }),
        }
    }

    fn measure(&self, cases: &[(&str, &Case)]) -> Report {
        let effort = if self.quick { Effort::Quick } else { Effort::Whole };
        let bar: ProgressBar = terminal::share(self.json);
        let report = run(cases, effort, |name, share| {
            bar.set_message(name.to_owned());
            bar.set_position((share * terminal::SHARES as f64) as u64);
        });
        bar.finish_and_clear();
        report
    }
}

fn none_selected(only: &str) -> Failure {
    let names = GROUPS.iter().map(|group| {
        let names: Vec<&str> = group.cases.iter().map(|case| case.name).collect();
        format!("{}: {}", group.name, names.join(", "))
    });
    let names: Vec<String> = names.collect();
    Failure::usage(format!("no case has `{only}` in its name"), names.join("\n"))
}
