//! Writing of frames with their requested companion files.

use std::borrow::Cow;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use crate::base::matrix::Rows;
use crate::base::output::png;
use crate::base::output::{OutputError, atomic};
use crate::imaging::overlay;
use crate::imaging::sequence::{FrameInfo, SequenceWriter, transforms};
use crate::imaging::sidecar::{self, Files, ImagePlace, LayerFile, NeedlePlace, Sidecar};
use crate::imaging::synth::layers::Layer;
use crate::imaging::synth::{FrameState, Synthesizer};
use crate::input::scene::Scene;
use crate::tracking::needle::{MAX_NODES, NeedlePose};
use crate::tracking::pose::Pose;

use super::extras::{self, Extras};
use super::target::{Target, name_of};
use crate::cli::failure::Failure;

/// File of the parameters shared by many frames.
pub const PARAMETERS: &str = "parameters.json";

/// Writer of frames.
pub struct Output<'a> {
    target: Target,
    extras: Extras,
    layers: Vec<Layer>,
    scene: &'a Scene,
    /// Number of expected frames.
    frames: usize,
    images: Option<SequenceWriter>,
    /// One writer per layer, for image sequences.
    masks: Vec<SequenceWriter>,
    /// Whether the shared parameters have been written.
    shared: bool,
}

/// The last rendered frame.
pub struct Shot<'a> {
    /// Frame number, from 0.
    pub number: usize,
    /// Time of the frame, s.
    pub time_s: f64,
    /// State from which the frame was rendered.
    pub state: &'a FrameState,
    /// Distance of the needle's tip from the nearest critical structure, mm, if there is one near.
    pub clearance_mm: Option<f64>,
    /// Warnings about the frame.
    pub warnings: &'a [String],
}

impl<'a> Output<'a> {
    /// Creates the folder for numbered files, and starts the sequences if frames go to one.
    pub fn open(target: Target, extras: &Extras, scene: &'a Scene, frames: usize) -> Result<Self, Failure> {
        if let (Target::Sequence(path, _), true) = (&target, extras.overlay) {
            return Err(Failure::usage(
                format!(
                    "--overlay draws into pictures, and {} is an image sequence",
                    path.display()
                ),
                "write PNG files, or leave out --overlay",
            ));
        }
        let size = scene.settings.image;
        let layers = extras.layers();
        let folder = match &target {
            Target::Folder(folder) => Some(folder),
            Target::Sequence(_, folder) if extras.sidecar || extras.overview => Some(folder),
            _ => None,
        };
        if let Some(folder) = folder {
            fs::create_dir_all(folder).map_err(|cause| OutputError::write(folder, cause))?;
        }
        let (mut images, mut masks) = (None, Vec::new());
        if let Target::Sequence(path, _) = &target {
            images = Some(SequenceWriter::create(path, size.width, size.height)?);
            for layer in &layers {
                let path = png::layer_path(path, layer.name());
                masks.push(SequenceWriter::create_layer(&path, size.width, size.height)?);
            }
        }
        let synthetic = format!("insonify {} seed {}", env!("CARGO_PKG_VERSION"), scene.settings.seed);
        for sequence in images.iter_mut().chain(&mut masks) {
            sequence.field("WorldAxes", &scene.motion_world().to_string());
            sequence.field("Simulated", &synthetic);
        }
        Ok(Self {
            target,
            extras: extras.clone(),
            layers,
            scene,
            frames,
            images,
            masks,
            shared: false,
        })
    }

