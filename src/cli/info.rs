//! `insonify info`: contents of a label file, a folder of masks or surfaces, a tracked sequence or a PLUS
//! configuration.

use std::path::PathBuf;

use clap::Args;
use insonify_anatomy::segmentation;
use insonify_anatomy::volume::format_names;
use insonify_tracking::plus::PlusInfo;
use insonify_tracking::sequence::SequenceInfo;

use super::input::NamesArg;
use super::terminal;
use insonify::Error;

/// Describes a label file, a folder of masks or surfaces, a tracked sequence or a PLUS configuration
///
/// Size, spacing, orientation, and the labels of a file: names, voxels, millilitres, and the assigned tissue of each
/// with the evidence (`?` for a guess); of a tracked sequence frames, images, rate, and transforms with their validity;
/// of a PLUS configuration (.xml) probe, images, calibration and coordinate definitions.
#[derive(Args)]
pub(crate) struct Info {
    #[arg(value_name = "FILE", help = format!("Label file ({}), a folder of binary masks or closed surfaces named by their files, or a \
        tracked sequence or configuration (.xml) of PLUS", format_names("or")))]
    file: PathBuf,
    #[command(flatten)]
    names: NamesArg,
    /// Print JSON: `size`, `spacing_mm`, `orientation`, `origin_mm`, `labels`, `notes`, `warnings`; of a sequence
    /// `bytes`, `frames`, `images`, `time`, `transforms`, `warnings`; of a configuration `transducer`, `probe`,
    /// `image_size`, `pixel_mm`, `array_centre_px`, `calibration`, `transforms`, `warnings`
    #[arg(long)]
    json: bool,
}

impl Info {
    pub(crate) fn run(&self) -> Result<(), Error> {
        if let Some(info) = SequenceInfo::of(&self.file) {
            return terminal::print(&info, self.json);
        }
        if self
            .file
            .extension()
            .is_some_and(|ending| ending.eq_ignore_ascii_case("xml"))
        {
            return terminal::print(&PlusInfo::read(&self.file)?, self.json);
        }
        let opened = segmentation::open(&self.file, &self.names.naming()?)?;
        terminal::print(&segmentation::SegmentationInfo::new(&opened, &self.file), self.json)
    }
}
