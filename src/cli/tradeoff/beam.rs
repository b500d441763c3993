//! `insonify tradeoff beam`: choices in the needle as a beam in tissue.

use std::path::PathBuf;

use clap::Args;
use insonify::study::tradeoff::beam::study;

use crate::cli::failure::Failure;
use crate::cli::study as shown;

const EXAMPLES: &str = "\
Examples:
  insonify tradeoff beam                 tables: length of elements, friction, models of tissue
  insonify tradeoff beam -o study        and plots
  insonify tradeoff beam --json

A row with a star is a best choice: no other is both faster and nearer to the truth.";

/// The needle as a beam in tissue: length of elements, friction, models of tissue
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct Beam {
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

impl Beam {
    pub fn run(&self) -> Result<(), Failure> {
        shown::prepare(self.output.as_deref())?;
        shown::show(&study()?, self.output.as_deref(), self.json, self.quiet)
    }
}
