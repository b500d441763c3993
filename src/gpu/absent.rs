//! Stand-in for the GPU in a library built without the feature `wgpu`: there is no device, and to open one is an error.

use crate::GpuError;

/// A device, of which there is none.
#[derive(Debug, Clone)]
pub enum Gpu {}

impl Gpu {
    /// Opens no device.
    ///
    /// # Errors
    /// Always [`GpuError::Absent`].
    pub fn open(_: &AdapterChoice, _: &Needs) -> Result<Self, GpuError> {
        Err(GpuError::Absent)
    }

    /// Report of the adapter.
    pub fn report(&self) -> &AdapterReport {
        match *self {}
    }
}

/// Requirements of a device.
#[derive(Debug, Clone, Copy, Default)]
pub struct Needs;

/// Properties of an adapter.
#[derive(Debug, Clone)]
pub struct AdapterReport {
    /// Name given by the driver.
    pub name: String,
    /// Whether it computes on the CPU.
    pub software: bool,
}

/// Adapter to open.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AdapterChoice;

impl AdapterChoice {
    /// The adapter named by a command-line flag, else the best.
    pub fn from_flag(_: Option<&str>) -> Self {
        Self
    }
}

/// Adapters of the machine.
pub mod adapter {
    use super::AdapterReport;

    /// No adapter.
    pub fn list() -> Vec<AdapterReport> {
        Vec::new()
    }

    /// The reason to use the CPU.
    pub fn hardware(_: &[AdapterReport]) -> Result<&AdapterReport, String> {
        Err(super::GpuError::Absent.to_string())
    }
}
