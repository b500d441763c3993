//! `insonify tradeoff tissue`: schemes and models for stiffening and viscoelastic tissue.

use clap::Args;
use insonify_study::tradeoff::tissue::{TissueOptions, study};

use crate::study::Printed;
use insonify::Error;

const EXAMPLES: &str = "\
Examples:
  insonify tradeoff tissue --quick           a first look, in seconds
  insonify tradeoff tissue -o study          a block of 1,000 nodes, with plots: half a minute
  insonify tradeoff tissue --whole -o study  3,300 nodes and twice the steps: minutes
  insonify tradeoff tissue --stiffening 60 --json

A row with a star is a best choice among those with as many steps: no other is both faster and nearer to the truth.";

/// Stiffening and viscoelastic tissue: time against error, for Euler, modified and full Newton, and for each model
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Tissue {
    /// Nodes of the block [default: 1000; with --quick 300, with --whole 3300]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(27..=200_000))]
    nodes: Option<u32>,
    /// Largest number of steps until the plate is down, doubled from 5 on [default: 20; with --quick 10, with
    /// --whole 40]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(5..=1000))]
    steps: Option<u32>,
    /// Young's modulus below the knee, kPa
    #[arg(long, value_name = "KPA", default_value_t = TissueOptions::default().young_kpa, allow_negative_numbers = true)]
    young_kpa: f64,
    /// Poisson's ratio, above -1 and below 0.5
    #[arg(long, value_name = "NU", default_value_t = TissueOptions::default().poisson, allow_negative_numbers = true)]
    poisson: f64,
    /// Relative strain above which tissue stiffens
    #[arg(long, value_name = "E", default_value_t = TissueOptions::default().knee_strain, allow_negative_numbers = true)]
    knee_strain: f64,
    /// Stiffening coefficient a in E0 (1 + a (e - knee)^2)
    #[arg(long, value_name = "A", default_value_t = TissueOptions::default().stiffening, allow_negative_numbers = true)]
    stiffening: f64,
    /// Order of the viscosity, 0 to 1
    #[arg(long, value_name = "K", default_value_t = TissueOptions::default().order, allow_negative_numbers = true)]
    order: f64,
    /// A small block and few steps
    #[arg(long)]
    quick: bool,
    /// A block of the size in Kobayashi et al. 2010 and enough steps for errors to level off
    #[arg(long, conflicts_with = "quick")]
    whole: bool,
    #[command(flatten)]
    printed: Printed,
}

impl Tissue {
    pub(super) fn run(&self) -> Result<(), Error> {
        let usual = match self.whole {
            true => TissueOptions::full(),
            false => TissueOptions::of(super::effort(self.quick)),
        };
        let options = TissueOptions {
            nodes: self.nodes.map_or(usual.nodes, |nodes| nodes as usize),
            steps: [usual.steps[0], self.steps.unwrap_or(usual.steps[1])],
            young_kpa: self.young_kpa,
            poisson: self.poisson,
            knee_strain: self.knee_strain,
            stiffening: self.stiffening,
            order: self.order,
            ..usual
        };
        self.printed.run(|progress| Ok(study(&options, progress)?))
    }
}
