//! What can go wrong between this crate and a GPU.

/// An error of the GPU layer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// The machine offers no adapter to wgpu.
    #[error(
        "no GPU adapter was found; install a Vulkan driver of your card, or a software one \
         (Debian and Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1)"
    )]
    NoAdapter,

    /// No adapter's name contains what the user asked for.
    #[error("no GPU adapter is named like '{wanted}'{origin}; available: {}", available.join(", "))]
    UnknownAdapter {
        /// The name asked for.
        wanted: String,
        /// Origin of that name, in brackets; empty for a flag.
        origin: &'static str,
        /// The adapters there are, as `name (backend)`.
        available: Vec<String>,
    },

    /// The adapter refused to open a device.
    #[error("adapter '{adapter}' opened no device: {message}")]
    Open {
        /// Name of the adapter.
        adapter: String,
        /// The driver's or wgpu's words.
        message: String,
    },

    /// Something needs more than the device allows.
    #[error("{what} needs {limit} of at least {needed}, this device has {available}")]
    Limit {
        /// What exceeds the limit.
        what: String,
        /// wgpu's name of the limit.
        limit: &'static str,
        /// The value needed, in the unit of the limit (bytes or a count).
        needed: u64,
        /// The value that the device has, in the same unit.
        available: u64,
    },

    /// A pass did not compile, or does not fit its bindings.
    #[error("pass '{pass}'{}: {message}", line.map(|line| format!(", line {line} of its WGSL")).unwrap_or_default())]
    Shader {
        /// Label of the pass.
        pass: String,
        /// Line of the WGSL source, counted from 1, where known.
        line: Option<u32>,
        /// The compiler's words.
        message: String,
    },

    /// Two counts or sizes that must agree do not.
    #[error("{what}: expected {expected}, found {found}")]
    Mismatch {
        /// What is counted.
        what: String,
        /// The value it must have.
        expected: u64,
        /// The value it has.
        found: u64,
    },

    /// The device is gone: unplugged, reset by its driver or destroyed. Open a new one.
    #[error("the GPU device was lost: {reason}")]
    Lost {
        /// The driver's words.
        reason: String,
    },

    /// The GPU ran out of memory.
    #[error("the GPU ran out of memory: {what}")]
    OutOfMemory {
        /// What was being done.
        what: String,
    },

    /// The GPU did not finish in time.
    #[error("{what}: the GPU did not finish within {seconds} s")]
    Timeout {
        /// What was being waited for.
        what: String,
        /// How long, s.
        seconds: f64,
    },

    /// wgpu found a call invalid: a fault of this program, not of its input.
    #[error("{what}: {message}")]
    Validation {
        /// What was being done.
        what: String,
        /// wgpu's words.
        message: String,
    },

    /// The driver failed for a reason of its own.
    #[error("{what}: the GPU driver failed: {message}")]
    Internal {
        /// What was being done.
        what: String,
        /// The driver's words.
        message: String,
    },
}

impl GpuError {
    /// Whether the machine is at fault (`true`) or what the user asked for (`false`).
    pub fn is_machine(&self) -> bool {
        !matches!(self, Self::UnknownAdapter { .. })
    }

    pub(super) fn from_wgpu(what: &str, error: wgpu::Error) -> Self {
        let what = what.to_owned();
        match error {
            wgpu::Error::OutOfMemory { .. } => Self::OutOfMemory { what },
            wgpu::Error::Validation { description, .. } => Self::Validation {
                what,
                message: description,
            },
            wgpu::Error::Internal { description, .. } => Self::Internal {
                what,
                message: description,
            },
        }
    }
}

/// An error where `needed` is more than `available`.
pub(super) fn check_limit(
    what: impl FnOnce() -> String,
    limit: &'static str,
    needed: u64,
    available: u64,
) -> Result<(), GpuError> {
    if needed <= available {
        return Ok(());
    }
    Err(GpuError::Limit {
        what: what(),
        limit,
        needed,
        available,
    })
}
