//! `insonify tradeoff`: accuracy versus time, measured on this machine.

mod study;

use std::path::PathBuf;

use clap::Args;
use insonify_study::stability::Effort;
use insonify_study::tradeoff::gather::gather;
use insonify_study::tradeoff::report::Report;
use insonify_study::tradeoff::{Rates, STUDIES, Table};
use study::GivenStudy;

use super::backend::BackendArgs;
use super::failure::{Error, Failure, usage};
use super::output::Force;
use super::study::watched;
use super::terminal;
use super::variants::ranged;

const EXAMPLES: &str = "\
Without a subcommand all studies are run in turn and gathered into one report: the cost of each choice, its error against the
gold standard of its table, and a recommendation.

Examples:
  insonify tradeoff --quick -o report      within two minutes on two cores: open report/index.html
  insonify tradeoff -o report              full-size meshes, full-length paths: within twenty minutes
  insonify tradeoff --only remesh,history -o report
  insonify tradeoff remesh --help          one study, with settings of its own

report/index.html is self-contained; report.md, results.json and results.csv hold the same results in other formats.
Exit status: 0 success; 1 a study failed (the results of the others are written); 2 invalid arguments.";

/// Measures accuracy against time: tables, plots, Pareto-optimal choices marked, and recommendations
#[derive(Args)]
#[command(after_help = EXAMPLES, args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(crate) struct Tradeoff {
    #[command(subcommand)]
    study: Option<GivenStudy>,
    /// Folder for index.html, report.md, results.json, results.csv and plots; created if missing
    #[arg(short, long, value_name = "DIR", default_value = "tradeoff")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    /// Small meshes and short paths: minutes become seconds
    #[arg(long)]
    quick: bool,
    /// Frame rate that the report recommends settings for
    #[arg(long, value_name = "HZ", default_value = "60", value_parser = rate)]
    frames_per_s: f64,
    /// Step rate of the mechanics that the report recommends settings for
    #[arg(long, value_name = "HZ", default_value = "1000", value_parser = rate)]
    steps_per_s: f64,
    /// Run only these studies
    #[arg(long, value_name = "STUDY,...", value_delimiter = ',')]
    only: Vec<String>,
    /// Also print results.json to standard output
    #[arg(long)]
    json: bool,
}

impl Tradeoff {
    pub(crate) fn run(&self) -> Result<(), Error> {
        match &self.study {
            Some(study) => study.run(),
            None => self.gather(),
        }
    }

    fn gather(&self) -> Result<(), Error> {
        let known = || STUDIES.iter().map(|entry| entry.about().name);
        if let Some(unknown) = self
            .only
            .iter()
            .find(|name| known().all(|known| known != name.as_str()))
        {
            let names: Vec<&str> = known().collect();
            return Err(usage(
                format!("there is no study `{unknown}`"),
                format!("studies are {}", names.join(", ")),
            ));
        }
        let wanted = STUDIES.iter().copied();
        let wanted =
            wanted.filter(|entry| self.only.is_empty() || self.only.iter().any(|name| name == entry.about().name));
        let wanted: Vec<_> = wanted.collect();
        let folder = self
            .force
            .folder(&self.output, "tradeoff", &["index.html", "results.json"], &[])?;
        let pace = Rates {
            frames: self.frames_per_s,
            steps: self.steps_per_s,
        };
        let devices = BackendArgs::default().gpus()?;
        let effort = if self.quick { Effort::Quick } else { Effort::Whole };
        let report = watched(|progress| gather(&wanted, &devices, effort, pace, progress));
        let files = report.write(folder.path())?;
        folder.install()?;
        let folder = self.output.display();
        terminal::say(format_args!("{folder}: {}", files.join(", ")));
        terminal::show(&report, self.json, || in_short(&report))?;
        // An error only now: the studies that did succeed took long, and their results are installed.
        match report.missing.first() {
            None => Ok(()),
            Some(missing) => Err(Failure::Unmeasured {
                study: missing.name.to_owned(),
                reason: missing.reason.clone(),
                more: report.missing.len() - 1,
            }
            .into()),
        }
    }
}

/// Parses a rate, 1/s.
fn rate(text: &str) -> Result<f64, String> {
    ranged(text, 0.1..=1e5, "0.1 to 100000 times a second")
}

/// Recommendations and flags, for the terminal.
fn in_short(report: &Report) -> String {
    let mut lines = Vec::new();
    let mut at_pace = report.in_time().peekable();
    if at_pace.peek().is_some() {
        lines.push(format!(
            "For {} frames and {} steps a second",
            report.pace.frames, report.pace.steps
        ));
    }
    lines.extend(at_pace.map(|choice| format!("  {}", choice.sentence())));
    for chapter in &report.chapters {
        let advice = chapter.study.listed().flat_map(Table::advice);
        let advice = advice.map(|advice| format!("  {}: {}", advice.choosing, advice.sentence()));
        let advice: Vec<String> = advice.collect();
        if !advice.is_empty() {
            lines.push(chapter.study.title.to_owned());
            lines.extend(advice);
        }
    }
    lines.extend(report.wrong().map(|(chapter, table, row)| {
        let flag = row.flag.as_deref().unwrap_or_default();
        let (study, choices) = (chapter.study.title, row.choices.join("; "));
        format!("WRONG: {study}, {}: {choices}: {flag}", table.title)
    }));
    lines.push(format!("measured in {:.0} s on {}", report.seconds, report.machine));
    lines.join("\n")
}
