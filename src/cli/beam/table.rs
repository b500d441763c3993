//! `insonify beam table`: the paper's Table I.

use clap::Args;
use insonify::study::beam::table_one;

use crate::cli::failure::Failure;
use crate::cli::study::Printed;

/// Prints Table I of the paper (centres of motion) beside this program's values
#[derive(Args)]
pub struct Table {
    #[command(flatten)]
    printed: Printed,
}

impl Table {
    pub fn run(&self) -> Result<(), Failure> {
        self.printed.run(|_| Ok(table_one()?))
    }
}
