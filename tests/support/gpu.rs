//! A GPU, or a visible skip, and the backend over it.

use insonify_gpu::Gpu;
use insonify_imaging::synth::Backend;
pub(crate) use insonify_testing::gpu::{gpu_or_skip, gpu_without_features};

/// The backend over a device.
pub(crate) fn backend(gpu: Gpu) -> Backend {
    Backend::Gpu(Box::new(gpu))
}
