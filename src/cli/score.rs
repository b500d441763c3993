//! `insonify score`: metrics of insertions and comparison of groups.

use std::path::PathBuf;

use clap::Args;

use insonify_study::score::groups::{compare, read};
use insonify_study::score::page::picture;
use insonify_study::score::{Score, groups};

use super::failure::{Error, usage};
use super::output::{self, Force};
use super::terminal;

const TEACHING: &str = "\
RUN is the folder that `insonify insert` wrote, or its steps.csv. The scenario needs a target: `needle.target`, or `[[plan.target]]`. The metrics
are means over the time in which the needle is in the body; docs/metrics.md defines them. With --images at the insertion, the page shows the
image at the closest approach.

--groups compares people: a table with the columns group,person,session,m1,...,m10, such as `insonify exercise study` writes. Welch's t and
Mann-Whitney U tests, two-sided, over sessions and over the means of people, and Holm's correction for the ten metrics.

Examples:
  insonify insert task-1.toml -o run --images
  insonify score run -o score.html
  insonify score run-a run-b --json | jq '.[].m10'
  insonify score --groups sessions.csv -o groups.html";

/// Scores insertions by ten metrics, or compares groups of people by their scores
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct ScoreArgs {
    /// Folder of a run, or its table of steps
    #[arg(value_name = "RUN", required_unless_present = "groups")]
    runs: Vec<PathBuf>,
    /// Compare groups: a table of sessions
    #[arg(long, value_name = "SESSIONS.csv", conflicts_with = "runs")]
    groups: Option<PathBuf>,
    /// Write a page with tables and plots (for a single run only)
    #[arg(short, long, value_name = "PAGE.html")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print JSON: an object, of several runs a list of objects
    #[arg(long)]
    json: bool,
}

impl ScoreArgs {
    pub(crate) fn run(&self) -> Result<(), Error> {
        if let Some(output) = &self.output {
            let tables = self.runs.iter().map(|run| run.join("steps.csv"));
            let inputs: Vec<PathBuf> = self.runs.iter().chain(&self.groups).cloned().chain(tables).collect();
            self.force.check_ending([output], "html", "pages", &inputs)?;
            if self.runs.len() > 1 {
                return Err(usage(
                    "a page of several runs",
                    "score one run, or compare them with --groups",
                ));
            }
        }
        if let Some(groups) = &self.groups {
            return self.compare(&read(groups)?);
        }
        let scores: Vec<Score> = self.runs.iter().map(|run| Score::of(run)).collect::<Result<_, _>>()?;
        if let (Some(output), [score]) = (&self.output, &scores[..]) {
            let shown = picture(&score.run, score.nearest_s, score.end_s);
            if shown.is_none() {
                terminal::note("the page has no image: the run was made without --images");
            }
            output::text(output, &score.page(shown.as_ref())?)?;
        }
        match (&scores[..], self.json) {
            ([score], true) => terminal::emit_json(score),
            (_, true) => terminal::emit_json(&scores),
            _ => terminal::emit(&scores.iter().map(Score::to_string).collect::<Vec<_>>().join("\n")),
        }
    }

    fn compare(&self, sessions: &[groups::Session]) -> Result<(), Error> {
        let comparison = compare(sessions);
        output::requested(&self.output, || comparison.page("Comparison of groups", &[]))?;
        terminal::print(&comparison, self.json)
    }
}
