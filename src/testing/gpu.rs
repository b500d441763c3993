//! A GPU, or a visible skip.

use insonify_gpu::{AdapterChoice, Gpu, GpuError, Needs, adapter};

/// Environment variable that turns a skip into a failure.
const REQUIRE: &str = "INSONIFY_REQUIRE_GPU";

/// A device, or `None` after saying that the test is skipped.
pub fn gpu_or_skip() -> Option<Gpu> {
    match Gpu::open(&AdapterChoice::from_flag(None), &Needs::default()) {
        Ok(gpu) => Some(gpu),
        Err(GpuError::NoAdapter) => {
            absent();
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Says that the test is skipped for want of a GPU.
///
/// # Panics
/// If the environment variable `INSONIFY_REQUIRE_GPU` is 1.
pub fn absent() {
    let required = std::env::var(REQUIRE).is_ok_and(|value| value == "1");
    assert!(!required, "{REQUIRE}=1, and there is no GPU adapter");
    crate::skip("no GPU adapter");
}

/// The same adapter opened without optional features and with wgpu's default limits: shaders have no f64, passes cannot
/// be timed, and a binding holds 128 MiB.
pub fn gpu_without_features() -> Option<Gpu> {
    gpu_or_skip()?;
    let adapter = adapter::pick(&AdapterChoice::from_flag(None)).unwrap();
    let opened = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()));
    let (device, queue) = opened.unwrap();
    Some(Gpu::from_host(device, queue, &Needs::default()).unwrap())
}
