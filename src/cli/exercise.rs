//! `insonify exercise`: training tasks, and a study with simulated hands.

use std::path::{Component, Path, PathBuf};

use clap::Args;

use insonify::input::scenario::{self, ScenarioFile};
use insonify_base::document;
use insonify_base::range::numbers;
use insonify_study::score::exercise::{Conditions, csv, study};
use insonify_study::score::page::study_notes;

use super::failure::{Error, usage};
use super::insert::resolve;
use super::output::{self, Force, inputs};
use super::terminal;

const EXAMPLES: &str = "\
Examples:
  insonify exercise make liver-biopsy --organ liver --tasks 3 -o tasks     three random targets in the liver, a scenario each
  insonify insert tasks/task-1.toml -o run --images                        the reference run of the first
  insonify insert tasks/task-1.toml --hand student --hand-seed 7 -o run    the same task by a simulated student
  insonify score run                                                       its metrics
  insonify exercise study tasks/task-*.toml --people 8 -o study            three groups of eight on all tasks, compared";

/// Generates training tasks, and simulates operators of different skill performing them
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Exercise {
    #[command(subcommand)]
    command: Command,
}

commands! {
    enum Command {
        Make(Make),
        Study(Study),
    }
}

impl Exercise {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.command.run()
    }
}

/// Makes training tasks: scenarios with random reachable targets in an organ, each with its reference run
#[derive(Args)]
struct Make {
    /// Scenario that the tasks are made from, with an inline scene: a file, or the name of a built-in one. Its needle
    /// enters in the middle of the entry window; its speed and pause are those of the reference runs
    #[arg(value_name = "SCENARIO.toml")]
    scenario: PathBuf,
    /// Organ of the targets: a label or tissue, or a part of its name
    #[arg(long, value_name = "NAME")]
    organ: String,
    /// Number of tasks
    #[arg(long, value_name = "N", default_value = "3", value_parser = clap::value_parser!(u16).range(1..=1000))]
    tasks: u16,
    /// Least and largest depth of the targets along the needle, mm
    #[arg(long, value_name = "MIN,MAX", default_value = "40,140", value_parser = numbers::<2>)]
    depth_mm: [f64; 2],
    /// Least distance of the paths from bone and critical structures, mm
    #[arg(long, value_name = "MM", default_value_t = 5.0)]
    clearance_mm: f64,
    /// Radius of the entry window, mm
    #[arg(long, value_name = "MM", default_value_t = 20.0)]
    window_mm: f64,
    /// Least distance of the targets from the border of the organ, mm
    #[arg(long, value_name = "MM", default_value_t = 10.0)]
    margin_mm: f64,
    /// Radius of the targets, mm
    #[arg(long, value_name = "MM", default_value_t = 5.0)]
    radius_mm: f64,
    /// Seed of the random targets
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Folder for task-1.toml, task-2.toml, ...
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    /// Print JSON: the tasks
    #[arg(long)]
    json: bool,
}

impl Make {
    fn run(&self) -> Result<(), Error> {
        let folder = self
            .force
            .folder(&self.output, "exercise", &["task-"], &inputs(&self.scenario))?;
        let conditions = Conditions {
            organ: self.organ.clone(),
            depth_mm: self.depth_mm,
            clearance_mm: self.clearance_mm,
            window_mm: self.window_mm,
            margin_mm: self.margin_mm,
            radius_mm: self.radius_mm,
            seed: self.seed,
        };
        conditions.check()?;
        let (text, base) = source(&self.scenario)?;
        let file = ScenarioFile::parse(&text, &self.scenario.display().to_string())?;
        let scenario = resolve(&file, &base)?;
        let tasks = conditions.tasks(&scenario, usize::from(self.tasks))?;
        for (index, task) in tasks.iter().enumerate() {
            // File names in a scenario start at its own folder, and the tasks lie in another.
            let text = task
                .scenario(&text, &conditions, index + 1)
                .and_then(|text| relocated(&text, &base, &self.output));
            let text = text.map_err(|error| {
                let expected = "a scenario whose scene is a table: `insonify insert --example liver-biopsy`";
                usage(format!("{}: {error}", self.scenario.display()), expected)
            })?;
            output::text(&folder.path().join(format!("task-{}.toml", index + 1)), &text)?;
        }
        folder.install()?;
        if self.json {
            return terminal::emit_json(&tasks);
        }
        let lines = tasks.iter().enumerate().map(|(index, task)| {
            let [x, y, z] = task.target_mm;
            let file = self.output.join(format!("task-{}.toml", index + 1));
            format!(
                "{}: target ({x:.1}, {y:.1}, {z:.1}) mm, {:.0} mm deep",
                file.display(),
                task.depth_mm
            )
        });
        terminal::emit(&lines.collect::<Vec<_>>().join("\n"))
    }
}

