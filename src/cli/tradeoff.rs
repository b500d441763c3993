//! `insonify tradeoff`: what accuracy costs in time, measured here and now.

mod beam;
mod history;
mod image;
mod insertion;
mod remesh;
mod tissue;

use clap::{Args, Subcommand};

use super::failure::Failure;

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
    Image(image::Image),
}

impl Tradeoff {
    pub fn run(&self) -> Result<(), Failure> {
        match &self.study {
            Study::Insertion(insertion) => insertion.run(),
            Study::Beam(beam) => beam.run(),
            Study::Remesh(remesh) => remesh.run(),
            Study::History(history) => history.run(),
            Study::Tissue(tissue) => tissue.run(),
            Study::Image(image) => image.run(),
        }
    }
}
