//! `insonify info`: what a label file, a folder of masks or a tracked sequence holds.

use std::path::PathBuf;

use clap::Args;
use insonify::segmentation;
use insonify::tracking::sequence::SequenceInfo;

use super::failure::Failure;
use super::input::NamesArg;
use super::terminal;

/// Prints size, spacing, orientation, and the labels of a file: names, voxels, millilitres, and the tissue that each is taken
/// for with the evidence (`?` where it is a guess); of a tracked sequence frames, images, rate, and transforms with their validity
#[derive(Args)]
pub struct Info {
    /// Label file (NIfTI, NRRD or MetaImage), a folder of binary masks named by their files, or a tracked sequence of PLUS
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    names: NamesArg,
    /// Print JSON: `size`, `spacing_mm`, `orientation`, `origin_mm`, `labels`, `notes`, `warnings`; of a sequence `bytes`, `frames`,
    /// `images`, `time`, `transforms`, `warnings`
    #[arg(long)]
    json: bool,
}

impl Info {
    pub fn run(&self) -> Result<(), Failure> {
        if let Some(info) = SequenceInfo::of(&self.file) {
            return if self.json {
                terminal::emit_json(&info)
            } else {
                terminal::emit(&info.to_string())
            };
        }
        let opened = segmentation::open(&self.file, &self.names.naming()?)?;
        let info = segmentation::Info::new(&opened, &self.file);
        if self.json {
            terminal::emit_json(&info)
        } else {
            terminal::emit(&info.to_string())
        }
    }
}
