//! Which backend a run uses, and why.

use clap::{Args, ValueEnum};
use insonify::gpu::adapter::{self, SOFTWARE};
use insonify::gpu::{AdapterChoice, AdapterReport, Gpu, Needs};
use insonify::plan::Plan;
use insonify::study::tradeoff::gather::Means;
use insonify::synth::gpu::needs;
use insonify::synth::tables::{Anatomy, Settings, Tables};
use insonify::synth::{Backend, SynthError, Synthesizer};

use super::failure::Failure;

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum BackendName {
    /// A hardware GPU where there is one, else the CPU
    #[default]
    Auto,
    /// The CPU in single precision
    Cpu,
    /// The CPU in double precision: the gold standard
    CpuF64,
    /// The best GPU adapter, or nothing; software Vulkan where there is no other
    Gpu,
}

#[derive(Args, Default)]
pub struct BackendArgs {
    /// What to render on
    #[arg(long, value_enum, default_value = "auto")]
    pub backend: BackendName,
    /// Part of the name of the GPU adapter to use; `insonify doctor` lists them
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
}

/// A synthesizer, why its backend was taken, and what was odd about that.
pub struct Chosen {
    pub synth: Synthesizer,
    pub reason: String,
    pub warnings: Vec<String>,
}

impl Chosen {
    /// Name of the GPU adapter; none on the CPU.
    pub fn adapter(&self) -> Option<&str> {
        self.synth.gpu().map(|gpu| gpu.report().name.as_str())
    }
}

impl BackendArgs {
    /// Refuses an adapter that would not be used.
    pub fn check(&self) -> Result<(), Failure> {
        match (self.backend, &self.adapter) {
            (BackendName::Cpu | BackendName::CpuF64, Some(adapter)) => Err(Failure::usage(
                format!("--adapter {adapter} picks a GPU, and --backend asks for the CPU"),
                "leave out one of them",
            )),
            _ => Ok(()),
        }
    }

    /// A synthesizer on the backend asked for.
    pub fn synthesizer(&self, anatomy: Anatomy, settings: Settings) -> Result<Chosen, Failure> {
        let mut chosen = self.choose(anatomy, settings)?;
        chosen.warnings.extend_from_slice(&chosen.synth.plan().warnings);
        Ok(chosen)
    }

    fn choose(&self, anatomy: Anatomy, settings: Settings) -> Result<Chosen, Failure> {
        self.check()?;
        let cpu = |anatomy, settings, reason: String, warnings| -> Result<Chosen, Failure> {
            Ok(Chosen {
                synth: Synthesizer::new(anatomy, settings, Backend::Cpu)?,
                reason,
                warnings,
            })
        };
        match self.backend {
            BackendName::Cpu => cpu(anatomy, settings, "it was asked for".into(), Vec::new()),
            BackendName::CpuF64 => Ok(Chosen {
                synth: Synthesizer::new(anatomy, settings, Backend::CpuF64)?,
                reason: "it was asked for".into(),
                warnings: Vec::new(),
            }),
            BackendName::Gpu => Ok(Chosen {
                synth: on_gpu(anatomy, settings, &self.choice())?,
                reason: "it was asked for".into(),
                warnings: Vec::new(),
            }),
            BackendName::Auto => {
                let choice = self.choice();
                let reason = match &choice.name {
                    Some(name) => Ok(format!("the adapter \"{name}\" was asked for")),
                    None => hardware(&adapter::list()).map(|_| "it is the best adapter".to_owned()),
                };
                let reason = match reason {
                    Ok(reason) => reason,
                    Err(none) => return cpu(anatomy, settings, none, Vec::new()),
                };
                match on_gpu(anatomy.clone(), settings.clone(), &choice) {
                    Ok(synth) => Ok(Chosen {
                        synth,
                        reason,
                        warnings: Vec::new(),
                    }),
                    Err(SynthError::Gpu(error)) if error.is_machine() && choice.name.is_none() => {
                        let warning = format!("the GPU cannot render this scene, the CPU does: {error}");
                        cpu(anatomy, settings, "the GPU could not".into(), vec![warning])
                    }
                    Err(error) => Err(error.into()),
                }
            }
        }
    }

    /// The devices to measure beside the CPU, and those that are not measured.
    pub fn gpus(&self) -> Result<Means, Failure> {
        let choice = self.choice();
        match self.backend {
            BackendName::Cpu | BackendName::CpuF64 => Ok(Means::default()),
            BackendName::Auto if choice.name.is_none() => Ok(Means::here()),
            BackendName::Auto | BackendName::Gpu => Ok(Means {
                gpus: vec![Gpu::open(&choice, &Needs::default())?],
                missing: Vec::new(),
            }),
        }
    }

    /// The adapter that the flag or the environment names.
    pub fn choice(&self) -> AdapterChoice {
        AdapterChoice::from_flag(self.adapter.as_deref())
    }
}

/// The adapter that `auto` takes of those found, best first, or the reason to take the CPU.
pub fn hardware(adapters: &[AdapterReport]) -> Result<&AdapterReport, String> {
    match adapters.first() {
        Some(best) if best.software => Err(format!("{} is {SOFTWARE}", best.name)),
        Some(best) => Ok(best),
        None => Err("no GPU adapter was found".to_owned()),
    }
}

/// What the passes of a scene ask of a device.
pub fn needs_of(anatomy: &Anatomy, settings: &Settings) -> Result<Needs, SynthError> {
    Ok(needs(&Plan::new(&Tables::new(anatomy.clone(), settings.clone())?)))
}

fn on_gpu(anatomy: Anatomy, settings: Settings, choice: &AdapterChoice) -> Result<Synthesizer, SynthError> {
    let gpu = Gpu::open(choice, &needs_of(&anatomy, &settings)?)?;
    Synthesizer::new(anatomy, settings, Backend::Gpu(Box::new(gpu)))
}
