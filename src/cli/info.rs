//! `insonify info`: what a label file holds.

use std::path::PathBuf;

use clap::Args;
use insonify::volume::{describe, load};

use super::failure::Failure;
use super::terminal;

/// Prints size, spacing, orientation, and the labels of a file with names, voxels and millilitres
#[derive(Args)]
pub struct Info {
    /// Label file: NIfTI, NRRD or MetaImage
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Print JSON: `size`, `spacing_mm`, `orientation`, `origin_mm`, `labels`, `warnings`
    #[arg(long)]
    json: bool,
}

impl Info {
    pub fn run(&self) -> Result<(), Failure> {
        let loaded = load(&self.file)?;
        let info = describe(&loaded.volume, &self.file, &loaded.warnings);
        if self.json {
            terminal::emit_json(&info)
        } else {
            terminal::emit(&info.to_string())
        }
    }
}
