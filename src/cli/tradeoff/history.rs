//! `insonify tradeoff history`: quadrature rules for fading memory.

use clap::Args;
use insonify_study::tradeoff::history::{HistoryOptions, study};

use crate::failure::{Error, usage};
use crate::study::Printed;
use crate::variants::ranged;

const EXAMPLES: &str = "\
Examples:
  insonify tradeoff history --quick                             a first look, in a second
  insonify tradeoff history -o study                            histories of 100 to 100,000 steps, with plots
  insonify tradeoff history --order 0.5 --steps 1000,5000 --json

A row with a star is a best choice: no other is both faster and nearer to the exact law. A row that violates the
guarantee of its rule is marked WRONG.";

/// Quadrature rules for fading memory: error against the exact law, time and memory, for each rule and length of
/// history
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct History {
    /// Order k of the fractional integral, 0 to 1
    #[arg(long, value_name = "K", default_value_t = HistoryOptions::default().order, value_parser = order)]
    order: f64,
    /// Steps of the histories [default: 100,1000,10000,100000; with --quick 100,1000]
    #[arg(long, value_name = "N,...", value_delimiter = ',', value_parser = step_count)]
    steps: Vec<usize>,
    /// Short histories
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    printed: Printed,
}

impl History {
    pub(super) fn run(&self) -> Result<(), Error> {
        let options = self.options();
        self.printed.run(|progress| {
            study(&options, progress).map_err(|error| usage(error.to_string(), "ask for another --order"))
        })
    }

    fn options(&self) -> HistoryOptions {
        let steps = match self.steps.is_empty() {
            false => self.steps.clone(),
            true => HistoryOptions::of(super::effort(self.quick)).steps,
        };
        HistoryOptions {
            order: self.order,
            steps,
        }
    }
}

fn order(text: &str) -> Result<f64, String> {
    ranged(text, 0.0..=1.0, "a number from 0 (a spring) to 1 (a dashpot)")
}

fn step_count(text: &str) -> Result<usize, String> {
    ranged(text, 10..=1_000_000, "a number of steps from 10 to 1000000")
}
