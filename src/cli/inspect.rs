//! `insonify inspect`: contributions to one pixel.

use clap::Args;
use insonify_imaging::synth::FrameState;
use insonify_study::inspect::{PixelReport, inspect};
use nalgebra::Matrix4;
use serde::Serialize;

use super::backend::BackendArgs;
use super::failure::{Error, usage};
use super::input::Input;
use super::terminal;

/// Explains one pixel: its beam and depth, tissue, texture, speckle, transmittance, blur and grey level
#[derive(Args)]
pub(crate) struct Inspect {
    #[command(flatten)]
    input: Input,
    /// Column and row of the pixel, from 0 at the near corner of the unmarked side
    #[arg(long, value_name = "X,Y", value_parser = pixel, allow_hyphen_values = true)]
    at: [usize; 2],
    /// Frame number, from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: usize,
    /// Number of frames of the scene's motion; by default that of the scene
    #[arg(long, value_name = "N", value_parser = super::render::frame_count)]
    frames: Option<usize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct InspectReport {
    frame: usize,
    #[serde(flatten)]
    pixel: PixelReport,
    warnings: Vec<String>,
}

impl Inspect {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let (scene, _) = self.input.scene(&BackendArgs::default())?;
        let frames = self.frames.unwrap_or_else(|| scene.frames());
        if self.frame >= frames {
            return Err(usage(
                format!("--frame {} of a scene of {frames} frames", self.frame),
                format!("frames are numbered from 0 to {}", frames - 1),
            ));
        }
        let mut state = FrameState::at(Matrix4::identity());
        scene.state(self.frame, frames, &mut state)?;
        let [column, row] = self.at;
        let Some(pixel) = inspect(&scene.anatomy, &scene.settings, &state, self.at)? else {
            let image = scene.settings.image;
            return Err(usage(
                format!(
                    "--at {column},{row} is beyond a frame of {}x{} pixels",
                    image.width, image.height
                ),
                format!(
                    "columns run from 0 to {}, rows from 0 to {}",
                    image.width - 1,
                    image.height - 1
                ),
            ));
        };
        if self.json {
            return terminal::emit_json(&InspectReport {
                frame: self.frame,
                pixel,
                warnings: scene.warnings,
            });
        }
        terminal::emit(&pixel.to_string())
    }
}

fn pixel(text: &str) -> Result<[usize; 2], String> {
    let expected = || "expected a column and a row such as 320,240".to_owned();
    let (column, row) = text.split_once(',').ok_or_else(expected)?;
    let number = |text: &str| text.trim().parse().map_err(|_| expected());
    Ok([number(column)?, number(row)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_two_numbers() {
        assert_eq!(pixel("3,4"), Ok([3, 4]));
        assert_eq!(pixel("3, 4"), Ok([3, 4]));
        for wrong in ["", "3", "3,", "-1,2", "1,2,3", "a,b", "1.5,2"] {
            assert!(pixel(wrong).is_err(), "{wrong}");
        }
    }
}
