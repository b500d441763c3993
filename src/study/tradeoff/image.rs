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
//! | `image_grain` | no grain, additive noise, fully developed speckle | Rayleigh statistics, requested correlation lengths |
//! | `image_location` | walk, grid, exhaustive search for the element of a sample | exhaustive search |
//!
//! Grey levels are compared in the scan-converted picture, inside the sector. A variant that is uniformly brighter or darker than its
//! standard, or further from it than a coarser variant, is not a valid approximation and is flagged.

mod compare;
mod effects;
mod grain;
mod grid;
mod labels;
mod location;
mod lookup;
mod sampling;
mod scene;
#[cfg(test)]
mod tests;

use std::time::Duration;

use super::gather::Entry;
use super::{Axis, Factor, Figure, Study, Table};
use crate::base::report::machine::Machine;
use crate::gpu::{Gpu, GpuError};
use crate::imaging::synth::SynthError;
use crate::input::scene::SceneError;
use crate::mechanics::mesh::InvalidMesh;
use crate::study::stability::Effort;

/// Options of the study.
#[derive(Debug)]
pub struct ImageOptions {
    /// Grids of scanlines by samples, from the coarsest to the finest (two or more). The finest is the gold standard and not one of the
    /// choices.
    pub grids: Vec<[u32; 2]>,
    /// Edge of the phantom's voxels, mm.
    pub voxel_mm: f64,
    /// Divisor of the grids of the other tables, 1 or more.
    pub coarsen: u32,
    /// Numbers of nodes of the meshes for point location.
    pub nodes: Vec<usize>,
    /// Number of points located in each frame.
    pub points: usize,
    /// Time spent on each variant, with at least three frames.
    pub patience: Duration,
    /// GPUs to measure in addition to the CPU.
    pub gpus: Vec<Gpu>,
}

impl ImageOptions {
    /// Returns the options of a full study, at most five minutes on two cores.
    pub fn whole(gpus: Vec<Gpu>) -> Self {
        Self {
            grids: vec![
                [64, 128],
                [128, 256],
                [256, 512],
                [512, 1024],
                [1024, 2048],
                [2048, 4096],
            ],
            voxel_mm: 1.0,
            coarsen: 1,
            nodes: vec![1000, 5000, 20_000],
            points: 2000,
            patience: Duration::from_millis(1200),
            gpus,
        }
    }

    /// Returns the options of a quick study, which takes seconds.
    pub fn quick(gpus: Vec<Gpu>) -> Self {
        Self {
            grids: vec![[64, 128], [128, 256], [256, 512], [512, 1024], [1024, 2048]],
            voxel_mm: 2.0,
            coarsen: 2,
            nodes: vec![1000],
            points: 300,
            patience: Duration::from_millis(120),
            gpus,
        }
    }
}

/// Registration of this study.
pub const ENTRY: Entry = Entry {
    name: "image",
    title: "Images",
    question: "How many grey levels does each way of making a frame cost, and how many milliseconds? Grid of the beam, backends, labels, \
               sampling, texture, grain, point location.",
    run: |means, effort, progress| {
        let gpus = means.gpus.clone();
        let options = match effort {
            Effort::Quick => ImageOptions::quick(gpus),
            Effort::Whole => ImageOptions::whole(gpus),
        };
        Ok(study(&options, progress)?)
    },
};

/// Error of an image study.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A frame cannot be rendered.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// The scene of the study is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The mesh of the study is invalid.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// A GPU operation failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// There are fewer than two grids to compare.
    #[error("{0} grids: expected two or more, the finest of which is the standard of the others")]
    Grids(usize),
}

impl ImageError {
    /// Returns whether the machine failed, rather than the input.
    pub fn is_machine(&self) -> bool {
        match self {
            Self::Synth(SynthError::Gpu(error)) | Self::Gpu(error) => error.is_machine(),
            Self::Synth(SynthError::Memory { .. }) => true,
            Self::Scene(error) => error.is_machine(),
            Self::Synth(_) | Self::Mesh(_) | Self::Grids(_) => false,
        }
    }
}

const fn factor(key: &'static str, label: &'static str) -> Factor {
    Factor { key, label }
}

const BACKEND: Factor = factor("backend", "backend");
const MEDIAN: Axis = Axis::log("median_ms", "ms", "time of a frame (median), ms");
const P95: Axis = Axis::log("p95_ms", "p95 ms", "time of a frame (95 of 100), ms");
const MEMORY: Axis = Axis::log("memory_mb", "MB", "working memory, MB");
const RMS: Axis = Axis::log("rms_grey", "RMS grey", "root mean square error, grey levels of 255");
const P99: Axis = Axis::log(
    "p99_grey",
    "p99 grey",
    "error that 99 of 100 pixels keep to, grey levels",
);
const BIAS: Axis = Axis::linear("bias_grey", "mean grey", "mean difference, grey levels");

/// Axes of a picture: time, memory, error.
const PICTURE: [Axis; 6] = [MEDIAN, P95, MEMORY, RMS, P99, BIAS];

/// Studies images. `progress` receives the current task and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`ImageError`] if a scene or mesh is invalid or a frame cannot be rendered.
pub fn study(options: &ImageOptions, progress: &mut (dyn FnMut(&str, f64) + Send)) -> Result<Study, ImageError> {
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
    let steps: [(&str, f64, Measure); 7] = [
        ("grids of the beam", 0.0, grid::grids),
        ("precisions and backends", 0.55, grid::backends),
        ("labels", 0.65, labels::labels),
        ("effects", 0.7, effects::effects),
        ("shadow and blur", 0.75, sampling::sampling),
        ("texture and grain", 0.85, grain::grains),
        ("point location", 0.93, location::location),
    ];
    let mut tables = Vec::new();
    for (what, share, measure) in steps {
        progress(what, share);
        tables.extend(measure(options, &mut notes)?);
    }
    progress("done", 1.0);
    Ok(Study {
        name: "image",
        title: ENTRY.title,
        about: about(options),
        machine: Machine::here(),
        tables,
        figures: figures(),
        notes,
    })
}

/// Function that measures tables, and notes what it left out.
type Measure = fn(&ImageOptions, &mut Vec<String>) -> Result<Vec<Table>, ImageError>;

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
