//! Enumeration and selection of GPU adapters.

use std::borrow::Cow;
use std::ffi::{OsStr, OsString};

use serde::Serialize;

use super::GpuError;

/// Environment variable that names an adapter if no flag does.
pub const ADAPTER_VARIABLE: &str = "INSONIFY_ADAPTER";

/// Sentence about a software adapter, which is used only if it is named.
pub const SOFTWARE: &str =
    "a software adapter, slower than the CPU backend and used only where a GPU or this adapter is asked for";

/// Properties and capabilities of an adapter.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AdapterReport {
    /// Name given by the driver.
    pub name: String,
    /// Graphics API: `vulkan`, `metal` or `dx12`.
    pub backend: String,
    /// Device type: `discrete`, `integrated`, `virtual`, `cpu` or `other`.
    pub device_type: &'static str,
    /// Name of the driver.
    pub driver: String,
    /// Version and build of the driver.
    pub driver_info: String,
    /// Whether it is a software implementation on the CPU: suitable for checking, not for speed.
    pub software: bool,
    /// Whether it can time passes on the GPU.
    pub timestamps: bool,
    /// Maximum limits of a device opened on it.
    pub limits: AdapterLimits,
}

/// Limits of an adapter that determine which scenes fit.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AdapterLimits {
    /// Largest storage buffer that a pass can bind, bytes.
    pub max_storage_buffer_binding_size: u64,
    /// Largest buffer, bytes.
    pub max_buffer_size: u64,
    /// Maximum number of storage buffers that one pass can bind.
    pub max_storage_buffers_per_shader_stage: u32,
    /// Maximum number of invocations in one workgroup.
    pub max_compute_invocations_per_workgroup: u32,
    /// Maximum shared memory of one workgroup, bytes.
    pub max_compute_workgroup_storage_size: u32,
    /// Maximum number of workgroups along one dimension of a dispatch.
    pub max_compute_workgroups_per_dimension: u32,
    /// Largest width or height of a texture, pixels.
    pub max_texture_dimension_2d: u32,
}

impl AdapterReport {
    pub(super) fn new(info: &wgpu::AdapterInfo, limits: &wgpu::Limits, features: wgpu::Features) -> Self {
        Self {
            name: info.name.clone(),
            backend: info.backend.to_str().to_owned(),
            device_type: match info.device_type {
                wgpu::DeviceType::DiscreteGpu => "discrete",
                wgpu::DeviceType::IntegratedGpu => "integrated",
                wgpu::DeviceType::VirtualGpu => "virtual",
                wgpu::DeviceType::Cpu => "cpu",
                wgpu::DeviceType::Other => "other",
            },
            driver: info.driver.clone(),
            driver_info: info.driver_info.clone(),
            software: info.device_type == wgpu::DeviceType::Cpu,
            timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
            limits: AdapterLimits {
                max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
                max_buffer_size: limits.max_buffer_size,
                max_storage_buffers_per_shader_stage: limits.max_storage_buffers_per_shader_stage,
                max_compute_invocations_per_workgroup: limits.max_compute_invocations_per_workgroup,
                max_compute_workgroup_storage_size: limits.max_compute_workgroup_storage_size,
                max_compute_workgroups_per_dimension: limits.max_compute_workgroups_per_dimension,
                max_texture_dimension_2d: limits.max_texture_dimension_2d,
            },
        }
    }
}

/// Adapter to open; by default the first of [`list`].
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AdapterChoice {
    /// Part of `name (backend)`, case-insensitive, or `None` for the best adapter.
    pub name: Option<String>,
    /// Origin of the name for errors, in brackets; empty for a flag.
    origin: &'static str,
}

impl AdapterChoice {
    /// Selects an adapter by name.
    pub fn named(name: String) -> Self {
        Self {
            name: Some(name),
            origin: "",
        }
    }

