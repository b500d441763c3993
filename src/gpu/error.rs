//! Errors of the GPU layer.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// An error of the GPU layer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// wgpu finds no adapter on the machine.
    #[error(
        "no GPU adapter was found; install a Vulkan driver of your card, or a software one \
         (Debian and Ubuntu: apt-get install mesa-vulkan-drivers libvulkan1)"
    )]
    NoAdapter,

    /// No adapter's name contains the requested name.
    #[error("no GPU adapter is named like '{wanted}'{origin}; available: {}", available.join(", "))]
    UnknownAdapter {
        /// Requested name.
        wanted: String,
        /// Origin of the requested name, in brackets; empty for a flag.
        origin: &'static str,
        /// Available adapters, as `name (backend)`.
        available: Vec<String>,
    },

    /// No device could be opened on the adapter.
    #[error("adapter '{adapter}' opened no device: {message}")]
    Open {
        /// Name of the adapter.
        adapter: String,
        /// Message of the driver or wgpu.
        message: String,
    },

    /// A requirement exceeds a limit of the device.
    #[error("{what} needs {limit} of at least {needed}, this device has {available}")]
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

impl GpuError {
    /// Whether the machine is at fault (`true`) or the user's request (`false`).
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

/// Returns an error if `needed` exceeds `available`.
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

// Asynchronous GPU errors, reported through handlers and callbacks.

/// Errors from handlers and callbacks, stored until [`Gpu::check`](super::Gpu::check) returns them. Clones share them.
#[derive(Debug, Clone, Default)]
pub struct Faults(Arc<Mutex<FaultState>>);

#[derive(Debug, Default)]
struct FaultState {
    lost: Option<GpuError>,
    first: Option<GpuError>,
}

impl Faults {
    /// Stores an uncaptured error, unless an earlier one is still pending.
    pub fn report(&self, error: wgpu::Error) {
        self.lock()
            .first
            .get_or_insert_with(|| GpuError::from_wgpu("an uncaptured GPU error", error));
    }

    /// Stores the loss of the device permanently; `message` may be empty.
    pub fn report_lost(&self, reason: &str, message: &str) {
        let separator = if message.is_empty() { "" } else { ": " };
        let lost = GpuError::Lost {
            reason: format!("{}{separator}{message}", reason.to_lowercase()),
        };
        self.lock().lost.get_or_insert(lost);
    }

    /// Number of this store while it exists, not 0.
    pub(super) fn id(&self) -> usize {
        Arc::as_ptr(&self.0) as usize
    }

    pub(super) fn take(&self) -> Result<(), GpuError> {
        let mut state = self.lock();
        state.lost.clone().or_else(|| state.first.take()).map_or(Ok(()), Err)
    }

    fn lock(&self) -> MutexGuard<'_, FaultState> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
