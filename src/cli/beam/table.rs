//! `insonify beam table`: Table I of Wang et al. 2023.

use crate::study::beam::table_one;
use clap::Args;

use crate::cli::failure::Failure;
use crate::cli::study::Printed;

const SOURCE: &str = "Source: Y. Wang et al., \"Flexible Needle Bending Model for Spinal Injection Procedures\", IEEE Robotics and Automation\n\
Letters 8 (2023) 1343-1350.";

/// Prints Table I of Wang et al. 2023 (centres of motion) beside the values computed by this program
#[derive(Args)]
#[command(after_help = SOURCE)]
pub struct Table {
    #[command(flatten)]
    printed: Printed,
}

impl Table {
    pub fn run(&self) -> Result<(), Failure> {
        self.printed.run(|_| Ok(table_one()?))
    }
}
