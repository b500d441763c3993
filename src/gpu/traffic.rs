//! Counts of the work sent to a device and of the bytes exchanged with it.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

/// Submissions, waits and transfers between the CPU and a device.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Number of submissions.
    pub submissions: u64,
    /// Number of times that the CPU waited for the device.
    pub waits: u64,
    /// Writes to buffers.
    pub uploads: u64,
    /// Bytes sent to the device.
    pub bytes_up: u64,
    /// Bytes copied into staging buffers to be read by the CPU.
    pub bytes_down: u64,
}

impl std::ops::Sub for Traffic {
    type Output = Traffic;

    fn sub(self, before: Traffic) -> Traffic {
        Traffic {
            submissions: self.submissions - before.submissions,
            waits: self.waits - before.waits,
            uploads: self.uploads - before.uploads,
            bytes_up: self.bytes_up - before.bytes_up,
            bytes_down: self.bytes_down - before.bytes_down,
        }
    }
}

/// Running totals of a device since it was opened.
#[derive(Debug, Default)]
pub(super) struct Counter {
    submissions: AtomicU64,
    waits: AtomicU64,
    uploads: AtomicU64,
    bytes_up: AtomicU64,
    bytes_down: AtomicU64,
}

impl Counter {
    pub(crate) fn submitted(&self) {
        self.submissions.fetch_add(1, Relaxed);
    }

    pub(crate) fn waited(&self) {
        self.waits.fetch_add(1, Relaxed);
    }

    pub(crate) fn sent(&self, bytes: u64) {
        self.uploads.fetch_add(1, Relaxed);
        self.bytes_up.fetch_add(bytes, Relaxed);
    }

    pub(crate) fn fetched(&self, bytes: u64) {
        self.bytes_down.fetch_add(bytes, Relaxed);
    }

    pub(crate) fn total(&self) -> Traffic {
        Traffic {
            submissions: self.submissions.load(Relaxed),
            waits: self.waits.load(Relaxed),
            uploads: self.uploads.load(Relaxed),
            bytes_up: self.bytes_up.load(Relaxed),
            bytes_down: self.bytes_down.load(Relaxed),
        }
    }
}
