//! `insonify doctor`: rendering devices of this machine.

mod unseen;

use std::fmt;
use std::path::PathBuf;

use clap::Args;
use insonify_base::cache;
use insonify_base::machine::Machine;
use insonify_gpu::adapter::{self, ADAPTER_VARIABLE, AdapterReport};
use insonify_gpu::{AdapterChoice, Gpu, GpuError, Needs};
use insonify_imaging::quality::cache::Cache;
use serde::Serialize;

use super::backend::BEST;
use super::backend::timing::{FrameTimes, Kept};
use super::terminal;
use insonify::Error;
use insonify_gpu::adapter::hardware;

/// Lists GPU adapters and their limits, the processor, and the selected backend with the reason
#[derive(Args)]
pub(crate) struct Doctor {
    /// Part of the name of the GPU adapter to select
    #[arg(long, value_name = "NAME")]
    adapter: Option<String>,
    /// Print JSON: `version`, `machine`, `adapters`, `backend`, `adapter`, `reason`, `measured`, `cache`, `hints`,
    /// `warnings`
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct DoctorReport {
    version: &'static str,
    machine: Machine,
    adapters: Vec<AdapterReport>,
    backend: &'static str,
    adapter: Option<String>,
    reason: String,
    /// Times by which `auto` chooses, if it is not the CPU in any case.
    measured: Vec<FrameTimes>,
    cache: Option<PathBuf>,
    hints: Vec<String>,
    warnings: Vec<String>,
}

impl Doctor {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let adapters = adapter::list();
        let choice = AdapterChoice::from_flag(self.adapter.as_deref());
        let mut report = DoctorReport {
            version: insonify_base::VERSION,
            machine: Machine::here(),
            adapters,
            backend: "cpu",
            adapter: None,
            reason: String::new(),
            measured: Vec::new(),
            cache: cache::folder(),
            hints: Vec::new(),
            warnings: Vec::new(),
        };
        match (&choice.name, hardware(&report.adapters)) {
            // A software adapter opens as well, but is slower than the CPU: it is taken only by name.
            (None, Err(reason)) => report.reason = reason,
            (name, _) => match Gpu::open(&choice, &Needs::default()) {
                Ok(gpu) => {
                    report.backend = "gpu";
                    report.adapter = Some(gpu.report().name.clone());
                    // An adapter that is named is never compared with the CPU: kept times had no part in it.
                    if name.is_none() {
                        report.measured = Kept::of(gpu.report(), &Cache::of_user(&report.machine.to_string())).times;
                    }
                    report.reason = match name {
                        Some(name) => format!("\"{name}\" was asked for"),
                        None => format!("{BEST}; scenes of several frames take what is faster, measured once"),
                    };
                }
                Err(error) => {
                    if name.is_some() {
                        report.backend = "none";
                    }
                    report.reason = match name {
                        Some(name) => format!("\"{name}\" was asked for"),
                        None => "no adapter opens a device".to_owned(),
                    };
                    report.warnings.push(error.to_string());
                }
            },
        }
        if hardware(&report.adapters).is_err() {
            let variable = |name: &str| std::env::var(name).ok();
            report.hints.extend(unseen::reasons("/".as_ref(), variable));
        }
        if report.adapters.is_empty() {
            report.hints.push(GpuError::NoAdapter.to_string());
        } else if report.adapters.len() > 1 || report.adapter.is_none() {
            let hint = format!("--adapter NAME or {ADAPTER_VARIABLE} picks an adapter");
            report.hints.push(hint);
        }
        terminal::print(&report, self.json)
    }
}

impl fmt::Display for DoctorReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "insonify {}", self.version)?;
        writeln!(f, "machine   {}", self.machine)?;
        match &self.adapter {
            Some(adapter) => writeln!(f, "used      {} on {adapter}: {}", self.backend, self.reason)?,
            None => writeln!(f, "used      {}: {}", self.backend, self.reason)?,
        }
        for times in &self.measured {
            let backend = if times.is_gpu() { "gpu" } else { "cpu" };
            let adapter = self.adapter.as_deref().unwrap_or_default();
            writeln!(f, "measured  {}: {backend}, {}", times.scene, times.text(adapter))?;
        }
        if let Some(folder) = &self.cache {
            writeln!(
                f,
                "cache     {}: phantoms, textures, outlines of bodies, measured costs",
                folder.display()
            )?;
        }
        for (number, adapter) in self.adapters.iter().enumerate() {
            writeln!(f)?;
            write_adapter(f, number, adapter)?;
        }
        for hint in &self.hints {
            writeln!(f, "\nhint: {hint}")?;
        }
        for warning in &self.warnings {
            writeln!(f, "\nwarning: {warning}")?;
        }
        Ok(())
    }
}

fn write_adapter(f: &mut fmt::Formatter<'_>, number: usize, adapter: &AdapterReport) -> fmt::Result {
    let mib = |bytes: u64| bytes >> 20;
    let limits = &adapter.limits;
    writeln!(f, "adapter {number} {} ({})", adapter.name, adapter.backend)?;
    writeln!(f, "  kind    {}", adapter.device_type)?;
    writeln!(f, "  driver  {} {}", adapter.driver, adapter.driver_info)?;
    writeln!(
        f,
        "  times   {}",
        if adapter.timestamps {
            "of passes, by timestamps"
        } else {
            "by wall clock only"
        }
    )?;
    writeln!(
        f,
        "  limits  {} MiB a storage binding",
        mib(limits.max_storage_buffer_binding_size)
    )?;
    writeln!(f, "          {} MiB a buffer", mib(limits.max_buffer_size))?;
    writeln!(
        f,
        "          {} storage buffers a pass",
        limits.max_storage_buffers_per_shader_stage
    )?;
    writeln!(
        f,
        "          {} invocations a workgroup",
        limits.max_compute_invocations_per_workgroup
    )?;
    writeln!(
        f,
        "          {} bytes of shared memory",
        limits.max_compute_workgroup_storage_size
    )?;
    writeln!(
        f,
        "          {} workgroups a dimension",
        limits.max_compute_workgroups_per_dimension
    )?;
    writeln!(
        f,
        "          {} pixels a side of a texture",
        limits.max_texture_dimension_2d
    )
}
