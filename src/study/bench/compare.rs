//! Comparison of GPU and CPU: passes, solvers, image sizes, transfers, and the cost of each effect.
//!
//! | table | contents |
//! |---|---|
//! | `compare_passes` | times of frames and passes on the CPU (single precision) and on a GPU, by size |
//! | `compare_crossing` | size from which the GPU is faster, for each frame, pass and solver |
//! | `compare_transfers` | transfers to and from the device, without computation |
//! | `compare_solvers` | remeshing levels on the CPU and on a GPU, by size of the mesh |
//! | `compare_effects` | a frame with all effects, without each effect, and with each effect alone |
//! | `compare_memory` | bytes needed by each effect, and bytes left after its removal |
//!
//! Pass times on a GPU come from its timestamps; a device without them is compared in whole frames only.

mod effects;
mod passes;

use std::time::{Duration, Instant};

use super::{BenchOptions, Clock};
use crate::tradeoff::remesh::subject::generated;
use crate::tradeoff::remesh::{self, Kind, RemeshOptions, RemeshRow};
use crate::tradeoff::{Axis, Choice, Column, Factor, Figure, Study, Table};
use insonify::Error;
use insonify_base::document::InputError;
use insonify_base::machine::Machine;
use insonify_gpu::Gpu;
use insonify_imaging::effects::parameters::Slice;
use insonify_imaging::effects::{Effects, Stage};
use insonify_imaging::scene::{Scene, SceneFile};
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{FrameState, SynthError, Synthesizer};
use insonify_mechanics::tissue::remesh::Precision;

/// Deformed tissue and a needle.
const SCENE: &str = r#"
volume = { phantom = "abdomen" }
needle = { tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }

[deform]
nodes = 5000
field = { kind = "indentation", centre_mm = [-52.3, -20.2, -25.1], direction = [0, 1, 0], depth_mm = 4, radius_mm = 15 }
"#;

/// Default scene, with every effect that a frame can have.
///
/// # Errors
/// [`InputError`] if the phantom does not fit into memory.
pub fn scene() -> Result<Scene, InputError> {
    let mut scene = SceneFile::parse(SCENE, "the scene of --compare")?.resolve("".as_ref())?;
    scene.settings.effects = Effects {
        slice: Slice::default(),
        ..Effects::all()
    };
    Ok(scene)
}

/// Sizes and durations of a comparison.
#[derive(Debug)]
pub struct CompareOptions {
    /// Grids of scanlines by samples, ascending. The picture has 2.5 columns per scanline and an aspect ratio of 4
    /// to 3.
    pub grids: Vec<[u32; 2]>,
    /// Grid used for the removal of effects.
    pub effects_grid: [u32; 2],
    /// Duration of each measurement, which has at least three frames.
    pub patience: Duration,
    /// Longest frame time, ms, after which a backend is not measured at larger sizes.
    pub most_ms: f64,
    /// Numbers of nodes of the meshes for the remeshing comparison, ascending.
    pub nodes: Vec<usize>,
    /// Number of remeshes of each mesh.
    pub updates: usize,
    /// GPUs to compare; if empty, only the CPU is measured.
    pub gpus: Vec<Gpu>,
}

impl CompareOptions {
    /// Returns the default options, which take some minutes with software Vulkan on two cores.
    pub fn usual(gpus: Vec<Gpu>) -> Self {
        Self {
            grids: vec![[64, 128], [128, 256], [256, 512], [512, 1024], [1024, 2048]],
            // Software takes ten times as long as the CPU, over dozens of frames.
            effects_grid: if gpus.iter().any(|gpu| gpu.report().software) {
                [128, 256]
            } else {
                [256, 512]
            },
            patience: Duration::from_millis(200),
            most_ms: 300.0,
            nodes: vec![200, 500],
            updates: 12,
            gpus,
        }
    }
}

/// Scene to render.
pub struct Subject<'a> {
    /// Anatomy to image.
    pub anatomy: &'a Anatomy,
    /// Rendering settings.
    pub settings: &'a Settings,
    /// State of the frame.
    pub state: &'a FrameState,
}

impl Subject<'_> {
    /// Returns the settings for a grid, with a matching image size.
    fn sized(&self, [lines, samples]: [u32; 2]) -> Settings {
        let mut settings = self.settings.clone();
        (settings.probe.lines, settings.probe.samples) = (lines, samples);
        let width = (lines as usize * 5 / 2).max(4);
        (settings.image.width, settings.image.height) = (width, width * 3 / 4);
        settings
    }
}

