//! `insonify bench`: what a frame costs on this machine.

use std::fmt;
use std::time::Duration;

use clap::Args;
use insonify::gpu::{AdapterChoice, Gpu, Needs, adapter};
use insonify::study::bench::{BenchOptions, BenchReport, Contender, bench};
use insonify::synth::{FrameState, SynthError};
use nalgebra::Matrix4;

use super::backend::{BackendArgs, BackendName, needs_of};
use super::failure::Failure;
use super::input::Input;
use super::terminal;

/// Times frames and passes on each backend that the machine has, and as effects are taken away
#[derive(Args)]
pub struct Bench {
    #[command(flatten)]
    input: Input,
    #[command(flatten)]
    backend: BackendArgs,
    /// Frames of each measurement
    #[arg(long, value_name = "N", default_value = "100", value_parser = super::render::frame_count)]
    frames: usize,
    /// Seconds after which a measurement ends early
    #[arg(long, value_name = "S", default_value_t = 4.0, value_parser = seconds)]
    patience_s: f64,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

impl Bench {
    pub fn run(&self) -> Result<(), Failure> {
        self.backend.check()?;
        let scene = self.input.scene(self.json)?;
        let count = scene.frames().min(self.frames);
        let states = (0..count)
            .map(|frame| {
                let mut state = FrameState::at(Matrix4::identity());
                scene.state(frame, count, &mut state)?;
                Ok(state)
            })
            .collect::<Result<Vec<_>, Failure>>()?;
        let options = BenchOptions {
            frames: self.frames,
            patience: Duration::from_secs_f64(self.patience_s),
            ..BenchOptions::default()
        };
        let mut report = BenchReport::new(&scene.anatomy, &scene.settings);
        report.warnings = scene.warnings;
        let needs = needs_of(&scene.anatomy, &scene.settings)?;
        for candidate in self.candidates() {
            if !self.json {
                terminal::say(format_args!("measuring {candidate}"));
            }
            let measured = candidate
                .contender(&needs)
                .and_then(|contender| bench(&scene.anatomy, &scene.settings, &states, &contender, &options));
            match measured {
                Ok(backend) => report.backends.push(backend),
                Err(error @ SynthError::Gpu(_)) if self.backend.backend == BackendName::Auto => {
                    let warning = format!("{candidate} was not measured: {error}");
                    if !self.json {
                        terminal::warn(&warning);
                    }
                    report.warnings.push(warning);
                }
                Err(error) => return Err(error.into()),
            }
        }
        if self.json {
            terminal::emit_json(&report)
        } else {
            terminal::emit(&report.to_string())
        }
    }

    fn candidates(&self) -> Vec<Candidate> {
        let choice = self.backend.choice();
        match self.backend.backend {
            BackendName::Cpu => vec![Candidate::Cpu],
            BackendName::CpuF64 => vec![Candidate::CpuF64],
            BackendName::Gpu => vec![Candidate::Gpu(choice)],
            BackendName::Auto if choice.name.is_some() => vec![Candidate::Cpu, Candidate::Gpu(choice)],
            BackendName::Auto => {
                let adapters = adapter::list().into_iter().map(|adapter| {
                    let name = Some(format!("{} ({})", adapter.name, adapter.backend));
                    Candidate::Gpu(AdapterChoice { name })
                });
                std::iter::once(Candidate::Cpu).chain(adapters).collect()
            }
        }
    }
}

/// A backend that is to be measured, if it opens.
enum Candidate {
    Cpu,
    CpuF64,
    Gpu(AdapterChoice),
}

impl Candidate {
    fn contender(&self, needs: &Needs) -> Result<Contender, SynthError> {
        Ok(match self {
            Self::Cpu => Contender::Cpu,
            Self::CpuF64 => Contender::CpuF64,
            Self::Gpu(choice) => Contender::Gpu(Box::new(Gpu::open(choice, needs)?)),
        })
    }
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("the CPU"),
            Self::CpuF64 => f.write_str("the CPU in double precision"),
            Self::Gpu(AdapterChoice { name: Some(name) }) => f.write_str(name),
            Self::Gpu(_) => f.write_str("the GPU"),
        }
    }
}

/// Seconds on the command line.
pub fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..=3600.0).contains(&seconds) => Ok(seconds),
        _ => Err("expected a number of seconds from 0 to 3600".to_owned()),
    }
}
