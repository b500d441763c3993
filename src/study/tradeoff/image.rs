//! Images: what each way of making one costs, and how many grey levels or millimetres it is off.
//!
//! | table | what is varied | gold standard |
//! |---|---|---|
//! | `image_grid` | scanlines by samples | the finest grid, double precision |
//! | `image_backend` | double and single precision, each GPU | double precision on the CPU |
//! | `image_labels` | label of the nearest voxel or voted, voxel size | closed-form boundaries |
//! | `image_effects` | one effect left out or simpler | every usual effect in double precision |
//! | `image_sampling` | samples down a shadow, scanlines across a blur | the finest of them |
//! | `image_texture` | solid texture (trilinear), constant echo | trilinear in double precision |
//! | `image_lookup` | nearest voxel, trilinear look-up of a texture by itself | trilinear in double precision |
//! | `image_grain` | no grain, additive noise, fully developed speckle | Rayleigh statistics, the lengths asked for |
//! | `image_location` | walk, grid, exhaustive search for the element of a sample | exhaustive search |
//!
//! Grey levels are compared on the scan-converted picture, inside the sector. A level that is brighter or darker as a whole than its
//! standard, or that is further from it than a coarser one, is no approximation and is flagged.

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
use crate::gpu::{Gpu, GpuError};
use crate::mechanics::mesh::InvalidMesh;
use crate::mechanics::mesh::locator::NodeCount;
use crate::scene::SceneError;
use crate::study::machine::Machine;
use crate::study::stability::Effort;
use crate::synth::SynthError;

/// What to study.
#[derive(Debug)]
pub struct ImageOptions {
    /// Scanlines by samples, from the coarsest to the finest, which is the standard of the others and none of the choices (two or
    /// more).
    pub grids: Vec<[u32; 2]>,
    /// Edge of the phantom's voxels, mm.
    pub voxel_mm: f64,
    /// What the grids of the other tables are divided by, 1 or more.
    pub coarsen: u32,
    /// Nodes of the meshes that points are located in.
    pub nodes: Vec<usize>,
    /// Points that are located in each frame.
    pub points: usize,
    /// How long a way is timed, once it has three frames.
    pub patience: Duration,
    /// GPUs to measure beside the CPU.
    pub gpus: Vec<Gpu>,
}

impl ImageOptions {
    /// A study of five minutes at most on two cores.
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

    /// A first look, in seconds.
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

/// This study among all.
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

/// Why images cannot be studied.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A frame cannot be made.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// The scene of the study is none.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The mesh of the study is none.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// Nodes that are not those of the mesh.
    #[error(transparent)]
    Nodes(#[from] NodeCount),
    /// A GPU fails.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// Nothing to compare.
    #[error("{0} grids: expected two or more, the finest of which is the standard of the others")]
    Grids(usize),
}

impl ImageError {
    /// Whether the machine failed, rather than the input.
    pub fn is_machine(&self) -> bool {
        match self {
            Self::Synth(SynthError::Gpu(error)) | Self::Gpu(error) => error.is_machine(),
            Self::Synth(SynthError::Memory { .. }) => true,
            Self::Scene(error) => error.is_machine(),
            Self::Synth(_) | Self::Mesh(_) | Self::Nodes(_) | Self::Grids(_) => false,
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

/// What is known of a picture: time, memory, error.
const PICTURE: [Axis; 6] = [MEDIAN, P95, MEMORY, RMS, P99, BIAS];

/// Studies images. `progress` is told what is being done and the share that is done, ascending from 0 to 1.
///
/// # Errors
/// [`ImageError`].
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

/// Fills tables, and notes what it left out.
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