/// Runs the comparison. `progress` receives the current task and the completed fraction, increasing from 0 to 1.
///
/// # Errors
/// [`Error`] if a scene cannot be rendered or a solver cannot be measured.
pub fn compare(
    subject: &Subject<'_>,
    options: &CompareOptions,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<Study, Error> {
    let mut notes = Vec::new();
    if options.gpus.is_empty() {
        notes.push("no GPU adapter: what follows is the CPU's part".to_owned());
    }
    for gpu in options.gpus.iter().filter(|gpu| gpu.report().software) {
        notes.push(format!(
            "{} is software on the CPU: its ratios say nothing of a GPU",
            gpu.report().name
        ));
    }
    progress("frames and passes", 0.0);
    let passes = passes::passes(subject, options, &mut notes)?;
    progress("solvers", 0.45);
    let solvers = solvers(options)?;
    progress("transfers", 0.6);
    // Only these two have a size and a ratio of both processors; transfers and effects have nothing to cross.
    let ratios: Vec<_> = ratios(&passes).chain(ratios(&solvers)).collect();
    let mut tables = vec![passes::table(&passes), crossing(&ratios)];
    tables.extend(passes::transfers(subject, options)?);
    let title = "Remeshing, single precision: one move with its K^c, transfers included";
    let of_nodes = choices(Factor::new("nodes", "nodes"));
    tables.push(Table::of("compare_solvers", title, &of_nodes, &SOLVERS, &solvers));
    progress("effects", 0.65);
    tables.push(effects::effects(subject, options)?);
    tables.push(effects::memory(subject, options)?);
    progress("done", 1.0);
    let nodes = subject.anatomy.mesh.as_ref().map_or(0, |mesh| mesh.nodes().len());
    Ok(Study {
        name: "compare",
        title: "GPU against CPU",
        about: vec![
            ("mesh", format!("{nodes} nodes, moved in every frame")),
            (
                "effects",
                format!("at {} x {}", options.effects_grid[0], options.effects_grid[1]),
            ),
        ],
        machine: Machine::here(),
        tables,
        figures: figures(),
        notes,
    })
}

const CPU_MS: Axis = Axis::log("cpu_ms", "CPU ms", "time on the CPU (median), ms");
const GPU_MS: Axis = Axis::log("gpu_ms", "GPU ms", "time on the GPU (median), ms");
const RATIO: Axis = Axis::log("ratio", "CPU/GPU", "time on the CPU over time on the GPU");

const GPU: Factor = Factor::new("gpu", "GPU");
const WHAT: Factor = Factor::new("what", "what");

fn figures() -> Vec<Figure> {
    let stages = [passes::FRAME].into_iter().chain(Stage::ALL.map(Stage::name));
    let ratios = stages.map(|stage| Figure {
        only: vec![("stage", stage.to_owned())],
        ..Figure::new(
            format!("compare-ratio-{stage}"),
            format!("How many times as fast the GPU is: {stage}"),
            "compare_passes",
            ["samples", "ratio"],
            "what",
        )
    });
    let on_cpu = Figure {
        only: vec![("what", passes::WHOLE.to_owned())],
        ..Figure::new(
            "compare-frame",
            "A frame on the CPU",
            "compare_passes",
            ["samples", "cpu_ms"],
            "what",
        )
    };
    ratios.chain([on_cpu]).collect()
}

/// Chooses the number of frames for a scene at one size from the time of a second frame and `patience`.
fn clock_options(synth: &mut Synthesizer, state: &FrameState, patience: Duration) -> Result<BenchOptions, SynthError> {
    synth.render(state)?;
    let start = Instant::now();
    synth.render(state)?;
    let frame = start.elapsed().as_secs_f64();
    Ok(BenchOptions {
        frames: (patience.as_secs_f64() / frame.max(1e-6)).clamp(3.0, 60.0) as usize,
        warm_up: 0,
        patience,
    })
}

/// Number of moves per insertion.
const MOVES: usize = 6;

/// Times of one thing on both processors, where measured.
struct Compared<T> {
    /// Name of the GPU.
    gpu: String,
    what: String,
    size: String,
    cpu_ms: Option<f64>,
    gpu_ms: Option<f64>,
    /// Further columns.
    beside: T,
}

impl<T> Compared<T> {
    /// Time on the CPU over time on the GPU.
    fn ratio(&self) -> Option<f64> {
        Some(self.cpu_ms? / self.gpu_ms?.max(1e-6))
    }
}

/// GPU, item and size, and the ratio of the times.
type Ratio<'a> = ([&'a str; 3], f64);

/// Ratios of all that was measured on both processors.
fn ratios<T>(rows: &[Compared<T>]) -> impl Iterator<Item = Ratio<'_>> {
    rows.iter()
        .filter_map(|row| Some(([row.gpu.as_str(), row.what.as_str(), row.size.as_str()], row.ratio()?)))
}

const fn choices<T>(size: Factor) -> [Choice<Compared<T>>; 3] {
    [
        GPU.of(|row: &Compared<T>| row.gpu.clone()),
        WHAT.of(|row: &Compared<T>| row.what.clone()),
        size.of(|row: &Compared<T>| row.size.clone()),
    ]
}

/// Columns of a solver beside its times.
struct Solved {
    dofs: f64,
    device_ms: Option<f64>,
}

