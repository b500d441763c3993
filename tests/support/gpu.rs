//! A GPU, or a visible skip.

use insonify::gpu::{AdapterChoice, Gpu, GpuError, Needs};
use insonify::imaging::synth::Backend;

/// Environment variable that turns a skip into a failure.
pub const REQUIRE: &str = "INSONIFY_REQUIRE_GPU";

/// A device for the test of that name, or `None` after saying that it is skipped.
pub fn gpu_or_skip(test: &str) -> Option<Gpu> {
    match Gpu::open(&AdapterChoice::from_flag(None), &Needs::default()) {
        Ok(gpu) => Some(gpu),
        Err(GpuError::NoAdapter) => {
            println!("SKIPPED: no GPU adapter for {test}");
            let required = std::env::var(REQUIRE).is_ok_and(|value| value == "1");
            assert!(!required, "{REQUIRE}=1, and there is no GPU adapter for {test}");
            None
        }
        Err(error) => panic!("{test}: {error}"),
    }
}

/// The backend over a device.
pub fn backend(gpu: Gpu) -> Backend {
    Backend::Gpu(Box::new(gpu))
}
