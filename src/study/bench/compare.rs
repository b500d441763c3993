//! Comparison of GPU and CPU: passes, solvers, image sizes, transfers, and the cost of each effect.
//!
//! | table | contents |
//! |---|---|
//! | `compare_passes` | times of frames and passes on the CPU (single precision) and on a GPU, by size, and their ratio |
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
use crate::tradeoff::remesh::{RemeshOptions, study};
use crate::tradeoff::{Axis, Factor, Figure, Row, Study, Table};
use insonify::Error;
use insonify_base::document::InputError;
use insonify_base::machine::Machine;
use insonify_gpu::Gpu;
use insonify_imaging::effects::parameters::Slice;
use insonify_imaging::effects::{Effects, Stage};
use insonify_imaging::scene::{Scene, SceneFile};
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{FrameState, SynthError, Synthesizer};

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
    /// Grids of scanlines by samples, ascending. The picture has 2.5 columns per scanline and an aspect ratio of 4 to 3.
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
    let crossing = crossing(&[&passes, &solvers]);
    let mut tables = vec![passes, crossing];
    tables.extend(passes::transfers(subject, options)?);
    tables.push(solvers);
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

fn ratio(cpu: Option<f64>, gpu: Option<f64>) -> Option<f64> {
    cpu.zip(gpu).map(|(cpu, gpu)| cpu / gpu.max(1e-6))
}

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

/// Measures the levels available on both, in single precision; the remeshing study covers errors and the other levels.
pub fn solvers(options: &CompareOptions) -> Result<Table, Error> {
    let factors = [
        Factor::new("gpu", "GPU"),
        Factor::new("what", "what"),
        Factor::new("nodes", "nodes"),
    ];
    let axes = [
        Axis::log("dofs", "dofs", "free degrees of freedom"),
        CPU_MS,
        GPU_MS,
        Axis::log(
            "device_ms",
            "of it computing",
            "time of the update on the device (median), ms",
        ),
        RATIO,
    ];
    let title = "Remeshing, single precision: one move with its K^c, transfers included";
    let mut table = Table::new("compare_solvers", title, &factors, &axes);
    let meshes = options.nodes.iter().map(|&nodes| generated(nodes));
    let meshes = meshes.collect::<Result<Vec<_>, _>>()?;
    let remeshing = RemeshOptions {
        moves: MOVES,
        updates: options.updates,
        patience: 4 * options.patience + Duration::from_millis(200),
        ..RemeshOptions::default()
    };
    let found = study(&meshes, &options.gpus, &remeshing, &mut |_, _| {})?;
    let Some(remesh) = found.tables.iter().find(|table| table.key == "remesh") else {
        return Ok(table);
    };
    let choice = |row: &Row, key: &str| {
        let at = remesh.factors.iter().position(|factor| factor.key == key)?;
        Some(row.choices[at].clone())
    };
    let value = |row: &Row, key: &str| row.values[remesh.axes.iter().position(|axis| axis.key == key)?];
    // GPUs run these levels in single precision: against rows in f64 the ratio would compare precisions too.
    let single: Vec<&Row> = remesh
        .rows
        .iter()
        .filter(|row| choice(row, "precision").is_some_and(|precision| precision.contains("32")))
        .collect();
    for row in single
        .iter()
        .filter(|row| choice(row, "backend").as_deref() == Some("CPU"))
    {
        let alike = |other: &&&Row| {
            ["nodes", "level"]
                .iter()
                .all(|key| choice(other, key) == choice(row, key))
        };
        let on_gpus: Vec<&&Row> = single
            .iter()
            .filter(alike)
            .filter(|other| choice(other, "backend").as_deref() != Some("CPU"))
            .collect();
        let names = |gpu: String| {
            let level = choice(row, "level").unwrap_or_default();
            vec![
                gpu,
                format!("remeshing, level {level}"),
                choice(row, "nodes").unwrap_or_default(),
            ]
        };
        let (dofs, cpu) = (value(row, "dofs"), value(row, "median_ms"));
        for other in &on_gpus {
            let gpu = value(other, "median_ms");
            let values = vec![dofs, cpu, gpu, value(other, "device_ms"), ratio(cpu, gpu)];
            table.push(names(choice(other, "backend").unwrap_or_default()), values, None);
        }
        if on_gpus.is_empty() {
            table.push(names("none".to_owned()), vec![dofs, cpu, None, None, None], None);
        }
    }
    Ok(table)
}

/// Finds, for each GPU and item in the tables (GPU, item, size; with a ratio as the last value), the size from which the ratio stays above
/// 1, or the largest size at which it does not.
pub fn crossing(tables: &[&Table]) -> Table {
    let factors = [
        Factor::new("gpu", "GPU"),
        Factor::new("what", "what"),
        Factor::new("wins", "the GPU wins"),
    ];
    let axes = [
        Axis::log("ratio_smallest", "at smallest", "CPU over GPU at the smallest size"),
        Axis::log(
            "ratio_largest",
            "at largest",
            "CPU over GPU at the largest size that both did",
        ),
    ];
    let title = "From which size on the GPU wins";
    let mut table = Table::new("compare_crossing", title, &factors, &axes);
    let mut seen: Vec<&[String]> = Vec::new();
    let rows = || tables.iter().flat_map(|table| &table.rows);
    for row in rows() {
        let key = &row.choices[..2];
        if seen.contains(&key) {
            continue;
        }
        seen.push(key);
        let own = rows().filter(|other| other.choices[..2] == *key);
        let both: Vec<(&Row, f64)> = own
            .filter_map(|row| Some((row, row.values.last().copied()??)))
            .collect();
        let (Some(first), Some(last)) = (both.first(), both.last()) else {
            continue;
        };
        // After the last size at which the CPU is as fast: times scatter near the crossing, and one lucky
        // measurement of the GPU must not decide.
        let wins = both.iter().rposition(|(_, ratio)| *ratio <= 1.0).map_or(0, |at| at + 1);
        let size = |row: &Row| row.choices[2].clone();
        let words = match both.get(wins) {
            Some((row, _)) if wins == 0 => format!("from the smallest, {}", size(row)),
            Some((row, _)) => format!("from {}", size(row)),
            None => format!("never up to {}", size(last.0)),
        };
        let mut choices = key.to_vec();
        choices.push(words);
        table.push(choices, vec![Some(first.1), Some(last.1)], None);
    }
    table
}

#[cfg(test)]
mod tests;
