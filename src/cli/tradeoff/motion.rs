//! `insonify tradeoff motion`: estimates of motion from radio-frequency echoes.

use clap::Args;
use insonify_study::tradeoff::motion::study;

use crate::study::Printed;
use insonify::Error;

const EXAMPLES: &str = "\
Examples:
  insonify tradeoff motion --quick       a small field, in seconds
  insonify tradeoff motion -o study      178 lines of 75 mm, with plots

A row with a star is a best choice: no other is both faster and nearer to the truth. insonify motion --validate has the
accuracy under shifts, strains and sinusoids, and around a needle.";

/// Motion from echoes: length of windows, upsampling, prior estimates
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Motion {
    /// A small field
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    printed: Printed,
}

impl Motion {
    pub(super) fn run(&self) -> Result<(), Error> {
        self.printed
            .run(|progress| Ok(study(super::effort(self.quick), progress)))
    }
}
