//! `insonify tradeoff insertion`: options of needle insertions.

use clap::Args;
use insonify_study::tradeoff::insertion::{InsertionOptions, Part, study};

use crate::study::Printed;
use crate::variants::variants;
use insonify::Error;

const EXAMPLES: &str = "\
Examples:
  insonify tradeoff insertion --quick                   a first look, in seconds
  insonify tradeoff insertion -o study                  everything, with plots: minutes
  insonify tradeoff insertion --only levels,links -o study
  insonify tradeoff insertion --nodes 1000 --depth-mm 40 --json

Each step is calculated several times over, the models in turn; its time is the least of these. A row with a star in a plot is
a best choice; one that violates its guarantee is marked WRONG.";

/// Needle insertions: levels of remeshing, nodes of the mesh, bevels, masses and springs, candidates of the probe, links and elements of the needle
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Insertion {
    /// What to compare [default: everything]
    #[arg(long, value_name = "PART,...", value_delimiter = ',', value_parser = variants::<Part>())]
    only: Vec<Part>,
    /// Nodes of the block of tissue [default: 3300; with --quick 500]
    #[arg(long, value_name = "N", value_parser = super::remesh::node_count)]
    nodes: Option<usize>,
    /// Insertion depth, mm [default: 60; with --quick 20]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    depth_mm: Option<f64>,
    /// Insertion depth of bevelled needles in the block of PVC, mm [default: 140; with --quick 60]
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    bevel_depth_mm: Option<f64>,
    /// Number of repeated calculations of each step for timing [default: 3; with --quick 1]
    #[arg(long, value_name = "N")]
    passes: Option<usize>,
    /// A small block and short paths
    #[arg(long)]
    quick: bool,
    #[command(flatten)]
    printed: Printed,
}

impl Insertion {
    pub(super) fn run(&self) -> Result<(), Error> {
        let options = self.options();
        self.printed.run(|progress| Ok(study(&options, progress)?))
    }

    fn options(&self) -> InsertionOptions {
        let usual = InsertionOptions::of(super::effort(self.quick));
        InsertionOptions {
            nodes: self.nodes.unwrap_or(usual.nodes),
            depth_mm: self.depth_mm.unwrap_or(usual.depth_mm),
            bevel_depth_mm: self.bevel_depth_mm.unwrap_or(usual.bevel_depth_mm),
            bevel_sweep: usual.bevel_sweep,
            passes: self.passes.unwrap_or(usual.passes),
            parts: match self.only.is_empty() {
                true => usual.parts,
                false => self.only.clone(),
            },
        }
    }
}
