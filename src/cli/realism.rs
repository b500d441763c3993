//! `insonify realism`: statistics of synthetic frames compared with real frames.

use std::path::PathBuf;

use clap::Args;
use insonify_study::realism::{compare, picture};

use super::output::{self, Force};
use super::terminal;
use super::variants::ranged;
use insonify::Error;

const TEACHING: &str = "\
The same measures on both sides, each frame by itself: texture of the most uniform windows and of the darkest ones, grey levels of the
sector, contact below the array, the far edge of a dark region, and of sequences the correlation from frame to frame. Everything is found
from the frame alone: the sector is the largest region in which grey levels vary, without coloured overlays; of RGB files the luminance
counts. Depth runs down the picture. Crop pictures with more than one sector.

  difference  mean of the frames less that of the real ones, in standard deviations of the real ones
  verdict     inside up to 2 standard deviations, else outside; none with fewer than three real frames

Frames are compared by organ or view, without a verdict over all. A group is a sub-folder of the folder given (one of several folders given,
too), else the files whose names differ only in the number at the end: liver_01.png, liver_02.png. Groups of the same name are compared; if
there are none, frames that are each a group of their own are taken as one, and a side with a single group is compared with each. What is
left out is told.

Frames are PNG, JPEG and DICOM files, folders of them, and image sequences. Millimetres come from the sidecar (`render --sidecar`) beside a
picture, from the calibrated regions of a DICOM file and from sequences that state them; else from the options.

Examples:
  insonify realism frame.png --against real/ --real-mm-per-pixel 0.3
  insonify realism frames/ --against Prostate10_video.igs.mhd -o realism.html
  insonify realism frame.png --against a1.png a2.png a3.png --json | jq '.measures[] | select(.verdict == \"outside\") | .name'
  insonify realism ours/ --against real/ --json | jq '.groups[] | [.group, (.measures | map(select(.verdict == \"outside\")) | length)]'

docs/realism.md lists the measures of frames of this program. Exit status: 0 measured, whatever the verdicts; 2 wrong arguments or files.";

/// Compares frames with real frames: speckle, grey levels, fluid, contact and edges
///
/// Differences are in units of the spread among the real frames.
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct Realism {
    /// Frames: PNG, JPEG or DICOM files, folders of them, or image sequences (.mha, .mhd, .nrrd)
    #[arg(value_name = "FRAMES", required = true)]
    files: Vec<PathBuf>,
    /// Real frames, of the same formats
    #[arg(long, value_name = "REAL", required = true, num_args = 1..)]
    against: Vec<PathBuf>,
    /// Number of evenly spaced frames to take from an image sequence
    #[arg(long, value_name = "N", default_value = "5", value_parser = clap::value_parser!(u16).range(1..))]
    frames: u16,
    /// Pixel size of frames that do not state it
    #[arg(long, value_name = "MM", value_parser = pixel)]
    mm_per_pixel: Option<f64>,
    /// Pixel size of real frames that do not state it
    #[arg(long, value_name = "MM", value_parser = pixel)]
    real_mm_per_pixel: Option<f64>,
    /// Write a page with the table, plots and a picture of each side
    #[arg(short, long, value_name = "PAGE.html")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print JSON, including the measures of every frame; several groups are the list `groups`
    #[arg(long)]
    json: bool,
}

impl Realism {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let inputs = [&self.files[..], &self.against].concat();
        self.force.check_ending(&self.output, "html", "pages", &inputs)?;
        let read = |files, mm| picture::read(files, usize::from(self.frames), mm);
        let frames = read(&self.files, self.mm_per_pixel)?;
        let real = read(&self.against, self.real_mm_per_pixel)?;
        let report = compare(&frames, &real)?;
        output::requested(&self.output, || report.page(&frames, &real))?;
        terminal::print(&report, self.json)
    }
}

/// Parses a pixel size, mm.
pub(super) fn pixel(text: &str) -> Result<f64, String> {
    ranged(text, picture::PIXEL_MM, "0.001 to 10 mm")
}
