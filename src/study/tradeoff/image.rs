//! Image synthesis: cost of each variant, and its error in grey levels or millimetres.
//!
//! | table | varied | gold standard |
//! |---|---|---|
//! | `image_grid` | scanlines by samples | the finest grid, double precision |
//! | `image_backend` | double and single precision, each GPU | double precision on the CPU |
//! | `image_labels` | label of the nearest voxel or by vote, voxel size | closed-form boundaries |
//! | `image_effects` | one effect omitted or simplified | all default effects in double precision |
//! | `image_sampling` | samples along a shadow, scanlines across a blur | the finest grid |
//! | `image_texture` | solid texture (trilinear), constant echo | trilinear in double precision |
//! | `image_lookup` | nearest voxel, trilinear look-up of a texture in isolation | trilinear in double precision |
//! | `image_grain` | no grain, additive noise, developed speckle | Rayleigh statistics, requested correlation lengths |
//! | `image_looks` | looks of compounding, speckle reduction | 9 looks, each rendered whole |
//! | `image_waves` | samples, scanlines, sub-planes, a Gaussian beam | a simulation of waves |
//! | `image_body` | nodes of the mesh on which a body breathes or is pressed | the finest mesh |
//! | `image_location` | walk, grid, exhaustive search for the element of a sample | exhaustive search |
//!
//! Grey levels are compared in the scan-converted picture, inside the sector. A variant that is uniformly brighter or
//! darker than its standard, or further from it than a coarser variant, is not a valid approximation and is flagged.

mod body;
mod grain;
mod labels;
mod looks;
mod sampling;
mod waves;

use std::time::{Duration, Instant};

use nalgebra::Matrix4;

use super::entry::{About, Backends, Context, Entry, StudyOption, seconds};
use super::{Axis, Column, Factor, Figure, Study, Table};
use crate::stability::Effort;
use insonify::Error;
use insonify_base::machine::Machine;
use insonify_base::statistics::{Spread, percentile};
use insonify_gpu::Gpu;
use insonify_imaging::plan::Plan;
use insonify_imaging::scene::{Scene, SceneFile};
use insonify_imaging::synth::tables::{Settings, Tables};
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};

/// Options of the study.
#[derive(Clone, Debug)]
pub(crate) struct ImageOptions {
    /// Grids of scanlines by samples, from the coarsest to the finest (two or more). The finest is the gold standard
    /// and not one of the choices.
    pub grids: Vec<[u32; 2]>,
    /// Edge of the phantom's voxels, mm.
    pub voxel_mm: f64,
    /// Divisor of the grids of the other tables, 1 or more.
    pub coarsen: u32,
    /// Numbers of nodes of the meshes for point location.
    pub nodes: Vec<usize>,
    /// Numbers of nodes of the meshes on which a body moves, the finest, which is the gold standard, first.
    pub moving_nodes: Vec<usize>,
    /// Number of points located in each frame.
    pub points: usize,
    /// Time spent on each variant, with at least three frames.
    pub patience: Duration,
    /// GPUs to measure in addition to the CPU.
    pub gpus: Vec<Gpu>,
}

impl ImageOptions {
    /// Returns the options for an effort, without GPUs: at most five minutes on two cores, or seconds.
    pub(crate) fn of(effort: Effort) -> Self {
        let finest = [2048, 4096];
        let coarser = [[64, 128], [128, 256], [256, 512], [512, 1024], [1024, 2048]];
        Self {
            grids: effort.pick(coarser.to_vec(), [&coarser[..], &[finest]].concat()),
            voxel_mm: effort.pick(2.0, 1.0),
            coarsen: effort.pick(2, 1),
            nodes: effort.pick(vec![1000], vec![1000, 5000, 20_000]),
            moving_nodes: effort.pick(vec![4000, 1000], vec![40_000, 1000, 5000, 20_000]),
            points: effort.pick(300, 2000),
            patience: Duration::from_millis(effort.pick(120, 1200)),
            gpus: Vec::new(),
        }
    }
}

