//! Benchmarks: what a frame costs on a backend, pass by pass, and how the cost falls as effects are taken away.
//!
//! Whole frames are timed by wall clock with the measurement of passes off, as a simulator would run them; passes are
//! timed in further frames, on the GPU by timestamps where the device offers them. Timestamps of neighbouring passes may
//! overlap, so the passes need not add up to the frame.

use std::fmt;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::machine::Machine;
use crate::gpu::Gpu;
use crate::synth::tables::{Anatomy, Settings};
use crate::synth::{Backend, FrameState, SynthError, Synthesizer};

/// How long to measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchOptions {
    /// Frames of each measurement (1 or more).
    pub frames: usize,
    /// Frames rendered and forgotten before each measurement: caches fill, clocks rise, drivers finish compiling.
    pub warm_up: usize,
    /// A measurement ends early when it has taken this long and has [`LEAST_FRAMES`] frames.
    pub patience: Duration,
}

/// Frames that a measurement has at least, unless fewer are asked for.
pub const LEAST_FRAMES: usize = 5;

impl Default for BenchOptions {
    fn default() -> Self {
        Self {
            frames: 100,
            warm_up: 3,
            patience: Duration::from_secs(4),
        }
    }
}

/// A backend to measure.
pub enum Contender {
    /// The CPU in single precision.
    Cpu,
    /// The CPU in double precision.
    CpuF64,
    /// An opened GPU.
    Gpu(Box<Gpu>),
}

impl Contender {
    fn backend(&self) -> Backend {
        match self {
            Self::Cpu => Backend::Cpu,
            Self::CpuF64 => Backend::CpuF64,
            Self::Gpu(gpu) => Backend::Gpu(gpu.clone()),
        }
    }

    /// Name of the adapter; none on the CPU.
    pub fn adapter(&self) -> Option<&str> {
        match self {
            Self::Gpu(gpu) => Some(&gpu.report().name),
            Self::Cpu | Self::CpuF64 => None,
        }
    }
}

/// Times of a number of frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Half of the frames took at most this, ms.
    pub median_ms: f64,
    /// 95 of 100 frames took at most this, ms.
    pub p95_ms: f64,
    /// Frames a second at the median.
    pub fps: f64,
    /// Frames measured.
    pub frames: usize,
}

impl Spread {
    /// The spread of some times, ms; none of no times. Percentiles are nearest ranks.
    pub fn of(mut ms: Vec<f64>) -> Option<Self> {
        ms.sort_by(f64::total_cmp);
        let rank = |share: f64| {
            let place = (share * ms.len() as f64).ceil() as usize;
            ms.get(place.max(1) - 1).copied()
        };
        let median_ms = rank(0.5)?;
        Some(Self {
            median_ms,
            p95_ms: rank(0.95)?,
            fps: 1000.0 / median_ms.max(f64::MIN_POSITIVE),
            frames: ms.len(),
        })
    }
}

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

/// Measures one backend on a scene; frames go through `states` again and again, and there must be at least one.
pub fn bench(
    anatomy: &Anatomy,
    settings: &Settings,
    states: &[FrameState],
    contender: &Contender,
    options: &BenchOptions,
) -> Result<BackendReport, SynthError> {
    let mut synth = Synthesizer::new(anatomy.clone(), settings.clone(), contender.backend())?;
    let clock = Clock { states, options };
    let frame = clock.wall(&mut synth, |synth, state| synth.render(state).map(drop))?;
    let frame_left_on_gpu = match synth.gpu().cloned() {
        Some(gpu) if synth.render_to_texture(&states[0]).is_ok() => Some(clock.wall(&mut synth, |synth, state| {
            synth.render_to_texture(state)?;
            Ok(gpu.wait("the end of a frame")?)
        })?),
        _ => None,
    };
    let (passes, gpu_time) = clock.passes(&mut synth)?;
    Ok(BackendReport {
        backend: synth.backend(),
        adapter: contender.adapter().map(str::to_owned),
        software: synth.gpu().is_some_and(|gpu| gpu.report().software),
        frame,
        frame_left_on_gpu,
        gpu_time,
        passes,
        memory_bytes: synth.memory_bytes(),
        ladder: clock.ladder(anatomy, synth, contender, frame)?,
    })
}

struct Clock<'a> {
    states: &'a [FrameState],
    options: &'a BenchOptions,
}

