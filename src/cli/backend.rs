//! Selection of the rendering backend.

pub(crate) mod timing;

use std::sync::Arc;

use clap::{Args, ValueEnum};
use insonify_base::blame::Blame;
use insonify_base::machine::Machine;
use insonify_base::stage::{self, Extent};
use insonify_gpu::adapter::{self, AdapterReport, hardware};
use insonify_gpu::{AdapterChoice, Gpu, Needs};
use insonify_imaging::quality::cache::Cache;
use insonify_imaging::synth::tables::{Anatomy, Settings, Tables};
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};
use insonify_study::tradeoff::gather::Devices;
use timing::{FrameTimes, Kept};

use super::failure::{Error, usage};
use super::terminal;

/// Reason for a GPU that is not compared with the CPU.
pub(crate) const BEST: &str = "it is the best adapter";

#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum BackendName {
    /// A hardware GPU or the CPU, whichever renders frames of the scene faster; the GPU if neither has been timed
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
pub(crate) struct BackendArgs {
    /// Rendering backend
    #[arg(long, value_enum, default_value = "auto")]
    pub backend: BackendName,
    /// Part of the name of the GPU adapter to use; `insonify doctor` lists them
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
}

/// A synthesizer, the reason for its backend, and warnings about the choice.
pub(crate) struct Chosen {
    pub synth: Synthesizer,
    pub reason: String,
    pub warnings: Vec<String>,
}

impl Chosen {
    fn of(tables: &Arc<Tables>, backend: Backend, reason: impl Into<String>) -> Result<Self, SynthError> {
        Ok(Self {
            synth: Synthesizer::from_tables(Arc::clone(tables), backend)?,
            reason: reason.into(),
            warnings: Vec::new(),
        })
    }

    /// Says on which backend frames are rendered, and why.
    pub(crate) fn tell(&self) {
        let on = self
            .adapter()
            .map_or_else(String::new, |adapter| format!(" on {adapter}"));
        terminal::say(format_args!("backend: {}{on} ({})", self.synth.backend(), self.reason));
    }

    /// Name of the GPU adapter; `None` on the CPU.
    pub(crate) fn adapter(&self) -> Option<&str> {
        self.synth.gpu().map(|gpu| gpu.report().name.as_str())
    }
}

impl BackendArgs {
    /// Refuses an adapter that would not be used.
    pub(crate) fn check(&self) -> Result<(), Error> {
        match (self.backend, &self.adapter) {
            (BackendName::Cpu | BackendName::CpuF64, Some(adapter)) => Err(usage(
                format!("--adapter {adapter} picks a GPU, and --backend asks for the CPU"),
                "leave out one of them",
            )),
            _ => Ok(()),
        }
    }

    /// Creates a synthesizer on the requested backend. `several` is the state of a frame, if there are more to render:
    /// then `auto` times frames of it on a hardware GPU and on the CPU.
    pub(crate) fn synthesizer(
        &self,
        anatomy: Anatomy,
        settings: Settings,
        several: Option<&FrameState>,
    ) -> Result<Chosen, Error> {
        self.check()?;
        let _stage = stage::enter("preparing the effects", Extent::Unknown);
        let tables = Arc::new(Tables::new(anatomy, settings)?);
        let choice = self.choice();
        let mut chosen = match (self.backend, &choice.name) {
            (BackendName::Cpu, _) => Chosen::of(&tables, Backend::Cpu, "it was asked for")?,
            (BackendName::CpuF64, _) => Chosen::of(&tables, Backend::CpuF64, "it was asked for")?,
            (BackendName::Gpu, _) => Chosen::of(&tables, Backend::Adapter(choice), "it was asked for")?,
            (BackendName::Auto, Some(name)) => {
                let reason = format!("the adapter \"{name}\" was asked for");
                Chosen::of(&tables, Backend::Adapter(choice), reason)?
            }
            (BackendName::Auto, None) => match hardware(&adapter::list()) {
                Ok(best) => faster(&tables, best, several, &Cache::of_user(&Machine::here().to_string()))?,
                Err(none) => Chosen::of(&tables, Backend::Cpu, none)?,
            },
        };
        chosen.warnings.extend_from_slice(&chosen.synth.plan().warnings);
        Ok(chosen)
    }

    /// Devices to measure in addition to the CPU, and those that cannot be measured.
    pub(crate) fn gpus(&self) -> Result<Devices, Error> {
        let choice = self.choice();
        match self.backend {
            BackendName::Cpu | BackendName::CpuF64 => Ok(Devices::default()),
            BackendName::Auto if choice.name.is_none() => Ok(Devices::here()),
            BackendName::Auto | BackendName::Gpu => Ok(Devices {
                gpus: vec![Gpu::open(&choice, &Needs::default())?],
                missing: Vec::new(),
                skips_cpu: self.backend == BackendName::Gpu,
            }),
        }
    }

    /// Adapter named by the flag or the environment.
    pub(crate) fn choice(&self) -> AdapterChoice {
        AdapterChoice::from_flag(self.adapter.as_deref())
    }
}

/// A synthesizer on an adapter or on the CPU, whichever makes a frame faster, by times that are kept or, of several
/// frames, measured now; on the CPU if the adapter cannot render the scene.
fn faster(
    tables: &Arc<Tables>,
    adapter: &AdapterReport,
    several: Option<&FrameState>,
    cache: &Cache,
) -> Result<Chosen, SynthError> {
    let mut kept = Kept::of(adapter, cache);
    let known = kept.find(tables);
    let reason = known.map(|times| format!("{}, measured before and kept", times.text(&adapter.name)));
    // Kept times in favour of the CPU spare opening the device, which can take longer than a frame.
    if let (Some(reason), Some(false)) = (&reason, known.map(FrameTimes::is_gpu)) {
        return Chosen::of(tables, Backend::Cpu, reason);
    }
    let compared = || -> Result<Chosen, SynthError> {
        let named = AdapterChoice::named(format!("{} ({})", adapter.name, adapter.backend));
        let mut gpu = Chosen::of(tables, Backend::Adapter(named), BEST)?;
        let state = match (reason, several) {
            (Some(reason), _) => return Ok(Chosen { reason, ..gpu }),
            // One frame does not repay a comparison, which renders several on both.
            (None, None) => {
                gpu.reason += ", not compared with the CPU for a single frame";
                return Ok(gpu);
            }
            (None, Some(state)) => state,
        };
        let mut cpu = match Chosen::of(tables, Backend::Cpu, "") {
            Ok(cpu) => cpu,
            Err(error) => {
                gpu.reason = format!("the CPU cannot render this scene: {error}");
                return Ok(gpu);
            }
        };
        let times = FrameTimes::measure(&mut gpu.synth, &mut cpu.synth, state)?;
        let mut chosen = if times.is_gpu() { gpu } else { cpu };
        chosen.reason = format!("{}, measured now", times.text(&adapter.name));
        if let Err(error) = kept.put(times) {
            chosen.warnings.push(format!("the times cannot be kept: {error}"));
        }
        Ok(chosen)
    };
    match compared() {
        Err(SynthError::Gpu(error)) if error.is_machine() => {
            let mut cpu = Chosen::of(tables, Backend::Cpu, "the GPU cannot render this scene")?;
            let warning = format!("the GPU cannot render this scene, the CPU does: {error}");
            cpu.warnings.push(warning);
            Ok(cpu)
        }
        chosen => chosen,
    }
}

#[cfg(test)]
mod tests;