    /// Selects the adapter named by a command-line flag, else by [`ADAPTER_VARIABLE`], else the best.
    pub fn from_flag(flag: Option<&str>) -> Self {
        let variable = || std::env::var_os(ADAPTER_VARIABLE);
        let choice = flag.map_or_else(|| Self::of_variable(variable()), |name| Self::named(name.to_owned()));
        match &choice.name {
            Some(name) if !name.trim().is_empty() => choice,
            _ => Self::default(),
        }
    }

    fn of_variable(value: Option<OsString>) -> Self {
        let name = value.as_deref().map(OsStr::to_string_lossy);
        Self {
            origin: match &name {
                Some(Cow::Owned(_)) => " (from INSONIFY_ADAPTER, which is not UTF-8)",
                _ => " (from INSONIFY_ADAPTER)",
            },
            name: name.map(Cow::into_owned),
        }
    }
}

/// Lists the adapters of this machine without duplicates: discrete first, then integrated, virtual and software
/// ones.
pub fn list() -> Vec<AdapterReport> {
    adapters()
        .iter()
        .map(|adapter| AdapterReport::new(&adapter.get_info(), &adapter.limits(), adapter.features()))
        .collect()
}

/// Adapter that `auto` selects from `adapters`, best first, or the reason to use the CPU.
pub fn hardware(adapters: &[AdapterReport]) -> Result<&AdapterReport, String> {
    match adapters.first() {
        Some(best) if best.software => Err(format!("{} is {SOFTWARE}", best.name)),
        Some(best) => Ok(best),
        None => Err("no GPU adapter was found".to_owned()),
    }
}

/// Returns the first adapter in the order of [`list`] whose `name (backend)` contains the chosen name,
/// case-insensitive, or the first one if no name was chosen.
pub fn pick(choice: &AdapterChoice) -> Result<wgpu::Adapter, GpuError> {
    let mut adapters = adapters();
    let titles: Vec<String> = adapters.iter().map(|adapter| title(&adapter.get_info())).collect();
    let index = match_title(&titles, choice)?;
    Ok(adapters.swap_remove(index))
}

fn match_title(titles: &[String], choice: &AdapterChoice) -> Result<usize, GpuError> {
    if titles.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let Some(wanted) = &choice.name else { return Ok(0) };
    let needle = wanted.trim().to_lowercase();
    titles
        .iter()
        .position(|title| title.to_lowercase().contains(&needle))
        .ok_or_else(|| GpuError::UnknownAdapter {
            wanted: wanted.to_owned(),
            origin: choice.origin,
            available: titles.to_vec(),
        })
}

fn title(info: &wgpu::AdapterInfo) -> String {
    format!("{} ({})", info.name, info.backend.to_str())
}

fn adapters() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    in_order(adapters, wgpu::Adapter::get_info)
}

