//! `insonify mesh`: tetrahedral meshes.

mod make;

use clap::{Args, Subcommand};

use super::failure::Failure;

/// Makes tetrahedral meshes
#[derive(Args)]
pub struct Mesh {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Make(Box<make::Make>),
}

impl Mesh {
    pub fn run(&self) -> Result<(), Failure> {
        match &self.command {
            Command::Make(make) => make.run(),
        }
    }
}
