//! What goes beside a frame on request: ground-truth layers, a sidecar, an overview.

use std::path::Path;

use insonify::output::overview::overview;
use insonify::output::png;
use insonify::output::sidecar::{self, Files, ImagePlace, LayerFile, NeedlePlace, Sidecar};
use insonify::scene::Scene;
use insonify::synth::layers::Layer;
use insonify::synth::{FrameState, Synthesizer};
use insonify::tracking::matrix::Rows;
use serde_json::json;

use super::target::Target;
use crate::cli::failure::Failure;

/// What was asked for besides frames.
pub struct Extras<'a> {
    pub layers: &'a [Layer],
    pub sidecar: bool,
    pub overview: bool,
    pub scene: &'a Scene,
    pub target: &'a Target,
}

impl Extras<'_> {
    /// Writes what goes beside the frame that was rendered last.
    pub fn write(
        &self,
        synth: &Synthesizer,
        frame: usize,
        frames: usize,
        state: &FrameState,
        warnings: &[String],
    ) -> Result<(), Failure> {
        let picture = self.target.picture(frame);
        let layers = self.write_layers(synth, &picture, state)?;
        if self.overview {
            self.write_overview(synth, frame, frames, &picture)?;
        }
        if self.sidecar {
            let path = Sidecar::path_for(&picture);
            self.describe(synth, frame, frames, layers, warnings, &picture)
                .write(&path)?;
        }
        Ok(())
    }

    fn write_layers(&self, synth: &Synthesizer, picture: &Path, state: &FrameState) -> Result<Vec<LayerFile>, Failure> {
        if self.layers.is_empty() {
            return Ok(Vec::new());
        }
        let beam = synth.beam()?;
        let tables = synth.tables();
        let write = |layer: &Layer| {
            let path = png::layer_path(picture, layer.name());
            let values = layer.image(&beam, tables, &state.probe_to_world);
            png::write_grey16(&path, tables.width(), tables.height(), &values)?;
            Ok(LayerFile {
                name: layer.name().to_owned(),
                path: name_of(&path),
            })
        };
        self.layers.iter().map(write).collect()
    }

    fn write_overview(&self, synth: &Synthesizer, frame: usize, frames: usize, picture: &Path) -> Result<(), Failure> {
        let anatomy = &self.scene.anatomy;
        let labels = 0..anatomy.volume.labels().len();
        let colours: Vec<[u8; 3]> = labels.map(|label| anatomy.tissues.of(label as u8).colour).collect();
        let needle = self.scene.needle_pose(frame, frames);
        let image = overview(
            &anatomy.volume,
            &colours,
            &self.scene.probe_pose(frame, frames),
            &synth.tables().grid,
            needle.as_ref(),
        );
        let path = png::layer_path(picture, "overview");
        let (width, height) = (image.width() as usize, image.height() as usize);
        Ok(png::write_rgb(&path, width, height, image.as_raw())?)
    }

    fn describe(
        &self,
        synth: &Synthesizer,
        frame: usize,
        frames: usize,
        layers: Vec<LayerFile>,
        warnings: &[String],
        picture: &Path,
    ) -> Sidecar {
        let pose = self.scene.probe_pose(frame, frames);
        let grid = &synth.tables().image_grid;
        let needle = self.scene.needle_pose(frame, frames);
        let in_sequence = matches!(self.target, Target::Sequence(_));
        Sidecar {
            version: sidecar::VERSION,
            frame,
            time_s: self.scene.time_s(frame, frames),
            seed: self.scene.settings.seed,
            files: Files {
                image: (!in_sequence).then(|| name_of(picture)),
                layers,
            },
            image: ImagePlace::new(grid, &pose),
            probe_to_world: Rows(*pose.probe_to_world()),
            needle: needle.map(|needle| NeedlePlace::new(&needle, grid, &pose)),
            parameters: self.parameters(synth),
            warnings: self.scene.warnings.iter().chain(warnings).cloned().collect(),
        }
    }

    /// The scene as it was rendered, and what the indices of the label layer mean.
    fn parameters(&self, synth: &Synthesizer) -> serde_json::Value {
        let settings = synth.settings();
        let anatomy = &self.scene.anatomy;
        let labels = anatomy.volume.labels().iter().enumerate();
        let labels: Vec<_> = labels
            .map(|(index, label)| {
                json!({
                    "index": index,
                    "value": label.value,
                    "name": label.name,
                    "tissue": anatomy.tissues.of(index as u8).name,
                })
            })
            .collect();
        json!({
            "backend": synth.backend(),
            "probe": settings.probe,
            "effects": settings.effects,
            "tissues": anatomy.tissues.tissues,
            "labels": labels,
            "scene": self.scene.file,
        })
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
