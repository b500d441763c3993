//! Selection of the rendering backend.

use crate::gpu::adapter::{self, hardware};
use crate::gpu::{AdapterChoice, Gpu, Needs};
use crate::imaging::synth::tables::{Anatomy, Settings};
use crate::imaging::synth::{Backend, SynthError, Synthesizer};
use crate::study::tradeoff::gather::Devices;
use clap::{Args, ValueEnum};

use super::failure::Failure;

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum BackendName {
    /// A hardware GPU if there is one, else the CPU
    #[default]
    Auto,
    /// The CPU in single precision
    Cpu,
    /// The CPU in double precision: the gold standard
    CpuF64,
    /// The best GPU adapter, or an error; software Vulkan if there is no other
    Gpu,
}

#[derive(Args, Default)]
pub struct BackendArgs {
    /// Rendering backend
    #[arg(long, value_enum, default_value = "auto")]
    pub backend: BackendName,
    /// Part of the name of the GPU adapter to use; `insonify doctor` lists them
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
}

/// A synthesizer, the reason for its backend, and warnings about the choice.
pub struct Chosen {
    pub synth: Synthesizer,
    pub reason: String,
    pub warnings: Vec<String>,
}

impl Chosen {
    /// Name of the GPU adapter; `None` on the CPU.
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

    /// Creates a synthesizer on the requested backend.
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
                synth: Synthesizer::new(anatomy, settings, Backend::Adapter(self.choice()))?,
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
                match Synthesizer::new(anatomy.clone(), settings.clone(), Backend::Adapter(choice.clone())) {
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

    /// Devices to measure in addition to the CPU, and those that cannot be measured.
    pub fn gpus(&self) -> Result<Devices, Failure> {
        let choice = self.choice();
        match self.backend {
            BackendName::Cpu | BackendName::CpuF64 => Ok(Devices::default()),
            BackendName::Auto if choice.name.is_none() => Ok(Devices::here()),
            BackendName::Auto | BackendName::Gpu => Ok(Devices {
                gpus: vec![Gpu::open(&choice, &Needs::default())?],
                missing: Vec::new(),
            }),
        }
    }

    /// Adapter named by the flag or the environment.
    pub fn choice(&self) -> AdapterChoice {
        AdapterChoice::from_flag(self.adapter.as_deref())
    }
}
