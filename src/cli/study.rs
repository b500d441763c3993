//! What commands do with a study that they have made: text or JSON to standard output, files into a folder.

use std::path::PathBuf;

use clap::Args;
use insonify::output::folder::Folder;
use insonify::study::tradeoff::Study;

use super::failure::Failure;
use super::output::Force;
use super::terminal;

/// Where a study goes to.
#[derive(Args)]
pub struct Printed {
    /// Folder for index.html, tables (CSV, JSON) and plots (PNG, SVG); made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print one JSON object to standard output
    #[arg(long)]
    json: bool,
}

/// Is told what a study does, and the share that is done.
pub type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// Shows how far something is while it runs.
pub fn watched<T>(run: impl FnOnce(Progress<'_>) -> T) -> T {
    let bar = terminal::share();
    let result = run(&mut |what, share| {
        bar.set_message(what.to_owned());
        bar.set_position((share * terminal::SHARES as f64) as u64);
    });
    bar.finish_and_clear();
    result
}

impl Printed {
    /// For a command that has arguments of its own for it.
    pub fn new(output: Option<PathBuf>, force: Force, json: bool) -> Self {
        Self { output, force, json }
    }

    /// Looks whether the folder can be written to, before anything is prepared for the study.
    pub fn check(&self) -> Result<(), Failure> {
        self.folder().map(drop)
    }

    fn folder(&self) -> Result<Option<Folder>, Failure> {
        let open = |target: &PathBuf| self.force.folder(target, "study", &["index.html"], &[]);
        self.output.as_ref().map(open).transpose()
    }

    /// Makes the folder, shows how far `study` is, writes and prints what it found.
    pub fn run(&self, study: impl FnOnce(Progress<'_>) -> Result<Study, Failure>) -> Result<(), Failure> {
        let folder = self.folder()?;
        let study = watched(study)?;
        if let (Some(folder), Some(target)) = (folder, &self.output) {
            let files = study.write(folder.path())?;
            folder.install()?;
            terminal::say(format_args!("{}: {}", target.display(), files.join(", ")));
        }
        if self.json {
            terminal::emit_json(&study.json())
        } else {
            terminal::emit(&study.text())
        }
    }
}
