//! `insonify mesh`: tetrahedral meshes.

mod info;
mod make;

use clap::{Args, Subcommand};

use super::failure::Failure;

/// Makes and inspects tetrahedral meshes
#[derive(Args)]
pub struct Mesh {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Info(info::Info),
    Make(Box<make::Make>),
}

impl Mesh {
    pub fn run(&self) -> Result<(), Failure> {
        match &self.command {
            Command::Info(info) => info.run(),
            Command::Make(make) => make.run(),
        }
    }
}
