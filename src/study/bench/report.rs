//! Results of a benchmark, and their output.

use std::fmt;

use serde::Serialize;

use insonify_base::machine::Machine;
use insonify_base::statistics::Spread;
use insonify_imaging::synth::tables::{Anatomy, Settings};

/// Times of one pass.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassSpread {
    /// Name of the pass.
    pub name: &'static str,
    /// Times of the pass, on a GPU from timestamps.
    #[serde(flatten)]
    pub time: Spread,
}

/// Measurement of a frame with some effects removed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rung {
    /// Effect removed last; `None` on the first rung.
    pub without: Option<&'static str>,
    /// Number of remaining passes.
    pub passes: usize,
    /// Wall-clock times of a frame.
    #[serde(flatten)]
    pub time: Spread,
}

/// Frames a second in batches of independent frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BatchRates {
    /// Pixels in memory.
    pub fps: f64,
    /// Pixels written to a folder of PNG files; `None` if they cannot be written.
    pub png_fps: Option<f64>,
}

/// Costs of a frame on a GPU besides the work of its passes, means over frames.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Exchange {
    /// Time from the state of a frame to its submission, on the CPU.
    pub before_submission: Spread,
    /// Dispatches of fused passes, the image in one piece.
    pub dispatches: usize,
    /// Writes to buffers.
    pub uploads: f64,
    /// Submissions.
    pub submissions: f64,
    /// Times that the CPU waited for the device.
    pub waits: f64,
    /// Bytes sent to the device, kB.
    pub up_kb: f64,
    /// Bytes fetched from the device, kB.
    pub down_kb: f64,
}

/// Measurements of one backend.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BackendReport {
    /// `cpu`, `cpu-f64` or `gpu`.
    pub backend: &'static str,
    /// Name of the adapter; `None` on the CPU.
    pub adapter: Option<String>,
    /// Whether the adapter is software on the CPU, whose times are not representative of a GPU.
    pub software: bool,
    /// Wall-clock times of a frame, pixels read back to the CPU.
    pub frame: Spread,
    /// Wall-clock times of a frame with the pixels left on the GPU.
    pub frame_left_on_gpu: Option<Spread>,
    /// Times of a frame from its first GPU timestamp to its last.
    pub gpu_time: Option<Spread>,
    /// Dispatches, waits and transfers; `None` on the CPU.
    pub exchange: Option<Exchange>,
    /// Times of each pass; empty on a GPU without timestamps.
    pub passes: Vec<PassSpread>,
    /// Rates of frames in batches.
    pub batch: BatchRates,
    /// Working memory, bytes.
    pub memory_bytes: u64,
    /// Frame times as effects are removed one after another, down to slicing alone.
    pub ladder: Vec<Rung>,
}

/// Benchmark of one scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchReport {
    /// Columns of the image.
    pub width: usize,
    /// Rows of the image.
    pub height: usize,
    /// Number of scanlines.
    pub lines: usize,
    /// Samples along a scanline.
    pub samples: usize,
    /// Number of nodes of the deforming mesh; 0 without one.
    pub nodes: usize,
    /// Machine that the CPU backend ran on.
    pub machine: Machine,
    /// Measurements of each backend.
    pub backends: Vec<BackendReport>,
    /// Warnings about the measurements.
    pub warnings: Vec<String>,
}

impl BenchReport {
    /// Creates a report of a scene, still without backends.
    pub fn new(anatomy: &Anatomy, settings: &Settings) -> Self {
        Self {
            width: settings.image.width,
            height: settings.image.height,
            lines: settings.probe.lines as usize,
            samples: settings.probe.samples as usize,
            nodes: anatomy.mesh.as_ref().map_or(0, |mesh| mesh.nodes().len()),
            machine: Machine::here(),
            backends: Vec::new(),
            warnings: Vec::new(),
        }
    }
}

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            width,
            height,
            lines,
            samples,
            nodes,
            machine,
            ..
        } = self;
        writeln!(f, "{lines} scanlines x {samples} samples to {width}x{height} pixels")?;
        if *nodes > 0 {
            writeln!(f, "mesh of {nodes} nodes")?;
        }
        writeln!(f, "machine: {machine}")?;
        for backend in &self.backends {
            write!(f, "\n{backend}")?;
        }
        Ok(())
    }
}

impl fmt::Display for BackendReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.backend)?;
        if let Some(adapter) = &self.adapter {
            write!(f, " on {adapter}")?;
        }
        if self.software {
            write!(f, " (software: right for checking, not for speed)")?;
        }
        let mib = self.memory_bytes as f64 / f64::from(1 << 20);
        writeln!(f, ", {mib:.1} MiB of working memory")?;
        writeln!(
            f,
            "  {:<26} {:>10} {:>10} {:>10}",
            "", "median ms", "p95 ms", "frames/s"
        )?;
        row(f, "frame", &self.frame)?;
        if let Some(time) = &self.frame_left_on_gpu {
            row(f, "frame left on the GPU", time)?;
        }
        if let Some(time) = &self.gpu_time {
            row(f, "frame by GPU timestamps", time)?;
        }
        if let Some(exchange) = &self.exchange {
            let before = &exchange.before_submission;
            writeln!(
                f,
                "  {:<26} {:>10.3} {:>10.3}",
                "on the CPU, before it", before.median_ms, before.p95_ms
            )?;
            writeln!(
                f,
                "  a frame: {} dispatches; uploads {:.1}, submissions {:.1}, waits {:.1}; {:.0} kB up, {:.0} kB down",
                exchange.dispatches,
                exchange.uploads,
                exchange.submissions,
                exchange.waits,
                exchange.up_kb,
                exchange.down_kb
            )?;
        }
        // Fused passes cannot be timed apart; run one by one, they need not add up to the time of a frame.
        if self.exchange.is_some() && !self.passes.is_empty() {
            writeln!(f, "  passes one by one (in a frame they are fused)")?;
        }
        for pass in &self.passes {
            writeln!(
                f,
                "    {:<24} {:>10.3} {:>10.3}",
                pass.name, pass.time.median_ms, pass.time.p95_ms
            )?;
        }
        if self.passes.is_empty() {
            writeln!(
                f,
                "    (this device does not support timestamps; pass times are unavailable)"
            )?;
        }
        let BatchRates { fps, png_fps } = self.batch;
        writeln!(f, "  {:<48} {fps:>10.1}", "batch of independent frames")?;
        if let Some(fps) = png_fps {
            writeln!(f, "  {:<48} {fps:>10.1}", "such a batch, written as PNG")?;
        }
        writeln!(f, "  effects removed one after another")?;
        for rung in &self.ladder {
            let name = match rung.without {
                None => "all effects".to_owned(),
                Some(effect) => format!("- {effect}"),
            };
            row(f, &format!("  {name}"), &rung.time)?;
        }
        Ok(())
    }
}

fn row(f: &mut fmt::Formatter<'_>, name: &str, time: &Spread) -> fmt::Result {
    writeln!(
        f,
        "  {name:<26} {:>10.3} {:>10.3} {:>10.1}",
        time.median_ms, time.p95_ms, time.fps
    )
}