/// Sorts adapters best first, ties in the order found, without duplicates from a driver registered twice.
fn in_order<A>(adapters: Vec<A>, info: impl Fn(&A) -> wgpu::AdapterInfo) -> Vec<A> {
    let mut seen = std::collections::HashSet::new();
    let mut ranked: Vec<(u8, A)> = adapters
        .into_iter()
        .filter_map(|adapter| {
            let info = info(&adapter);
            let rank = match info.device_type {
                wgpu::DeviceType::DiscreteGpu => 0,
                wgpu::DeviceType::IntegratedGpu => 1,
                wgpu::DeviceType::VirtualGpu => 2,
                wgpu::DeviceType::Other => 3,
                wgpu::DeviceType::Cpu => 4,
            };
            seen.insert(info).then_some((rank, adapter))
        })
        .collect();
    ranked.sort_by_key(|(rank, _)| *rank);
    ranked.into_iter().map(|(_, adapter)| adapter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;
    use insonify_base::blame::Blame;

    fn info(name: &str, device_type: wgpu::DeviceType, bus: &str) -> wgpu::AdapterInfo {
        wgpu::AdapterInfo {
            name: name.to_owned(),
            device_pci_bus_id: bus.to_owned(),
            ..wgpu::AdapterInfo::new(device_type, wgpu::Backend::Vulkan)
        }
    }

    #[test]
    fn best_first_and_doubles_dropped() {
        use wgpu::DeviceType::{Cpu, DiscreteGpu, IntegratedGpu, VirtualGpu};
        let registered = vec![
            info("llvmpipe", Cpu, ""),
            info("virtual", VirtualGpu, ""),
            info("llvmpipe", Cpu, ""),
            info("twin", DiscreteGpu, "0000:01:00.0"),
            info("laptop", IntegratedGpu, ""),
            info("twin", DiscreteGpu, "0000:02:00.0"),
        ];
        let order = in_order(registered, Clone::clone);
        let names: Vec<&str> = order.iter().map(|info| info.name.as_str()).collect();
        assert_eq!(
            names,
            ["twin", "twin", "laptop", "virtual", "llvmpipe"],
            "two cards of one model are two adapters"
        );
        assert_eq!(
            order[0].device_pci_bus_id, "0000:01:00.0",
            "ties stay in the order found"
        );
    }

    #[test]
    fn names_match_in_any_case_by_name_or_backend() {
        let titles = [
            "NVIDIA H100 (vulkan)".to_owned(),
            "llvmpipe (vulkan)".to_owned(),
            "WARP (dx12)".to_owned(),
        ];
        let named = |name: &str| match_title(&titles, &AdapterChoice::named(name.to_owned()));
        assert_eq!(match_title(&titles, &AdapterChoice::default()), Ok(0));
        assert_eq!(named("LLVM"), Ok(1));
        assert_eq!(named("dx12"), Ok(2));
        let error = named("voodoo").unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("voodoo") && titles.iter().all(|title| message.contains(title)),
            "{message}"
        );
        assert!(!error.is_machine() && !message.contains(ADAPTER_VARIABLE), "{message}");
    }

    #[test]
    fn without_adapters_the_error_says_what_to_install() {
        let error = match_title(&[], &AdapterChoice::named("any".to_owned())).unwrap_err();
        assert_eq!(error, GpuError::NoAdapter);
        assert!(error.to_string().contains("mesa-vulkan-drivers"));
        assert!(error.is_machine());
    }

    #[test]
    fn a_flag_wins_and_an_empty_one_means_the_best() {
        assert_eq!(AdapterChoice::from_flag(Some("arc")).name.as_deref(), Some("arc"));
        assert_eq!(AdapterChoice::from_flag(Some(" ")).name, None);
    }

    #[cfg(unix)]
    #[test]
    fn errors_name_the_variable_and_say_where_its_value_is_no_text() {
        use std::os::unix::ffi::OsStringExt;
        let titles = ["llvmpipe (vulkan)".to_owned()];
        let message = |value: &[u8]| {
            let choice = AdapterChoice::of_variable(Some(OsString::from_vec(value.to_vec())));
            match_title(&titles, &choice).unwrap_err().to_string()
        };
        let bogus = message(b"bogus");
        assert!(
            bogus.contains("'bogus' (from INSONIFY_ADAPTER); available: llvmpipe"),
            "{bogus}"
        );
        assert!(message(b"llvm\xff").contains("(from INSONIFY_ADAPTER, which is not UTF-8)"));
    }

    #[test]
    fn every_listed_adapter_can_be_picked_by_its_name() {
        if testing::open().is_none() {
            return;
        }
        let reports = list();
        for report in &reports {
            let adapter = pick(&AdapterChoice::named(report.name.to_uppercase())).unwrap();
            assert_eq!(adapter.get_info().name, report.name);
            assert!(report.limits.max_storage_buffer_binding_size >= 1 << 27, "{report:?}");
            assert_eq!(report.software, report.device_type == "cpu");
        }
        let error = pick(&AdapterChoice::named("no such adapter".to_owned())).unwrap_err();
        assert!(error.to_string().contains(&reports[0].name), "{error}");
    }
}
