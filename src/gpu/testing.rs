//! GPU device for unit tests, or a visible skip if the machine has no adapter.

use super::{AdapterChoice, Gpu, GpuError, Needs};

/// Environment variable that turns the skip into a failure.
const REQUIRE_VARIABLE: &str = "INSONIFY_REQUIRE_GPU";

/// Opens a device, or returns `None` after reporting that the test is skipped.
pub(crate) fn open() -> Option<Gpu> {
    match Gpu::open(&AdapterChoice::from_flag(None), &Needs::default()) {
        Ok(gpu) => Some(gpu),
        Err(GpuError::NoAdapter) => {
            let required = std::env::var(REQUIRE_VARIABLE).is_ok_and(|value| value == "1");
            assert!(!required, "{REQUIRE_VARIABLE}=1, and there is no GPU adapter");
            println!(
                "SKIPPED: no GPU adapter for {}",
                std::thread::current().name().unwrap_or("a test")
            );
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
