//! Output of study results: text or JSON to standard output, files into a folder.

use std::path::PathBuf;

use clap::Args;
use insonify_base::output::folder::Folder;
use insonify_base::stage::{self, Extent};
use insonify_study::tradeoff::Study;

use super::output::Force;
use super::terminal;
use insonify::Error;

/// Output options of a study.
#[derive(Args)]
pub(crate) struct Printed {
    /// Folder for index.html, tables (CSV, JSON) and plots (PNG, SVG); created if missing
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print one JSON object to standard output
    #[arg(long)]
    json: bool,
}

/// Progress callback of a study: current task and completed fraction.
pub(crate) type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

/// Shows a progress bar while `run` is running.
pub(crate) fn watched<T>(run: impl FnOnce(Progress<'_>) -> T) -> T {
    let stage = stage::enter("preparing", Extent::Share(0.0));
    run(&mut |what, share| {
        stage.rename(what);
        stage.share(share);
    })
}

impl Printed {
    /// Creates the options for a command that has its own arguments for them.
    pub(crate) fn new(output: Option<PathBuf>, force: Force, json: bool) -> Self {
        Self { output, force, json }
    }

    /// Checks that the folder can be written to, before the study is prepared.
    pub(crate) fn check(&self) -> Result<(), Error> {
        self.folder().map(drop)
    }

    fn folder(&self) -> Result<Option<Folder>, Error> {
        self.force.requested_folder(&self.output, "study", &["index.html"], &[])
    }

    /// Creates the folder, runs the study with a progress bar, and writes and prints the results.
    pub(crate) fn run(&self, study: impl FnOnce(Progress<'_>) -> Result<Study, Error>) -> Result<(), Error> {
        let folder = self.folder()?;
        let study = watched(study)?;
        if let (Some(folder), Some(target)) = (folder, &self.output) {
            let files = study.write(folder.path())?;
            folder.install()?;
            terminal::say(format_args!("{}: {}", target.display(), files.join(", ")));
        }
        terminal::show(&study.json(), self.json, || study.text())
    }
}
