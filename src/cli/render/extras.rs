//! What goes beside a frame on request: ground-truth layers, a sidecar, an overview.

use std::path::Path;

use clap::Args;
use clap::ValueEnum;
use clap::builder::{PossibleValue, PossibleValuesParser};
use insonify::output::overview::overview;
use insonify::output::png;
use insonify::scene::Scene;
use insonify::synth::Synthesizer;
use insonify::synth::layers::Layer;
use insonify::tracking::needle::NeedlePose;
use insonify::tracking::pose::Pose;
use serde_json::json;

use crate::cli::failure::Failure;
use crate::cli::terminal;

/// The earlier names of layers, and what is taken for them.
const EARLIER: [(&str, Layer); 2] = [("labels", Layer::LabelValue), ("shadowed", Layer::Loss)];

/// What is asked for besides frames.
#[derive(Args, Clone, Debug, Default)]
pub struct Extras {
    /// Ground truth to write beside each frame, 16 bits a pixel
    #[arg(id = "layers", long = "layers", value_name = "LAYER,...", value_parser = layer_names(), value_delimiter = ',')]
    names: Vec<String>,
    /// Write a JSON file beside each frame: seed, pose, parameters, needle tip, warnings
    #[arg(long)]
    pub sidecar: bool,
    /// Write a small picture of the probe against the anatomy beside each frame
    #[arg(long)]
    pub overview: bool,
    /// Draw a scale of depth, a bar of the grey map, the probe's mark and the focus into the pictures, for people to look at
    #[arg(long, conflicts_with = "layers")]
    pub overlay: bool,
}

fn layer_names() -> PossibleValuesParser {
    let layers = Layer::value_variants().iter();
    let earlier = EARLIER.iter().map(|(name, _)| PossibleValue::new(*name).hide(true));
    PossibleValuesParser::new(layers.filter_map(ValueEnum::to_possible_value).chain(earlier))
}

impl Extras {
    /// The layers, each once.
    pub fn layers(&self) -> Vec<Layer> {
        let mut layers = Vec::new();
        for name in &self.names {
            let earlier = EARLIER.iter().find(|(earlier, _)| earlier == name);
            let layer = earlier.map(|(_, layer)| *layer).or(Layer::from_str(name, false).ok());
            layers.extend(layer.filter(|layer| !layers.contains(layer)));
        }
        layers
    }

    /// Says what is written where a layer was asked for by a name that meant another, and refuses values that a layer cannot hold.
    pub fn check(&self, scene: &Scene) -> Result<(), Failure> {
        if self.names.iter().any(|name| name == "labels") {
            terminal::say(
                "note: the layer `labels` is now `label-value`, with the values of the label file; places in the table of labels, \
                 as it had before, are the layer `label-index`",
            );
        }
        match Layer::unfit(scene.anatomy.volume.labels()) {
            Some(label) if self.layers().contains(&Layer::LabelValue) => Err(Failure::usage(
                format!(
                    "--layers label-value: label {} does not fit 16 bits without sign",
                    label.value
                ),
                "ask for the layer label-index: places in the table of labels, which the sidecar has",
            )),
            _ => Ok(()),
        }
    }
}

/// Draws where the probe is.
pub fn write_overview(
    path: &Path,
    synth: &Synthesizer,
    pose: &Pose,
    needle: Option<&NeedlePose>,
) -> Result<(), Failure> {
    let tables = synth.tables();
    let anatomy = &tables.anatomy;
    let labels = 0..anatomy.volume.labels().len();
    let colours: Vec<[u8; 3]> = labels.map(|label| anatomy.tissues.of(label as u8).colour).collect();
    let image = overview(&anatomy.volume, &colours, pose, &tables.grid, needle);
    let (width, height) = (image.width() as usize, image.height() as usize);
    Ok(png::write_rgb(path, width, height, image.as_raw())?)
}

/// The scene as it is rendered, and what the indices and values of label layers mean.
pub fn parameters(scene: &Scene, synth: &Synthesizer) -> serde_json::Value {
    let settings = synth.settings();
    let anatomy = &synth.tables().anatomy;
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
        "scene": scene.file,
    })
}
