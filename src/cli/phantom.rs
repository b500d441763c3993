//! `insonify phantom`: labelled volumes generated from code.

use std::path::PathBuf;

use clap::Args;
use insonify_anatomy::phantom::{PhantomOptions, make};
use insonify_anatomy::segmentation::{Segmentation, SegmentationInfo};
use insonify_anatomy::volume::save;

use super::output::Force;
use super::terminal;
use super::variants::variants;
use insonify::Error;

/// Generates a labelled volume and writes it
#[derive(Args)]
pub(crate) struct Phantom {
    /// Name of the phantom
    #[arg(value_name = "NAME", value_parser = variants::<insonify_anatomy::phantom::Phantom>())]
    name: insonify_anatomy::phantom::Phantom,
    /// File to write: .nii, .nii.gz, .nrrd, .seg.nrrd or .mha
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    /// Voxel edge, mm (0.3 to 5); by default the phantom's own
    #[arg(long, value_name = "MM")]
    resolution_mm: Option<f64>,
    /// Seed of all irregularity
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

impl Phantom {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.force.check(&[&self.output], &[])?;
        let options = PhantomOptions {
            resolution_mm: self.resolution_mm,
            seed: self.seed,
        };
        let volume = make(self.name, &options)?;
        save(&volume, &self.output)?;
        terminal::emit(&SegmentationInfo::new(&Segmentation::from(volume), &self.output).to_string())
    }
}
