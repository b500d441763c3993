//! Conversion of wgpu errors to values, including those reported asynchronously to handlers and callbacks.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::GpuError;

impl GpuError {
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
    pub(crate) fn report_lost(&self, reason: &str, message: &str) {
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
