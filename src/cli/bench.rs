//! `insonify bench`: frame times on this machine.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use insonify_gpu::adapter::{self, SOFTWARE};
use insonify_gpu::{AdapterChoice, AdapterReport};
use insonify_imaging::synth::{Backend, FrameState, SynthError};
use insonify_study::bench::compare::{CompareOptions, Subject, compare, scene};
use insonify_study::bench::{BenchOptions, BenchReport, bench};
use insonify_study::tradeoff::gather::Devices;
use nalgebra::Matrix4;

use super::backend::{BackendArgs, BackendName};
use super::failure::{Error, usage};
use super::input::Input;
use super::output::Force;
use super::study::Printed;
use super::terminal;
use super::variants::ranged;

const TEACHING: &str = "\
Without --compare one scene is timed at its own size. With it, GPU and CPU are compared:

  frames and passes  from 64 x 128 to 1024 x 2048 scanlines by samples, and the size from which the GPU wins
  transfers          what a frame sends and reads back, apart from what is computed
  solvers            remeshing levels by size of the mesh
  effects            a frame with everything, without each effect and with each alone
  memory             bytes held by each effect, and a check that none remain in a scene that omits it

Without a hardware GPU it says so and measures the CPU's part; --adapter NAME takes a software one. Without a scene it takes one with every effect, a mesh and a needle.

Examples:
  insonify bench                               the default scene on the CPU and every hardware GPU
  insonify bench scene.toml --backend cpu --frames 20
  insonify bench --compare -o report           everything above, with a page, tables (CSV, JSON) and plots: some minutes
  insonify bench --compare scene.toml --json";

/// Times frames and passes on each backend; with --compare GPU against CPU, and effects removed
#[derive(Args)]
#[command(after_help = TEACHING)]
pub(crate) struct Bench {
    #[command(flatten)]
    input: Input,
    #[command(flatten)]
    backend: BackendArgs,
    /// Number of frames of each measurement
    #[arg(long, value_name = "N", default_value = "100", value_parser = super::render::frame_count)]
    frames: usize,
    /// Time limit of a measurement, s; a twentieth of it with --compare
    #[arg(long, alias = "patience-s", value_name = "S", default_value_t = 4.0, value_parser = seconds)]
    time_limit_s: f64,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Compare GPU and CPU over sizes, passes and solvers, and effects alone and combined
    #[arg(long, conflicts_with = "frames")]
    compare: bool,
    /// Folder for index.html, the tables and plots of --compare; created if missing
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
}

impl Bench {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.backend.check()?;
        if self.compare {
            return self.compare();
        }
        // Not by `requires`, which clap drops where --frames, in conflict with --compare, is given.
        if self.output.is_some() {
            return Err(usage(
                "-o without --compare",
                "only --compare writes a report; --json prints the times",
            ));
        }
        let (scene, _) = self.input.scene(&self.backend)?;
        let count = scene.frames().min(self.frames);
        let states: Vec<FrameState> = scene.states(count).collect::<Result<_, _>>()?;
        let options = BenchOptions {
            frames: self.frames,
            patience: Duration::from_secs_f64(self.time_limit_s),
            ..BenchOptions::default()
        };
        let mut report = BenchReport::new(&scene.anatomy, &scene.settings);
        report.warnings = scene.warnings;
        let (candidates, software) = self.candidates();
        if !self.json {
            software.iter().for_each(terminal::say);
        }
        report.warnings.extend(software);
        for (name, backend) in candidates {
            if !self.json {
                terminal::say(format_args!("measuring {name}"));
            }
            match bench(&scene.anatomy, &scene.settings, &states, &backend, &options) {
                Ok(backend) => report.backends.push(backend),
                Err(error @ SynthError::Gpu(_)) if self.backend.backend == BackendName::Auto => {
                    let warning = format!("{name} was not measured: {error}");
                    if !self.json {
                        terminal::warn(&warning);
                    }
                    report.warnings.push(warning);
                }
                Err(error) => return Err(error.into()),
            }
        }
        terminal::print(&report, self.json)
    }

    fn compare(&self) -> Result<(), Error> {
        if self.backend.backend == BackendName::CpuF64 {
            return Err(usage(
                "--compare --backend cpu-f64: GPUs compute in single precision, and so does the CPU beside them",
                "ask for auto, cpu or gpu",
            ));
        }
        let printed = Printed::new(self.output.clone(), self.force, self.json);
        printed.check()?;
        let scene = if self.input.is_default() {
            scene()?
        } else {
            self.input.scene(&self.backend)?.0
        };
        let mut state = FrameState::at(Matrix4::identity());
        scene.state(0, scene.frames().max(1), &mut state)?;
        let Devices { gpus, missing, .. } = self.backend.gpus()?;
        let options = CompareOptions {
            patience: Duration::from_secs_f64(self.time_limit_s / 20.0),
            ..CompareOptions::usual(gpus)
        };
        let subject = Subject {
            anatomy: &scene.anatomy,
            settings: &scene.settings,
            state: &state,
        };
        printed.run(|progress| {
            let mut study = compare(&subject, &options, progress)?;
            study.notes.extend(missing);
            Ok(study)
        })
    }

    /// Backends to measure, and a sentence for each adapter that cannot be measured.
    fn candidates(&self) -> (Vec<(String, Backend)>, Vec<String>) {
        let choice = self.backend.choice();
        let cpu = || ("the CPU".to_owned(), Backend::Cpu);
        let gpu = |choice: AdapterChoice| {
            let name = choice.name.clone().unwrap_or_else(|| "the GPU".to_owned());
            (name, Backend::Adapter(choice))
        };
        let candidates = match self.backend.backend {
            BackendName::Cpu => vec![cpu()],
            BackendName::CpuF64 => vec![("the CPU in double precision".to_owned(), Backend::CpuF64)],
            BackendName::Gpu => vec![gpu(choice)],
            BackendName::Auto if choice.name.is_some() => vec![cpu(), gpu(choice)],
            BackendName::Auto => {
                let (software, hardware): (Vec<_>, Vec<_>) =
                    adapter::list().into_iter().partition(|adapter| adapter.software);
                let name = |adapter: AdapterReport| format!("{} ({})", adapter.name, adapter.backend);
                let gpus = hardware
                    .into_iter()
                    .map(|adapter| gpu(AdapterChoice::named(name(adapter))));
                let unmeasured = software
                    .into_iter()
                    .map(|adapter| format!("{} was not measured: it is {SOFTWARE}", name(adapter)));
                return (std::iter::once(cpu()).chain(gpus).collect(), unmeasured.collect());
            }
        };
        (candidates, Vec::new())
    }
}

/// Parses seconds on the command line.
fn seconds(text: &str) -> Result<f64, String> {
    ranged(text, 0.0..=3600.0, "a number of seconds from 0 to 3600")
}