/// Registration of this study.
pub(crate) const ENTRY: Entry<ImageOptions> = Entry {
    about: About {
        name: "image",
        title: "Images",
        question: "What are the error, in grey levels, and the time of each way of rendering a frame? Grid of the beam, backends, labels, \
                   sampling, texture, grain, compounding, moving bodies, point location.",
        help: "Imaging options: time and memory against grey levels and millimetres, for grids, labels, sampling, grain and backends",
        examples: "\
Each table has a gold standard, made in the same run, and says which:

  beam grid   64 x 128 to 1024 x 2048 scanlines by samples, against 2048 x 4096 in double precision
  backends    double and single precision on the CPU, each GPU, against double precision
  labels      nearest voxel or voted, against boundaries of a closed form (mm) and voxels of 0.25 mm (grey levels)
  sampling    samples of a shadow, scanlines of a blur, against the finest
  texture     trilinear look-ups or a constant echo, against double precision
  grain       no grain, additive noise or developed speckle, against the statistics of speckle
  looks       1 to 9 looks of compounding, with speckle reduction or not, against looks rendered whole
  waves       samples, scanlines, sub-planes and beams, against a simulation of waves
  body        nodes of a mesh that breathes or is pressed, against the finest
  location    a walk from the last frame, a search grid or every element, against every element

Errors are of grey levels (of 255) on the scan-converted picture, or mm. A row with a star is a best choice: no other of its kind
is both faster and nearer to the truth. A row marked WRONG is not a valid approximation: it has a uniform offset, a larger error
than a coarser level, or differs where it must not.

Examples:
  insonify tradeoff image --quick                a first look, in half a minute
  insonify tradeoff image -o study               everything, with tables and plots: minutes
  insonify tradeoff image --backend cpu --json   without a GPU, for programs",
        backends: Backends::Single("double precision is what all else is compared with"),
    },
    options: &[
        StudyOption::quick("Coarser phantoms, fewer frames, no grid above 512 x 1024"),
        StudyOption::<ImageOptions>::value(
            "time-limit-s",
            "S",
            "Time limit for each option, s, after at least three frames [default: 1.2; with --quick 0.12]",
            |options, texts| seconds(texts).map(|value| options.patience = value),
        )
        .alias("patience-s"),
    ],
    settings: ImageOptions::of,
    in_report: ImageOptions::of,
    run: |options, Context { devices, progress, .. }| {
        let options = ImageOptions {
            gpus: devices.gpus.clone(),
            ..options.clone()
        };
        study(&options, progress)
    },
};

const BACKEND: Factor = Factor::new("backend", "backend");
const MEDIAN: Axis = Axis::log("median_ms", "ms", "time of a frame (median), ms");
const P95: Axis = Axis::log("p95_ms", "p95 ms", "time of a frame (95 of 100), ms");
const MEMORY: Axis = Axis::log("memory_mb", "MB", "working memory, MB");

/// Picture of a variant, compared with its standard.
struct Compared<V> {
    variant: V,
    picture: Picture,
    difference: Difference,
    flag: Option<String>,
}

/// Columns of pictures: time, memory, error.
const fn compared<V>() -> [Column<Compared<V>>; 6] {
    [
        MEDIAN.of(|row: &Compared<V>| Some(row.picture.time?.median_ms)),
        P95.of(|row: &Compared<V>| Some(row.picture.time?.p95_ms)),
        MEMORY.of(|row: &Compared<V>| Some(row.picture.memory_mb)),
        Axis::log("rms_grey", "RMS grey", "root mean square error, grey levels of 255")
            .of(|row: &Compared<V>| Some(row.difference.rms)),
        Axis::log(
            "p99_grey",
            "p99 grey",
            "error that 99 of 100 pixels keep to, grey levels",
        )
        .of(|row: &Compared<V>| Some(row.difference.p99)),
        Axis::linear("bias_grey", "mean grey", "mean difference, grey levels")
            .of(|row: &Compared<V>| Some(row.difference.bias)),
    ]
}

