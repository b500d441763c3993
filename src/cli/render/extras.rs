//! Optional companion files of a frame: ground-truth layers, a sidecar, an overview.

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser};
use image::RgbImage;
use insonify_imaging::overview::overview;
use insonify_imaging::scene::Scene;
use insonify_imaging::synth::Synthesizer;
use insonify_imaging::synth::layers::Layer;
use insonify_tracking::needle::NeedlePose;
use insonify_tracking::pose::Pose;
use serde_json::json;

use crate::failure::{Error, usage};
use crate::terminal;
use crate::variants::{named, names};

/// Former names of layers, and their replacements.
const EARLIER: [(&str, Layer); 2] = [("labels", Layer::LabelValue), ("shadowed", Layer::Loss)];

/// Requested companion files.
#[derive(Args, Clone, Debug, Default)]
pub(crate) struct Extras {
    /// Ground truth to write beside each frame, 16 bits a pixel
    #[arg(id = "layers", long = "layers", value_name = "LAYER,...", value_parser = layer_names(), value_delimiter = ',')]
    names: Vec<String>,
    /// Write a JSON file beside each frame: seed, pose, parameters, needle tip, warnings
    #[arg(long)]
    pub sidecar: bool,
    /// Write a small picture of the probe against the anatomy beside each frame
    #[arg(long)]
    pub overview: bool,
    /// Draw a depth scale, a grey bar, the probe's mark and the focus into the pictures, for human readers
    #[arg(long)]
    pub overlay: bool,
    /// Write image sequences (.mha, .nrrd) without compression: faster, and larger
    #[arg(long)]
    pub uncompressed: bool,
}

fn layer_names() -> PossibleValuesParser {
    let earlier = EARLIER.iter().map(|(name, _)| PossibleValue::new(*name).hide(true));
    PossibleValuesParser::new(names::<Layer>().into_iter().chain(earlier))
}

impl Extras {
    /// Checks options that exclude each other.
    ///
    /// # Errors
    /// A usage error.
    pub(crate) fn check_options(&self) -> Result<(), Error> {
        if self.overlay && !self.names.is_empty() {
            return Err(usage(
                "--overlay with --layers: scale and marks are drawn over the pixels that the layers describe",
                "make the frames for human readers in a run of their own",
            ));
        }
        Ok(())
    }

    /// Requested layers, each once.
    pub(crate) fn layers(&self) -> Vec<Layer> {
        let mut layers = Vec::new();
        for name in &self.names {
            let earlier = EARLIER.iter().find(|(earlier, _)| earlier == name);
            let layer = earlier.map(|(_, layer)| *layer).or(named(name));
            layers.extend(layer.filter(|layer| !layers.contains(layer)));
        }
        layers
    }

    /// Prints a note if a layer was requested by a former name, and refuses values that a layer cannot represent.
    pub(crate) fn check(&self, scene: &Scene) -> Result<(), Error> {
        if self.names.iter().any(|name| name == "labels") {
            terminal::say(
                "note: the layer `labels` is now `label-value`, with the values of the label file; places in the table of labels, \
                 as it had before, are the layer `label-index`",
            );
        }
        if self.layers().contains(&Layer::Organ) && scene.anatomy.volume.is_of_saved_body() {
            terminal::warn(
                "the layer `organ` has what the label file holds, and this one was written by --save-labels, with structures \
                 drawn over organs (values 200 to 213): for masks of whole organs give the original labels",
            );
        }
        let of_values = |layer: &Layer| matches!(layer, Layer::LabelValue | Layer::Organ);
        match (
            Layer::unfit(scene.anatomy.volume.labels()),
            self.layers().into_iter().find(of_values),
        ) {
            (Some(label), Some(layer)) => Err(usage(
                format!(
                    "--layers {}: label {} does not fit 16 bits without sign",
                    layer.name(),
                    label.value
                ),
                "ask for the layer label-index: places in the table of labels, which the sidecar has",
            )),
            _ => Ok(()),
        }
    }
}

/// Draws the overview of the probe pose.
pub(crate) fn overview_of(synth: &Synthesizer, pose: &Pose, needle: Option<&NeedlePose>) -> RgbImage {
    let tables = synth.tables();
    let anatomy = &tables.anatomy;
    let labels = 0..anatomy.volume.labels().len();
    let colours: Vec<[u8; 3]> = labels.map(|label| anatomy.tissues.tissue(label as u8).colour).collect();
    overview(&anatomy.volume, &colours, pose, &tables.grid, needle)
}

/// Parameters of the rendered scene, and the meaning of the indices and values of label layers.
pub(crate) fn parameters(scene: &Scene, synth: &Synthesizer) -> serde_json::Value {
    let settings = synth.settings();
    let anatomy = &synth.tables().anatomy;
    let volume = &anatomy.volume;
    let labels = volume.labels().iter().enumerate();
    let labels: Vec<_> = labels
        .map(|(index, label)| {
            let mut row = json!({
                "index": index,
                "value": label.value,
                "name": label.name,
                "tissue": anatomy.tissues.tissue(index as u8).name,
            });
            if let Some(organ) = volume.drawn_into(index) {
                row["part_of"] = organ.into();
            }
            if let Some(side) = volume.side(index) {
                row["side"] = side.into();
            }
            row
        })
        .collect();
    json!({
        "backend": synth.backend(),
        "probe": settings.probe,
        "effects": settings.effects,
        "tissues": anatomy.tissues.tissues,
        "labels": labels,
        "scene": scene.file,
    })
}
