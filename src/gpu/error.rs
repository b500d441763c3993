//! Errors of the GPU layer.

use insonify_base::blame::Blame;

/// An error of the GPU layer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// The library was built without the feature `wgpu` of this crate, which the feature `gpu` of others turns on.
    #[error("this build has no GPU support; build it with the feature `gpu`")]
    Absent,

    /// wgpu finds no adapter on the machine.
    #[error(
        "no GPU adapter was found; install a Vulkan driver of your card, or a software one \
         (Debian and Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1)"
    )]
    NoAdapter,

    /// No adapter's name contains the requested name.
    #[error("no GPU adapter has a name that contains '{wanted}'{origin}; available: {}", available.join(", "))]
    UnknownAdapter {
        /// Requested name.
        wanted: String,
        /// Origin of the requested name, in brackets; empty for a flag.
        origin: &'static str,
        /// Available adapters, as `name (backend)`.
        available: Vec<String>,
    },

    /// No device could be opened on the adapter.
    #[error("no device could be opened on adapter '{adapter}': {message}")]
    Open {
        /// Name of the adapter.
        adapter: String,
        /// Message of the driver or wgpu.
        message: String,
    },

    /// A requirement exceeds a limit of the device.
    #[error("{what} needs {limit} of at least {needed}, this device has {available}{}", way_on(limit, *needed, *available))]
    Limit {
        /// What exceeds the limit.
        what: String,
        /// Name of the limit in wgpu.
        limit: &'static str,
        /// Required value, in the unit of the limit (bytes or a count).
        needed: u64,
        /// Value of the device, in the same unit.
        available: u64,
    },

    /// A pass does not compile, or does not fit its bindings.
    #[error("pass '{pass}'{}: {message}", line.map(|line| format!(", line {line} of its WGSL")).unwrap_or_default())]
    Shader {
        /// Label of the pass.
        pass: String,
        /// Line of the WGSL source, counted from 1, if known.
        line: Option<u32>,
        /// Message of the compiler.
        message: String,
    },

    /// Two counts or sizes that must be equal differ.
    #[error("{what}: expected {expected}, found {found}")]
    Mismatch {
        /// What is counted.
        what: String,
        /// Expected value.
        expected: u64,
        /// Value found.
        found: u64,
    },

    /// The device is lost: unplugged, reset by its driver or destroyed. Open a new one.
    #[error("the GPU device was lost: {reason}")]
    Lost {
        /// Message of the driver.
        reason: String,
    },

    /// The GPU ran out of memory.
    #[error("the GPU ran out of memory: {what}")]
    OutOfMemory {
        /// Operation in progress.
        what: String,
    },

    /// The GPU did not finish in time.
    #[error("{what}: the GPU did not finish within {seconds} s")]
    Timeout {
        /// Operation in progress.
        what: String,
        /// Waiting time, s.
        seconds: f64,
    },

    /// wgpu rejected a call as invalid: a fault of this program, not of its input.
    #[error("{what}: {message}")]
    Validation {
        /// Operation in progress.
        what: String,
        /// Message of wgpu.
        message: String,
    },

    /// An internal error of the driver.
    #[error("{what}: the GPU driver failed: {message}")]
    Internal {
        /// Operation in progress.
        what: String,
        /// Message of the driver.
        message: String,
    },
}

/// Remedy for an exceeded limit of bytes; empty for other limits.
fn way_on(limit: &str, needed: u64, available: u64) -> String {
    if !["max_storage_buffer_binding_size", "max_buffer_size"].contains(&limit) {
        return String::new();
    }
    let coarser = (needed as f64 / available as f64).cbrt();
    // Rounded up, so that it fits.
    let coarser = (coarser * 100.0).ceil() / 100.0;
    format!(
        ": compute on the CPU (`--backend cpu`), which has no such limit, or, if it is a volume that is too large, resample it to voxels \
         {coarser} times as long"
    )
}

impl Blame for GpuError {
    fn is_machine(&self) -> bool {
        !matches!(self, Self::UnknownAdapter { .. })
    }
}