/// Studies images. `progress` receives the current task and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`Error`] if a scene or mesh is invalid or a frame cannot be rendered.
pub(crate) fn study(options: &ImageOptions, progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<Study, Error> {
    let mut notes = Vec::new();
    if options.gpus.is_empty() {
        notes.push("no GPU adapter: these figures are the CPU's alone".to_owned());
    }
    for gpu in options.gpus.iter().filter(|gpu| gpu.report().software) {
        notes.push(format!(
            "{} is software on the CPU: right for errors, not for the speed of a GPU",
            gpu.report().name
        ));
    }
    let steps: [(&str, f64, Measure); 10] = [
        ("grids of the beam", 0.0, labels::grids),
        ("precisions and backends", 0.55, labels::backends),
        ("labels", 0.65, labels::labels),
        ("effects", 0.7, labels::effects),
        ("shadow and blur", 0.75, sampling::sampling),
        ("texture and grain", 0.85, grain::grains),
        ("looks", 0.87, looks::looks),
        ("beside waves", 0.88, waves::waves),
        ("moving bodies", 0.9, body::bodies),
        ("point location", 0.95, sampling::location),
    ];
    let mut tables = Vec::new();
    for (step, share, measure) in steps {
        progress(step, share);
        tables.extend(measure(options, &mut notes)?);
    }
    progress("done", 1.0);
    Ok(Study {
        name: "image",
        title: ENTRY.about.title,
        about: about(options),
        machine: Machine::here(),
        tables,
        figures: figures(),
        notes,
    })
}

/// Function that measures tables, and notes what it left out.
type Measure = fn(&ImageOptions, &mut Vec<String>) -> Result<Vec<Table>, Error>;

fn about(options: &ImageOptions) -> Vec<(&'static str, String)> {
    let grid = |[lines, samples]: &[u32; 2]| format!("{lines} x {samples}");
    let mut about = vec![
        ("grids", options.grids.iter().map(grid).collect::<Vec<_>>().join(", ")),
        (
            "scene",
            format!(
                "the abdomen phantom at {} mm to 640 x 480 pixels, seed 0, every usual effect",
                options.voxel_mm
            ),
        ),
        (
            "errors",
            "on the scan-converted picture, inside the sector, in grey levels of 255".to_owned(),
        ),
    ];
    about.extend(options.gpus.iter().map(|gpu| ("gpu", gpu.report().name.clone())));
    about
}

fn figures() -> Vec<Figure> {
    let figure = |file: &str, title: &str, table, [x, y]: [&'static str; 2], colour, marker: &[&'static str]| Figure {
        marker: marker.to_vec(),
        ..Figure::new(file, title, table, [x, y], colour)
    };
    vec![
        figure(
            "image-grid",
            "Beam grid: time against error",
            "image_grid",
            ["median_ms", "rms_grey"],
            "content",
            &["backend"],
        ),
        figure(
            "image-labels",
            "Labels: error of boundaries against voxel size",
            "image_labels",
            ["voxel_mm", "boundary_mm"],
            "boundary",
            &[],
        ),
        figure(
            "image-sampling",
            "Shadow and blur: time against error",
            "image_sampling",
            ["median_ms", "rms_grey"],
            "effect",
            &[],
        ),
        figure(
            "image-location",
            "Point location: time of a point against the mesh",
            "image_location",
            ["elements", "point_ns"],
            "method",
            &[],
        ),
    ]
}

/// Lowest level that haze and a receiver accept, dB.
const QUIETEST_DB: f64 = -200.0;

/// Abdomen phantom under its default probe, at the 640 x 480 pixels of the default scene.
pub(crate) struct Subject {
    /// Scene with the phantom and the probe.
    pub scene: Scene,
    /// State of the only frame.
    pub state: FrameState,
}

impl Subject {
    /// Creates the phantom in voxels of a given size, mm.
    pub(crate) fn new(voxel_mm: f64) -> Result<Self, Error> {
        let text = format!("volume = {{ phantom = \"abdomen\", resolution_mm = {voxel_mm} }}\n");
        let mut scene = SceneFile::parse(&text, "the scene of the study")?.resolve(".".as_ref())?;
        (scene.settings.image.width, scene.settings.image.height) = (640, 480);
        let mut state = FrameState::at(Matrix4::identity());
        scene.state(0, 1, &mut state)?;
        Ok(Self { scene, state })
    }

    /// Returns the settings with another grid.
    pub(crate) fn grid(&self, [lines, samples]: [u32; 2]) -> Settings {
        let mut settings = self.scene.settings.clone();
        (settings.probe.lines, settings.probe.samples) = (lines, samples);
        settings
    }

    /// Creates a synthesizer of the phantom with these settings on a backend.
    pub(crate) fn on(&self, settings: Settings, backend: Backend) -> Result<Synthesizer, SynthError> {
        Synthesizer::new(self.scene.anatomy.clone(), settings, backend)
    }
}

/// Returns a grid divided by the coarsening of the options.
pub(crate) fn coarsened(options: &ImageOptions, grid: [u32; 2]) -> [u32; 2] {
    grid.map(|count| (count / options.coarsen.max(1)).max(1))
}

/// Returns settings without effects that are random for every grid, so that only structure remains.
pub(crate) fn without_grain(mut settings: Settings) -> Settings {
    settings.effects.speckle = None;
    settings.effects.haze = None;
    settings.effects.receiver = None;
    settings
}

/// Returns settings whose haze and receiver take their time but add nothing visible.
pub(crate) fn silent(mut settings: Settings) -> Settings {
    if let Some(haze) = &mut settings.effects.haze {
        haze.level_db = QUIETEST_DB;
    }
    if let Some(receiver) = &mut settings.effects.receiver {
        receiver.noise_db = QUIETEST_DB;
        receiver.clutter_db = Some(QUIETEST_DB);
        receiver.ring_down_db = QUIETEST_DB;
    }
    settings
}

/// Returns the single-precision CPU and each GPU, with their names.
pub(crate) fn single(gpus: &[Gpu]) -> Vec<(String, Backend)> {
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
pub(crate) fn too_large(subject: &Subject, settings: &Settings, gpus: &[Gpu]) -> Result<Option<String>, SynthError> {
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

/// Minimum number of timed frames, after one untimed frame.
const MIN: usize = 3;
/// Maximum number of timed frames.
const MAX: usize = 200;

/// Rendered picture with its times.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Picture {
    /// Grey levels, row by row from the top.
    pub pixels: Vec<u8>,
    /// Statistics of the frame times.
    pub time: Option<Spread>,
    /// Working memory on the backend, MB (10^6 bytes).
    pub memory_mb: f64,
}

/// Renders a frame repeatedly until `patience` is spent.
pub(crate) fn picture(synth: &mut Synthesizer, state: &FrameState, patience: Duration) -> Result<Picture, SynthError> {
    let pixels = synth.render(state)?.pixels.clone();
    let (start, mut times) = (Instant::now(), Vec::with_capacity(MAX));
    while times.len() < MIN || (times.len() < MAX && start.elapsed() < patience) {
        let before = Instant::now();
        synth.render(state)?;
        times.push(before.elapsed().as_secs_f64() * 1e3);
    }
    Ok(Picture {
        pixels,
        time: Spread::of(times),
        memory_mb: synth.memory_bytes() as f64 * 1e-6,
    })
}

/// Difference of a picture from its standard, in grey levels, over the pixels inside the sector.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Difference {
    /// Root mean square of the differences.
    pub rms: f64,
    /// 99th percentile of the magnitudes of the differences.
    pub p99: f64,
    /// Mean difference, positive if the picture is brighter.
    pub bias: f64,
}

impl Difference {
    /// Compares a picture with its standard over the pixels marked as inside.
    pub(crate) fn of(standard: &[u8], pixels: &[u8], inside: &[bool]) -> Self {
        let pairs = standard.iter().zip(pixels).zip(inside).filter(|(_, inside)| **inside);
        let differences: Vec<f64> = pairs.map(|((a, b), _)| f64::from(*b) - f64::from(*a)).collect();
        let n = differences.len().max(1) as f64;
        let mut sizes: Vec<f64> = differences.iter().map(|x| x.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        Self {
            rms: (differences.iter().map(|x| x * x).sum::<f64>() / n).sqrt(),
            p99: percentile(&sizes, 0.99).unwrap_or(0.0),
            bias: differences.iter().sum::<f64>() / n,
        }
    }

    /// Describes an offset, which a valid approximation does not have: a mean difference above one grey level plus half
    /// the root mean square.
    pub(crate) fn offset(&self) -> Option<String> {
        (self.bias.abs() > 1.0 + 0.5 * self.rms).then(|| {
            format!(
                "{:+.1} grey levels on the whole: an offset, no approximation",
                self.bias
            )
        })
    }

    /// Describes an offset (see [`Difference::offset`]), or a refinement whose error exceeds that of the coarser level
    /// by more than a tenth and rounding.
    pub(crate) fn flag(&self, coarser: Option<&Difference>) -> Option<String> {
        let worse = coarser.filter(|coarser| self.rms > 1.1 * coarser.rms + 0.3);
        self.offset().or_else(|| {
            worse.map(|coarser| {
                format!(
                    "RMS {:.2}, above {:.2} of the coarser level before it",
                    self.rms, coarser.rms
                )
            })
        })
    }
}

/// Returns a mask of the pixels inside the sector.
pub(crate) fn inside(synth: &Synthesizer) -> Vec<bool> {
    synth
        .tables()
        .scan_map
        .iter()
        .map(|position| position[0] >= 0.0)
        .collect()
}

#[cfg(test)]
mod tests;