const SOLVERS: [Column<Compared<Solved>>; 5] = [
    Axis::log("dofs", "dofs", "free degrees of freedom").of(|row| Some(row.beside.dofs)),
    CPU_MS.of(|row| row.cpu_ms),
    GPU_MS.of(|row| row.gpu_ms),
    Axis::log(
        "device_ms",
        "of it computing",
        "time of the update on the device (median), ms",
    )
    .of(|row| row.beside.device_ms),
    RATIO.of(Compared::ratio),
];

/// Measures the levels available on both, in single precision; the remeshing study covers errors and the other levels.
fn solvers(options: &CompareOptions) -> Result<Vec<Compared<Solved>>, Error> {
    let meshes = options.nodes.iter().map(|&nodes| generated(nodes));
    let meshes = meshes.collect::<Result<Vec<_>, _>>()?;
    let remeshing = RemeshOptions {
        moves: MOVES,
        updates: options.updates,
        patience: 4 * options.patience + Duration::from_millis(200),
        ..RemeshOptions::default()
    };
    let rows = remesh::rows(&meshes, &options.gpus, &remeshing)?;
    let mut compared = Vec::new();
    for on_cpu in &rows {
        // GPUs run these levels in single precision: against rows in f64 the ratio would compare precisions too.
        let Kind::Dense(level, Precision::Single) = &on_cpu.kind else {
            continue;
        };
        let row = |gpu: String, on_gpu: Option<&RemeshRow>| Compared {
            gpu,
            what: format!("remeshing, level {level}"),
            size: on_cpu.nodes.to_string(),
            cpu_ms: on_cpu.median_ms(),
            gpu_ms: on_gpu.and_then(RemeshRow::median_ms),
            beside: Solved {
                dofs: on_cpu.dofs(),
                device_ms: on_gpu.and_then(RemeshRow::device_ms),
            },
        };
        let is_alike = |other: &&RemeshRow| {
            other.nodes == on_cpu.nodes && matches!(&other.kind, Kind::Device(of, _) if of == level)
        };
        let on_gpus = rows.iter().filter(is_alike);
        let on_gpus: Vec<_> = on_gpus.map(|on_gpu| row(on_gpu.kind.backend(), Some(on_gpu))).collect();
        if on_gpus.is_empty() {
            compared.push(row("none".to_owned(), None));
        }
        compared.extend(on_gpus);
    }
    Ok(compared)
}

/// Size from which on a GPU is faster at an item.
struct Crossing {
    gpu: String,
    what: String,
    /// The size in words.
    wins: String,
    /// Ratios at the smallest and the largest size.
    ratios: [f64; 2],
}

const CROSSING_CHOICES: [Choice<Crossing>; 3] = [
    GPU.of(|row| row.gpu.clone()),
    WHAT.of(|row| row.what.clone()),
    Factor::new("wins", "the GPU wins").of(|row| row.wins.clone()),
];

const CROSSING_COLUMNS: [Column<Crossing>; 2] = [
    Axis::log("ratio_smallest", "at smallest", "CPU over GPU at the smallest size").of(|row| Some(row.ratios[0])),
    Axis::log(
        "ratio_largest",
        "at largest",
        "CPU over GPU at the largest size that both did",
    )
    .of(|row| Some(row.ratios[1])),
];

/// Finds, for each GPU and item, the size from which the ratio stays above 1, or the largest size at which it does not.
fn crossing(ratios: &[Ratio<'_>]) -> Table {
    let mut crossings: Vec<Crossing> = Vec::new();
    for &([gpu, what, _], smallest) in ratios {
        if crossings.iter().any(|seen| seen.gpu == gpu && seen.what == what) {
            continue;
        }
        let alike = ratios.iter().filter(|(names, _)| names[..2] == [gpu, what]);
        let sizes: Vec<(&str, f64)> = alike.map(|&([_, _, size], ratio)| (size, ratio)).collect();
        let (largest_size, largest) = sizes[sizes.len() - 1];
        // After the last size at which the CPU is as fast: times scatter near the crossing, and one lucky
        // measurement of the GPU must not decide.
        let first_won = sizes
            .iter()
            .rposition(|(_, ratio)| *ratio <= 1.0)
            .map_or(0, |lost| lost + 1);
        let wins = match sizes.get(first_won) {
            Some((size, _)) if first_won == 0 => format!("from the smallest, {size}"),
            Some((size, _)) => format!("from {size}"),
            None => format!("never up to {largest_size}"),
        };
        crossings.push(Crossing {
            gpu: gpu.to_owned(),
            what: what.to_owned(),
            wins,
            ratios: [smallest, largest],
        });
    }
    let title = "From which size on the GPU wins";
    Table::of(
        "compare_crossing",
        title,
        &CROSSING_CHOICES,
        &CROSSING_COLUMNS,
        &crossings,
    )
}

#[cfg(test)]
mod tests;
