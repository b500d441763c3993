//! `insonify phantom`: labelled volumes made from code.

use std::path::PathBuf;

use clap::Args;
use insonify::phantom::{PhantomOptions, make};
use insonify::segmentation::{Info, Segmentation};
use insonify::volume::save;

use super::failure::Failure;
use super::output::Force;
use super::terminal;

/// Makes a labelled volume from code and writes it
#[derive(Args)]
pub struct Phantom {
    /// Which
    #[arg(value_name = "NAME", value_enum)]
    name: insonify::phantom::Phantom,
    /// File to write: .nii, .nii.gz, .nrrd, .seg.nrrd or .mha
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    #[command(flatten)]
    force: Force,
    /// Edge of a voxel, mm (0.3 to 5); the phantom's own by default
    #[arg(long, value_name = "MM")]
    resolution_mm: Option<f64>,
    /// Seed of all that is uneven
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
}

impl Phantom {
    pub fn run(&self) -> Result<(), Failure> {
        self.force.check(&[&self.output], &[])?;
        let options = PhantomOptions {
            resolution_mm: self.resolution_mm,
            seed: self.seed,
        };
        let volume = make(self.name, &options)?;
        save(&volume, &self.output)?;
        terminal::emit(&Info::new(&Segmentation::from(volume), &self.output).to_string())
    }
}
