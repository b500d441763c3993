//! Adapters, devices, pipelines, read-back and timing: what all users of wgpu share, independent of ultrasound.
//!
//! | file | contents |
//! |---|---|
//! | [`adapter`] | enumeration and selection of adapters |
//! | [`device`] | [`Gpu`]: an opened device, its limits, and its errors as values |
//! | [`faults`] | [`Faults`]: errors reported only through handlers and callbacks |
//! | [`error`] | [`GpuError`] |
//! | [`pass`] | [`Pipeline`]: one compute pass and its bind group layout |
//! | [`buffer`] | [`StorageBuffer`]: checked, labelled storage; [`Parameters`]: those of all passes in one buffer |
//! | [`recorder`] | [`Recorder`]: dispatches and copies of one submission |
//! | [`readback`] | [`Readback`]: bytes back to the CPU through one persistent staging buffer |
//! | [`traffic`] | [`Traffic`]: counts of submissions, waits and bytes |
//! | [`timing`] | [`Timer`]: GPU time of each pass, where timestamps are supported |
//! | `texture_out` | [`TextureOut`]: a grey frame left on the GPU |
//!
//! Objects are created once and reused; a frame in the steady state writes its parameters, records, submits and reads
//! back. Nothing here panics on a device error: wgpu's error scopes and its device-lost callback become [`GpuError`]s.
//!
//! Software Vulkan (llvmpipe of Mesa 22.3) ends loops silently once an invocation has gone through 65,535 rounds of all
//! loops of its shader together: a pass that loops longer belongs in several dispatches.
//!
//! ```no_run
//! use insonify_gpu::{Access, AdapterChoice, Dispatch, Gpu, Loops, Needs, Parameters, PassSource, Pipeline};
//! use insonify_gpu::{Readback, StorageBuffer};
//!
//! let gpu = Gpu::open(&AdapterChoice::from_flag(None), &Needs::default())?;
//! let values = StorageBuffer::upload(&gpu, "values", &[1_u32, 2, 3])?;
//! let double = Pipeline::new(
//!     &gpu,
//!     &PassSource {
//!         label: "double",
//!         source: "@group(0) @binding(1) var<storage, read_write> values: array<u32>;
//!             @compute @workgroup_size(64)
//!             fn double(@builtin(global_invocation_id) id: vec3u) {
//!                 if id.x < arrayLength(&values) { values[id.x] *= 2u; }
//!             }",
//!         entry: "double",
//!         storage: &[Access::Write],
//!         loops: Loops::COUNTED,
//!     },
//! )?;
//! let parameters = Parameters::new(&gpu, "parameters", 1)?;
//! let bindings = double.bind(&gpu, &parameters, &[&values])?;
//! let mut readback = Readback::new(&gpu, "values", values.bytes())?;
//!
//! gpu.submit("frame", |recorder| {
//!     recorder.run("frame", [Dispatch { pipeline: &double, bindings: &bindings, slot: 0, workgroups: [1, 1, 1] }])?;
//!     recorder.read_back(&values, &readback)
//! })?;
//! let mut doubled = [0_u32; 3];
//! readback.read(&gpu, &mut doubled)?;
//! # Ok::<(), insonify_gpu::GpuError>(())
//! ```

mod access;
pub mod error;

pub use access::Access;
pub use error::GpuError;

#[cfg(not(feature = "wgpu"))]
mod absent;
#[cfg(not(feature = "wgpu"))]
pub use absent::{AdapterChoice, AdapterReport, Gpu, Needs, adapter};

#[cfg(feature = "wgpu")]
pub mod adapter;
#[cfg(feature = "wgpu")]
pub mod buffer;
#[cfg(feature = "wgpu")]
pub mod device;
#[cfg(feature = "wgpu")]
pub mod faults;
#[cfg(feature = "wgpu")]
pub mod pass;
#[cfg(feature = "wgpu")]
pub mod readback;
#[cfg(feature = "wgpu")]
pub mod recorder;
#[cfg(all(test, feature = "wgpu"))]
mod testing;
#[cfg(feature = "wgpu")]
pub(crate) mod texture_out;
#[cfg(feature = "wgpu")]
pub mod timing;
#[cfg(feature = "wgpu")]
pub mod traffic;
#[cfg(feature = "wgpu")]
pub use adapter::{AdapterChoice, AdapterReport};
#[cfg(feature = "wgpu")]
pub use buffer::{Parameters, StorageBuffer};
#[cfg(feature = "wgpu")]
pub use device::{Gpu, Needs};
#[cfg(feature = "wgpu")]
pub use faults::Faults;
#[cfg(feature = "wgpu")]
pub use pass::{Loops, PassSource, Pipeline};
#[cfg(feature = "wgpu")]
pub use readback::Readback;
#[cfg(feature = "wgpu")]
pub use recorder::{Dispatch, Recorder};
#[cfg(feature = "wgpu")]
pub use texture_out::{TextureOut, row_stride};
#[cfg(feature = "wgpu")]
pub use timing::Timer;
#[cfg(feature = "wgpu")]
pub use traffic::Traffic;
