//! A GPU, or a visible skip.

use insonify_gpu::{AdapterChoice, Gpu, GpuError, Needs, adapter};

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

/// The same adapter opened without optional features and with wgpu's default limits: shaders have no f64, passes cannot be timed, and a binding
/// holds 128 MiB.
pub fn gpu_without_features(test: &str) -> Option<Gpu> {
    gpu_or_skip(test)?;
    let adapter = adapter::pick(&AdapterChoice::from_flag(None)).unwrap();
    let opened = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()));
    let (device, queue) = opened.unwrap();
    Some(Gpu::from_host(device, queue, &Needs::default()).unwrap())
}
