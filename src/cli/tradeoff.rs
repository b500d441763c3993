//! `insonify tradeoff`: what accuracy costs in time, measured here and now.

mod remesh;

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
    Remesh(remesh::Remesh),
}

impl Tradeoff {
    pub fn run(&self) -> Result<(), Failure> {
        match &self.study {
            Study::Remesh(remesh) => remesh.run(),
        }
    }
}
