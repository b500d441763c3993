//! What was measured, and how it reads.

use std::fmt;

use serde::Serialize;

use crate::study::machine::Machine;
use crate::study::spread::Spread;
use crate::synth::tables::{Anatomy, Settings};

/// Times of one pass.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassSpread {
    /// The pass.
    pub name: &'static str,
    /// Its times; on a GPU by timestamps.
    #[serde(flatten)]
    pub time: Spread,
}

/// A frame with some effects taken away.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rung {
    /// The effect taken away last; none on the first rung.
    pub without: Option<&'static str>,
    /// Passes that are left.
    pub passes: usize,
    /// Wall clock of a frame.
    #[serde(flatten)]
    pub time: Spread,
}

/// What was measured on one backend.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BackendReport {
    /// `cpu`, `cpu-f64` or `gpu`.
    pub backend: &'static str,
    /// Name of the adapter.
    pub adapter: Option<String>,
    /// Whether the adapter is software on the CPU: its times say nothing of a GPU.
    pub software: bool,
    /// A whole frame by wall clock, pixels on the CPU.
    pub frame: Spread,
    /// A whole frame by wall clock, pixels left on the GPU.
    pub frame_left_on_gpu: Option<Spread>,
    /// A whole frame from its first timestamp to its last.
    pub gpu_time: Option<Spread>,
    /// Each pass; empty on a GPU without timestamps.
    pub passes: Vec<PassSpread>,
    /// Working memory, bytes.
    pub memory_bytes: u64,
    /// The frame as effects are taken away one after another, down to slicing alone.
    pub ladder: Vec<Rung>,
}

/// A benchmark of one scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BenchReport {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Scanlines.
    pub lines: usize,
    /// Samples along a scanline.
    pub samples: usize,
    /// Nodes of the deforming mesh; 0 without one.
    pub nodes: usize,
    /// What the CPU backend ran on.
    pub machine: Machine,
    /// Each backend measured.
    pub backends: Vec<BackendReport>,
    /// What was odd.
    pub warnings: Vec<String>,
}

impl BenchReport {
    /// A report of a scene that lacks its backends.
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
        for pass in &self.passes {
            writeln!(
                f,
                "    {:<24} {:>10.3} {:>10.3}",
                pass.name, pass.time.median_ms, pass.time.p95_ms
            )?;
        }
        if self.passes.is_empty() {
            writeln!(f, "    (this device takes no timestamps: no times of single passes)")?;
        }
        writeln!(f, "  effects taken away")?;
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
