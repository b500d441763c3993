//! `insonify tradeoff`: what accuracy costs in time, measured here and now.

mod beam;
mod history;
mod insertion;
mod remesh;
mod tissue;

use std::path::PathBuf;

use clap::{Args, Subcommand};
use insonify::study::tradeoff;

use super::failure::Failure;
use super::terminal;

/// Measures what accuracy costs in time: tables, plots, and the best choices marked
#[derive(Args)]
pub struct Tradeoff {
    #[command(subcommand)]
    study: Study,
}

#[derive(Subcommand)]
enum Study {
    Insertion(insertion::Insertion),
    Beam(beam::Beam),
    Remesh(remesh::Remesh),
    History(history::History),
    Tissue(tissue::Tissue),
}

impl Tradeoff {
    pub fn run(&self) -> Result<(), Failure> {
        match &self.study {
            Study::Insertion(insertion) => insertion.run(),
            Study::Beam(beam) => beam.run(),
            Study::Remesh(remesh) => remesh.run(),
            Study::History(history) => history.run(),
            Study::Tissue(tissue) => tissue.run(),
        }
    }
}

/// Where a study goes to.
#[derive(Args)]
struct Printed {
    /// Folder for tables (CSV, JSON) and plots (PNG, SVG); made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Print one JSON object to standard output
    #[arg(long)]
    json: bool,
    /// Say nothing but results, warnings and errors
    #[arg(short, long)]
    quiet: bool,
}

/// Is told what a study does, and the share that is done.
type Progress<'a> = &'a mut (dyn FnMut(&str, f64) + Send);

impl Printed {
    /// Makes the folder, shows how far `study` is, writes and prints what it found.
    fn run(&self, study: impl FnOnce(Progress<'_>) -> Result<tradeoff::Study, Failure>) -> Result<(), Failure> {
        if let Some(folder) = &self.output {
            std::fs::create_dir_all(folder).map_err(|cause| Failure::Folder {
                path: folder.clone(),
                cause,
            })?;
        }
        let bar = terminal::share(self.quiet);
        let study = study(&mut |what, share| {
            bar.set_message(what.to_owned());
            bar.set_position((share * terminal::SHARES as f64) as u64);
        });
        bar.finish_and_clear();
        let study = study?;
        if let Some(folder) = &self.output {
            let files = study.write(folder)?;
            if !self.quiet {
                terminal::say(format_args!("{}: {}", folder.display(), files.join(", ")));
            }
        }
        if self.json {
            terminal::emit_json(&study.json())
        } else {
            terminal::emit(&study.text())
        }
    }
}
