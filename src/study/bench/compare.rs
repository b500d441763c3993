//! GPU against CPU: every pass, solver and size of image, transfers apart; and what each effect costs alone and in company.
//!
//! | table | what it holds |
//! |---|---|
//! | `compare_passes` | times of frames and passes on the CPU (single precision) and on a GPU, by size, and their ratio |
//! | `compare_crossing` | the size from which the GPU wins, for each of them |
//! | `compare_transfers` | what goes to and from the device, apart from what is computed there |
//! | `compare_solvers` | remeshing levels on the CPU and on a GPU, by size of the mesh |
//! | `compare_effects` | a frame with everything, without each effect, and with each effect alone |
//! | `compare_memory` | bytes that each effect calls for, and that are left of them where the scene does without |
//!
//! Times of passes on a GPU are by its timestamps; a device without them is compared in whole frames.

mod crossing;
mod effects;
mod passes;
mod solvers;
#[cfg(test)]
mod tests;
mod transfers;

use std::time::{Duration, Instant};

use super::{BenchOptions, Clock};
use crate::gpu::{Gpu, GpuError};
use crate::mechanics::mesh::InvalidMesh;
use crate::study::machine::Machine;
use crate::study::tradeoff::remesh::StudyError;
use crate::study::tradeoff::{Axis, Factor, Figure, Study};
use crate::synth::tables::{Anatomy, Settings};
use crate::synth::{FrameState, SynthError, Synthesizer};

/// A scene with everything that a frame can have: what is compared where no scene is named.
pub const SCENE: &str = r#"
version = 1
volume = { phantom = "abdomen" }
needle = { tip_mm = [-52.3, -20.2, -25.1], entry_mm = [-32.0, -79.6, -7.1] }

[deform]
nodes = 5000
field = { kind = "indentation", centre_mm = [-52.3, -20.2, -25.1], direction = [0, 1, 0], depth_mm = 4, radius_mm = 15 }

[effects]
contact = {}
texture = {}
thickness = {}
speckle = {}
interface = {}
needle = {}
shadow = {}
blur = {}
receiver = {}
tone = {}
noise = {}
"#;

/// What to compare, and for how long.
#[derive(Debug)]
pub struct CompareOptions {
    /// Scanlines by samples, ascending. A picture has 2.5 pixels across for each scanline, 4 by 3.
    pub grids: Vec<[u32; 2]>,
    /// The grid under which effects are taken away.
    pub effects_grid: [u32; 2],
    /// How long each measurement takes, once it has three frames.
    pub patience: Duration,
    /// A backend whose frame took longer is not asked for a larger one, ms.
    pub most_ms: f64,
    /// Nodes of the meshes whose remeshing is compared, ascending.
    pub nodes: Vec<usize>,
    /// Remeshes of each.
    pub updates: usize,
    /// The GPUs; without one the CPU's part is measured.
    pub gpus: Vec<Gpu>,
}

impl CompareOptions {
    /// Some minutes with software Vulkan on two cores.
    pub fn usual(gpus: Vec<Gpu>) -> Self {
        Self {
            grids: vec![[64, 128], [128, 256], [256, 512], [512, 1024], [1024, 2048]],
            // Software takes ten times as long as the CPU, over dozens of frames.
            effects_grid: match gpus.iter().any(|gpu| gpu.report().software) {
                true => [128, 256],
                false => [256, 512],
            },
            patience: Duration::from_millis(200),
            most_ms: 300.0,
            nodes: vec![200, 500],
            updates: 12,
            gpus,
        }
    }
}

/// Why backends cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// A frame cannot be made.
    #[error(transparent)]
    Synth(#[from] SynthError),
    /// A GPU fails.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// There is no such mesh.
    #[error(transparent)]
    Mesh(#[from] InvalidMesh),
    /// Solvers cannot be measured.
    #[error(transparent)]
    Solvers(#[from] StudyError),
}

impl CompareError {
    /// Whether the machine failed, rather than the input.
    pub fn is_machine(&self) -> bool {
        match self {
            Self::Synth(SynthError::Gpu(error)) | Self::Gpu(error) => error.is_machine(),
            Self::Synth(error) => matches!(error, SynthError::Memory { .. }),
            Self::Mesh(_) => false,
            Self::Solvers(error) => error.is_machine(),
        }
    }
}

/// The scene that frames are made of.
pub struct Subject<'a> {
    /// What is imaged.
    pub anatomy: &'a Anatomy,
    /// How.
    pub settings: &'a Settings,
    /// The frame.
    pub state: &'a FrameState,
}

impl Subject<'_> {
    /// The settings under a grid, with a picture that goes with it.
    fn sized(&self, [lines, samples]: [u32; 2]) -> Settings {
        let mut settings = self.settings.clone();
        (settings.probe.lines, settings.probe.samples) = (lines, samples);
        let width = (lines as usize * 5 / 2).max(4);
        (settings.image.width, settings.image.height) = (width, width * 3 / 4);
        settings
    }
}

/// Compares. `progress` is told what is being done and the share that is done, ascending from 0 to 1.
///
/// # Errors
/// [`CompareError`].
pub fn compare(
    subject: &Subject<'_>,
    options: &CompareOptions,
    progress: &mut (dyn FnMut(&str, f64) + Send),
) -> Result<Study, CompareError> {
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
    let solvers = solvers::solvers(options)?;
    progress("transfers", 0.6);
    let crossing = crossing::crossing(&[&passes, &solvers]);
    let mut tables = vec![passes, crossing];
    tables.extend(transfers::transfers(subject, options)?);
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

const fn factor(key: &'static str, label: &'static str) -> Factor {
    Factor { key, label }
}

const CPU_MS: Axis = Axis::log("cpu_ms", "CPU ms", "time on the CPU (median), ms");
const GPU_MS: Axis = Axis::log("gpu_ms", "GPU ms", "time on the GPU (median), ms");
const RATIO: Axis = Axis::log("ratio", "CPU/GPU", "time on the CPU over time on the GPU");

fn ratio(cpu: Option<f64>, gpu: Option<f64>) -> Option<f64> {
    cpu.zip(gpu).map(|(cpu, gpu)| cpu / gpu.max(1e-6))
}

fn figures() -> Vec<Figure> {
    let ratios = passes::STAGES.into_iter().map(|stage| Figure {
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

/// How a backend renders a scene at one size: the first frame, timed, says how many more there is patience for.
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