impl Clock<'_> {
    /// Calls `work` for frame after frame, some of them unmeasured, and returns what `measure` made of each.
    fn repeat<T>(&self, mut work: impl FnMut(&FrameState) -> Result<T, SynthError>) -> Result<Vec<T>, SynthError> {
        let mut states = self.states.iter().cycle();
        for state in states.by_ref().take(self.options.warm_up) {
            work(state)?;
        }
        let start = Instant::now();
        let mut results = Vec::with_capacity(self.options.frames);
        for state in states.take(self.options.frames.max(1)) {
            results.push(work(state)?);
            if results.len() >= LEAST_FRAMES && start.elapsed() > self.options.patience {
                break;
            }
        }
        Ok(results)
    }

    fn wall(
        &self,
        synth: &mut Synthesizer,
        work: impl Fn(&mut Synthesizer, &FrameState) -> Result<(), SynthError>,
    ) -> Result<Spread, SynthError> {
        let times = self.repeat(|state| {
            let start = Instant::now();
            work(synth, state)?;
            Ok(start.elapsed().as_secs_f64() * 1e3)
        })?;
        // `repeat` measures one frame or more.
        Ok(Spread::of(times).unwrap_or(Spread {
            median_ms: 0.0,
            p95_ms: 0.0,
            fps: 0.0,
            frames: 0,
        }))
    }

    fn passes(&self, synth: &mut Synthesizer) -> Result<(Vec<PassSpread>, Option<Spread>), SynthError> {
        synth.time_passes(true)?;
        let frames = self.repeat(|state| {
            synth.render(state)?;
            Ok((synth.pass_times().to_vec(), synth.gpu_frame_ms()))
        })?;
        synth.time_passes(false)?;
        let names = frames.first().map_or(&[][..], |(passes, _)| passes.as_slice());
        let spread = |index: usize, name: &'static str| {
            let times = frames.iter().filter_map(|(passes, _)| passes.get(index));
            let time = Spread::of(times.map(|pass| pass.ms).collect())?;
            Some(PassSpread { name, time })
        };
        let passes = names.iter().enumerate();
        Ok((
            passes.filter_map(|(index, pass)| spread(index, pass.name)).collect(),
            Spread::of(frames.iter().filter_map(|&(_, whole)| whole).collect()),
        ))
    }

    fn ladder(
        &self,
        anatomy: &Anatomy,
        mut synth: Synthesizer,
        contender: &Contender,
        full: Spread,
    ) -> Result<Vec<Rung>, SynthError> {
        let mut rungs = vec![Rung {
            without: None,
            passes: synth.plan().passes.len(),
            time: full,
        }];
        for removal in REMOVALS {
            let mut settings = synth.settings().clone();
            (removal.take)(&mut settings);
            let warp = removal.effect == "warp";
            if !synth.plan().has(removal.effect) || (!warp && settings == *synth.settings()) {
                continue;
            }
            if warp {
                let rigid = Anatomy {
                    mesh: None,
                    ..anatomy.clone()
                };
                drop(synth);
                synth = Synthesizer::new(rigid, settings, contender.backend())?;
            } else {
                synth.set(settings)?;
            }
            let time = self.wall(&mut synth, |synth, state| synth.render(state).map(drop))?;
            rungs.push(Rung {
                without: Some(removal.effect),
                passes: synth.plan().passes.len(),
                time,
            });
        }
        Ok(rungs)
    }
}

/// An effect that a frame can do without, and how to take it away.
struct Removal {
    effect: &'static str,
    take: fn(&mut Settings),
}

/// What is taken away, from the last stage of a frame to the first.
const REMOVALS: &[Removal] = &[
    Removal {
        effect: "noise",
        take: |settings| settings.effects.noise = None,
    },
    Removal {
        effect: "tone",
        take: |settings| settings.effects.tone = None,
    },
    Removal {
        effect: "blur",
        take: |settings| settings.effects.blur = None,
    },
    Removal {
        effect: "shadow",
        take: |settings| settings.effects.shadow = None,
    },
    Removal {
        effect: "needle",
        take: |settings| {
            settings.effects.needle = None;
            settings.has_needle = false;
        },
    },
    Removal {
        effect: "interface",
        take: |settings| settings.effects.interface = None,
    },
    Removal {
        effect: "speckle",
        take: |settings| settings.effects.speckle = None,
    },
    Removal {
        effect: "thickness",
        take: |settings| settings.effects.thickness = None,
    },
    Removal {
        effect: "texture",
        take: |settings| settings.effects.texture = None,
    },
    Removal {
        effect: "warp",
        take: |_| {},
    },
];

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

#[cfg(test)]
mod tests;