    /// Writes a frame and its companion files; returns the path of the frame.
    pub fn write(&mut self, synth: &Synthesizer, shot: &Shot<'_>) -> Result<PathBuf, Failure> {
        let frame = synth.frame();
        let world = self.scene.motion_world();
        let places = [frame.image_to_world, shot.state.probe_to_world].map(|place| world.transform(place));
        let transforms = transforms(places, self.scene.recorded(shot.number, self.frames));
        let info = FrameInfo {
            timestamp: shot.time_s,
            transforms: &transforms,
            image_valid: true,
        };
        let picture = self.target.picture(shot.number, self.frames);
        let path = match &mut self.images {
            Some(images) => {
                images.push(&frame.pixels, &info)?;
                self.target.path().to_owned()
            }
            None => {
                let mut pixels = Cow::Borrowed(frame.pixels.as_slice());
                if self.extras.overlay {
                    overlay::draw(pixels.to_mut(), synth.tables());
                }
                png::write_grey(&picture, frame.width, frame.height, &pixels)?;
                picture.clone()
            }
        };
        let layers = self.write_layers(synth, shot, &picture, &info)?;
        if self.extras.overview || self.extras.sidecar {
            let pose = Pose::from_matrix(&shot.state.probe_to_world)
                .map_err(|error| Failure::usage(error.to_string(), "give a pose that neither stretches nor shears"))?;
            let needle = needle(shot.state);
            if self.extras.overview {
                let path = png::layer_path(&picture, "overview");
                extras::write_overview(&path, synth, &pose, needle.as_ref())?;
            }
            if self.extras.sidecar {
                self.write_sidecar(synth, shot, (&pose, needle.as_ref()), &picture, layers)?;
            }
        }
        Ok(path)
    }

    fn write_layers(
        &mut self,
        synth: &Synthesizer,
        shot: &Shot<'_>,
        picture: &Path,
        info: &FrameInfo<'_>,
    ) -> Result<Vec<LayerFile>, Failure> {
        if self.layers.is_empty() {
            return Ok(Vec::new());
        }
        let beam = synth.beam()?;
        let tables = synth.tables();
        let mut files = Vec::new();
        for (at, layer) in self.layers.iter().enumerate() {
            let values = layer.image(&beam, tables, &shot.state.probe_to_world);
            let path = match self.masks.get_mut(at) {
                Some(mask) => {
                    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
                    mask.push(&bytes, info)?;
                    format!("../{}", name_of(&png::layer_path(self.target.path(), layer.name())))
                }
                None => {
                    let path = png::layer_path(picture, layer.name());
                    png::write_grey16(&path, tables.width(), tables.height(), &values)?;
                    name_of(&path)
                }
            };
            files.push(LayerFile {
                name: layer.name().to_owned(),
                path,
            });
        }
        Ok(files)
    }

    fn write_sidecar(
        &mut self,
        synth: &Synthesizer,
        shot: &Shot<'_>,
        (pose, needle): (&Pose, Option<&NeedlePose>),
        picture: &Path,
        layers: Vec<LayerFile>,
    ) -> Result<(), Failure> {
        let grid = &synth.tables().image_grid;
        let single = matches!(self.target, Target::File(_));
        if !single && !self.shared {
            let parameters = extras::parameters(self.scene, synth);
            atomic::write(&picture.with_file_name(PARAMETERS), |file| {
                writeln!(file, "{parameters:#}")
            })?;
            self.shared = true;
        }
        let sidecar = Sidecar {
            version: sidecar::VERSION,
            frame: shot.number,
            time_s: shot.time_s,
            seed: synth.settings().seed,
            files: Files {
                image: self.images.is_none().then(|| name_of(picture)),
                layers,
                overlay: self.extras.overlay,
            },
            image: ImagePlace::new(grid, pose),
            probe_to_world: Rows(*pose.probe_to_world()),
            needle: needle.map(|needle| NeedlePlace {
                clearance_mm: shot.clearance_mm,
                ..NeedlePlace::new(needle, grid, pose)
            }),
            parameters: single.then(|| extras::parameters(self.scene, synth)),
            parameters_file: (!single).then(|| PARAMETERS.to_owned()),
            warnings: self.scene.warnings.iter().chain(shot.warnings).cloned().collect(),
        };
        Ok(sidecar.write(&Sidecar::path_for(picture))?)
    }

    /// Finishes the sequences.
    pub fn finish(self) -> Result<(), Failure> {
        for sequence in self.masks.into_iter().chain(self.images) {
            sequence.finish()?;
        }
        Ok(())
    }
}

/// Needle of a frame: the displayed part towards the tip.
fn needle(state: &FrameState) -> Option<NeedlePose> {
    let shaft = state.needle.as_ref()?;
    let nodes = &shaft.nodes[shaft.nodes.len().saturating_sub(MAX_NODES)..];
    NeedlePose::bent(nodes.to_vec(), shaft.diameter_mm).ok()
}
