//! GPU device for unit tests, or a visible skip if the machine has no adapter.

use super::{AdapterChoice, Gpu, GpuError, Needs};

/// Opens a device, or returns `None` after reporting that the test is skipped.
pub(crate) fn open() -> Option<Gpu> {
    match Gpu::open(&AdapterChoice::from_flag(None), &Needs::default()) {
        Ok(gpu) => Some(gpu),
        Err(GpuError::NoAdapter) => {
            insonify_testing::gpu::absent();
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Name of the limit that `what` exceeds, the value that it needs and that of the device.
#[track_caller]
pub(super) fn exceeded<T>(what: &str, result: Result<T, GpuError>) -> (&'static str, u64, u64) {
    match result {
        Err(GpuError::Limit {
            what: named,
            limit,
            needed,
            available,
        }) => {
            assert!(named.contains(what), "{named}");
            (limit, needed, available)
        }
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("{what} exceeds no limit"),
    }
}
