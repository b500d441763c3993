//! `insonify tradeoff beam`: options of the needle as a beam in tissue.

use clap::Args;
use insonify_study::tradeoff::beam::study;

use crate::study::Printed;
use insonify::Error;

const EXAMPLES: &str = "\
Examples:
  insonify tradeoff beam                 tables: length of elements, friction, models of tissue
  insonify tradeoff beam -o study        and plots
  insonify tradeoff beam --json

A row with a star is a best choice: no other is both faster and nearer to the truth.";

/// Needle as a beam in tissue: element length, friction, tissue models
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Beam {
    /// No effect: this study takes a fraction of a second
    #[arg(long, hide = true)]
    quick: bool,
    #[command(flatten)]
    printed: Printed,
}

impl Beam {
    pub(super) fn run(&self) -> Result<(), Error> {
        let Self { quick: _, printed } = self;
        printed.run(|_| Ok(study()?))
    }
}
