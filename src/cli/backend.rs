//! Which backend a run uses, and why.

use clap::{Args, ValueEnum};
use insonify::gpu::adapter;
use insonify::gpu::{AdapterChoice, AdapterReport, Gpu, Needs};
use insonify::plan::Plan;
use insonify::study::tradeoff::gather::Means;
use insonify::synth::gpu::needs;
use insonify::synth::tables::{Anatomy, Settings, Tables};
use insonify::synth::{Backend, SynthError, Synthesizer};

use super::failure::Failure;

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum BackendName {
    /// The GPU where an adapter is there, else the CPU
    #[default]
    Auto,
    /// The CPU in single precision
    Cpu,
    /// The CPU in double precision: the gold standard
    CpuF64,
    /// The GPU, or nothing
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
                if self.choice().name.is_none() && adapter::list().is_empty() {
                    return cpu(anatomy, settings, "no GPU adapter was found".into(), Vec::new());
                }
                match on_gpu(anatomy.clone(), settings.clone(), &self.choice()) {
                    Ok(synth) => {
                        let reason = synth.gpu().map_or_else(String::new, |gpu| why(gpu.report()));
                        Ok(Chosen {
                            synth,
                            reason,
                            warnings: Vec::new(),
                        })
                    }
                    Err(SynthError::Gpu(error)) if error.is_machine() && self.choice().name.is_none() => {
                        let warning = format!("the GPU cannot render this scene, the CPU does: {error}");
                        cpu(anatomy, settings, "the GPU could not".into(), vec![warning])
                    }
                    Err(error) => Err(error.into()),
                }
            }
        }
    }

    /// The devices to measure beside the CPU, and what to say of those that do not open.
    pub fn gpus(&self) -> Result<(Vec<Gpu>, Vec<String>), Failure> {
        let choice = self.choice();
        let open = |choice: &AdapterChoice| Gpu::open(choice, &Needs::default());
        match self.backend {
            BackendName::Cpu | BackendName::CpuF64 => Ok((Vec::new(), Vec::new())),
            BackendName::Gpu => Ok((vec![open(&choice)?], Vec::new())),
            BackendName::Auto if choice.name.is_some() => Ok((vec![open(&choice)?], Vec::new())),
            BackendName::Auto => {
                let Means { gpus, missing } = Means::here();
                Ok((gpus, missing))
            }
        }
    }

    /// The adapter that the flag or the environment names.
    pub fn choice(&self) -> AdapterChoice {
        AdapterChoice::from_flag(self.adapter.as_deref())
    }
}

/// Why an adapter is used where none was asked for.
pub fn why(adapter: &AdapterReport) -> String {
    if adapter.software {
        "it is the only kind of adapter there is; it is software, right for checking, and --backend cpu is faster"
            .into()
    } else {
        "a GPU adapter is there".into()
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
