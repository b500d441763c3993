//! `insonify match`: probe and effects estimated from a real frame.

use std::path::PathBuf;

use clap::Args;
use insonify_base::document;
use insonify_imaging::scene::SceneFile;
use insonify_study::matching::fit;
use insonify_study::realism::picture;

use super::failure::{Error, usage};
use super::output::{self, Force};
use super::realism::pixel;
use super::settings::Settings;
use super::terminal;
use super::variants::ranged;

const TEACHING: &str = "\
The sector of the frame gives the probe; the most uniform windows at five depths give point spread, dynamic range and gain, the darkest ones
noise and clutter. A uniform phantom is rendered under that probe and measured in the same way, and parameters are corrected until both agree.
Parameters that the frame does not determine are listed with the reason; in the scene they have their defaults.

The array must be at the top: turn other frames upside down. Crop frames with more than one sector. Depth scales in the picture are not read:
the size of a pixel comes from --mm-per-pixel or --depth-mm, else from the sidecar beside the frame, or from the sequence.

The output is a scene of the abdomen phantom: put your own [volume] and [pose] in, or set their keys with --set. What is set replaces
what was estimated; a dynamic range set so also goes into what else is estimated. It cannot be found where the scanner has smoothed the
speckle: a note says so. Automatic gain is off, the grey curve straight.

Examples:
  insonify match liver.png --depth-mm 160 -o matched.toml --page matched.html
  insonify match liver.png --depth-mm 160 --set 'volume={file=\"labels.nii.gz\"}' --set pose.target=liver -o matched.toml
  insonify render matched.toml -o ours.png
  insonify realism ours.png --against liver.png
  insonify match clip.igs.mha --json | jq '.figures[] | {key, value, spread}'

docs/matching.md says how accurately known settings are recovered. Exit status: 0 matched; 2 wrong arguments or files.";

/// Estimates probe and effects from a real frame, and writes a scene that resembles it
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct Match {
    /// Real frame: a PNG, JPEG or DICOM file, or an image sequence (.mha, .mhd, .nrrd), of which the first frame is used
    #[arg(value_name = "REAL")]
    file: PathBuf,
    /// Side of a pixel
    #[arg(long, value_name = "MM", value_parser = pixel)]
    mm_per_pixel: Option<f64>,
    /// Depth shown by the middle scanline
    #[arg(long, value_name = "MM", value_parser = depth, conflicts_with = "mm_per_pixel")]
    depth_mm: Option<f64>,
    /// Seed of the phantom's speckle
    #[arg(long, value_name = "N", default_value = "0")]
    seed: u64,
    #[command(flatten)]
    settings: Settings,
    /// Write the scene to a file, and print the measures instead of it
    #[arg(short, long, value_name = "FILE.toml")]
    output: Option<PathBuf>,
    /// Write a page with the real and the synthetic frame, histograms and autocorrelations
    #[arg(long, value_name = "PAGE.html")]
    page: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Print JSON, including the scene
    #[arg(long)]
    json: bool,
}

impl Match {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let inputs = [self.file.clone()];
        self.force.check_ending(&self.output, "toml", "scenes", &inputs)?;
        self.force.check_ending(&self.page, "html", "pages", &inputs)?;
        if self.file.is_dir() {
            return Err(usage(
                format!("{} is a folder", self.file.display()),
                "name a single frame: only one frame can be matched",
            ));
        }
        let settings = self.settings.of_scene();
        // Before the match, which takes long.
        SceneFile::parse_with("", "", &settings)?;
        let (stated, _) = document::parse::<serde_json::Value>("", "", &settings)?;
        let range_db = stated["effects"]["tone"]["dynamic_range_db"].as_f64();
        let mut frames = picture::read(&inputs, 1, None)?;
        // A file without frames has been refused.
        let mut frame = frames.swap_remove(0);
        frame.mm = self.mm_per_pixel.map(|mm| [mm; 2]).or(frame.mm);
        let mut matched = fit(&frame, self.depth_mm, range_db, self.seed)?;
        matched.set(&settings)?;
        output::requested(&self.page, || matched.page())?;
        output::requested(&self.output, || Ok::<_, Error>(matched.scene.clone()))?;
        match (self.json, &self.output) {
            (true, _) => terminal::emit_json(&matched),
            (false, Some(_)) => terminal::emit(&matched.to_string()),
            (false, None) => terminal::emit(&matched.scene),
        }
    }
}

/// Parses the depth of a frame, mm.
fn depth(text: &str) -> Result<f64, String> {
    ranged(text, 1.0..=1000.0, "1 to 1000 mm")
}