/// A scenario with the files that it names relative to `base` named relative to `folder`; its leading comment stays.
pub(super) fn relocated(text: &str, base: &Path, folder: &Path) -> Result<String, String> {
    let comment: String = text
        .lines()
        .take_while(|line| line.starts_with('#'))
        .map(|line| format!("{line}\n"))
        .collect();
    let mut value: toml::Value = text.parse::<toml::Table>().map_err(|error| error.to_string())?.into();
    relocate(&mut value, base, folder);
    let text = toml::to_string(&value).map_err(|error| error.to_string())?;
    Ok(format!("{comment}\n{text}"))
}

fn relocate(value: &mut toml::Value, base: &Path, folder: &Path) {
    match value {
        toml::Value::Table(table) => table.iter_mut().for_each(|(_, value)| relocate(value, base, folder)),
        toml::Value::Array(array) => array.iter_mut().for_each(|value| relocate(value, base, folder)),
        toml::Value::String(name)
            if !name.is_empty() && base.join(&name).exists() && Path::new(&name).is_relative() =>
        {
            if let Some(moved) = relative(&base.join(&name), folder) {
                *name = moved;
            }
        }
        _ => {}
    }
}

/// Path of an existing file as seen from a folder.
fn relative(file: &Path, folder: &Path) -> Option<String> {
    let file = std::path::absolute(file).ok()?;
    let folder = std::path::absolute(folder).ok()?;
    let shared = file
        .components()
        .zip(folder.components())
        .take_while(|(a, b)| a == b)
        .count();
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    let path: PathBuf = up.chain(file.components().skip(shared)).collect();
    path.to_str().map(str::to_owned)
}

/// Text of a scenario and the folder of the files that it names.
pub(super) fn source(path: &Path) -> Result<(String, PathBuf), Error> {
    if let Some((_, text)) = scenario::bundled(path) {
        return Ok((text.to_owned(), PathBuf::new()));
    }
    let text = document::read(path)?;
    Ok((text, path.parent().unwrap_or(Path::new("")).to_owned()))
}

/// Lets simulated consultants, registrars and students perform tasks, and compares the groups
#[derive(Args)]
struct Study {
    /// Tasks: scenarios with a target
    #[arg(value_name = "TASK.toml", required = true)]
    tasks: Vec<PathBuf>,
    /// Number of people in each group
    #[arg(long, value_name = "N", default_value = "8", value_parser = clap::value_parser!(u16).range(2..=1000))]
    people: u16,
    /// Seed of the hands
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Folder for sessions.csv and index.html
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    /// Print JSON: `groups` and `pairs`
    #[arg(long)]
    json: bool,
}

impl Study {
    fn run(&self) -> Result<(), Error> {
        let read: Vec<PathBuf> = self.tasks.iter().flat_map(|task| inputs(task)).collect();
        let folder = self
            .force
            .folder(&self.output, "study", &["sessions.csv", "index.html"], &read)?;
        let mut tasks = Vec::new();
        for path in &self.tasks {
            let scenario = resolve(&ScenarioFile::read(path)?, path.parent().unwrap_or(Path::new("")))?;
            let name = path
                .file_stem()
                .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
            tasks.push((name.replace([',', '"', '\n'], " "), scenario));
        }
        let outcome = terminal::with_share("sessions", |share| {
            study(&tasks, usize::from(self.people), self.seed, &|done, count| {
                share(done as f64 / count.max(1) as f64);
            })
        })?;
        let notes = study_notes(tasks.len(), usize::from(self.people), self.seed);
        output::text(&folder.path().join("sessions.csv"), &csv(&outcome.sessions))?;
        let page = outcome.comparison.page("Study with simulated hands", &notes)?;
        output::text(&folder.path().join("index.html"), &page)?;
        folder.install()?;
        terminal::show(&outcome, self.json, || outcome.comparison.to_string())
    }
}
