//! `insonify beam table`: the paper's Table I.

use std::path::PathBuf;

use clap::Args;
use insonify::study::beam::table_one;

use crate::cli::failure::Failure;
use crate::cli::study;

/// Prints Table I of the paper (centres of motion) beside this program's values
#[derive(Args)]
pub struct Table {
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Folder for the table (CSV, JSON) and its plot (PNG, SVG); made if it is not there
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

impl Table {
    pub fn run(&self) -> Result<(), Failure> {
        study::prepare(self.output.as_deref())?;
        study::show(&table_one()?, self.output.as_deref(), self.json, false)
    }
}
