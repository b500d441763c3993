//! `insonify tradeoff planning`: tissue of plans, meshes of identifications.

use clap::Args;
use insonify_study::tradeoff::planning::study;

use crate::study::Printed;
use insonify::Error;

const EXAMPLES: &str = "\
Examples:
  insonify tradeoff planning --quick       coarse meshes
  insonify tradeoff planning -o study      meshes of up to 2000 nodes, with plots

A row with a star is a best choice: no other is both faster and nearer to the truth.";

/// Paths planned in two and in three dimensions, and moduli identified with several meshes
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Planning {
    /// Coarse meshes
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    printed: Printed,
}

impl Planning {
    pub(super) fn run(&self) -> Result<(), Error> {
        self.printed
            .run(|progress| Ok(study(super::effort(self.quick), progress)?))
    }
}
