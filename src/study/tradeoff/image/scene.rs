//! Scene shared by most image tables.

use nalgebra::Matrix4;

use super::{ImageError, ImageOptions};
use crate::gpu::Gpu;
use crate::imaging::plan::Plan;
use crate::imaging::synth::tables::{Settings, Tables};
use crate::imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use crate::input::scene::{Scene, SceneFile};

/// Lowest level that a receiver accepts, dB.
const QUIETEST_DB: f64 = -200.0;

/// Abdomen phantom under its default probe, at the 640 x 480 pixels of the default scene.
pub struct Subject {
    pub scene: Scene,
    pub state: FrameState,
}

impl Subject {
    pub fn new(voxel_mm: f64) -> Result<Self, ImageError> {
        let text = format!("version = 1\nvolume = {{ phantom = \"abdomen\", resolution_mm = {voxel_mm} }}\n");
        let mut scene = SceneFile::parse(&text, "the scene of the study")?.resolve(".".as_ref())?;
        (scene.settings.image.width, scene.settings.image.height) = (640, 480);
        let mut state = FrameState::at(Matrix4::identity());
        scene.state(0, 1, &mut state)?;
        Ok(Self { scene, state })
    }

    /// Returns the settings with another grid.
    pub fn grid(&self, [lines, samples]: [u32; 2]) -> Settings {
        let mut settings = self.scene.settings.clone();
        (settings.probe.lines, settings.probe.samples) = (lines, samples);
        settings
    }

    pub fn on(&self, settings: Settings, backend: Backend) -> Result<Synthesizer, SynthError> {
        Synthesizer::new(self.scene.anatomy.clone(), settings, backend)
    }
}

/// Returns a grid divided by the coarsening of the options.
pub fn coarsened(options: &ImageOptions, grid: [u32; 2]) -> [u32; 2] {
    grid.map(|count| (count / options.coarsen.max(1)).max(1))
}

/// Returns settings without effects that are random for every grid, so that only structure remains.
pub fn without_grain(mut settings: Settings) -> Settings {
    settings.effects.speckle = None;
    settings.effects.receiver = None;
    settings
}

/// Returns settings whose receiver takes its time but adds nothing visible.
pub fn silent(mut settings: Settings) -> Settings {
    if let Some(receiver) = &mut settings.effects.receiver {
        receiver.noise_db = QUIETEST_DB;
        receiver.clutter_db = QUIETEST_DB;
        receiver.ring_down_db = QUIETEST_DB;
    }
    settings
}

/// Returns the single-precision CPU and each GPU, with their names.
pub fn single(gpus: &[Gpu]) -> Vec<(String, Backend)> {
    let on_gpus = gpus.iter().map(|gpu| {
        (
            format!("gpu, {}", gpu.report().name),
            Backend::Gpu(Box::new(gpu.clone())),
        )
    });
    std::iter::once(("cpu f32".to_owned(), Backend::Cpu))
        .chain(on_gpus)
        .collect()
}

/// Returns a description if a scene exceeds a device limit; such a variant is left out and noted.
pub fn too_large(subject: &Subject, settings: &Settings, gpus: &[Gpu]) -> Result<Option<String>, SynthError> {
    let plan = Plan::new(&Tables::new(subject.scene.anatomy.clone(), settings.clone())?);
    let largest = plan
        .resources
        .iter()
        .filter(|planned| !planned.resource.is_per_pixel)
        .map(|planned| planned.bytes)
        .max();
    let too_small = gpus
        .iter()
        .find(|gpu| largest.is_some_and(|bytes| bytes > gpu.limits().max_storage_buffer_binding_size));
    Ok(too_small.map(|gpu| format!("{} binds no buffer as large as this grid needs", gpu.report().name)))
}
