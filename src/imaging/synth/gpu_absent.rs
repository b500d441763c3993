//! Stand-in for the GPU executor in a library built without the feature `gpu`: none can be made.

use super::layers::Beam;
use super::tables::Tables;
use super::{Frame, FrameState, PassTime, SynthError};
use crate::effects::buffers::Buffer;
use crate::plan::Plan;
use insonify_gpu::{Gpu, GpuError, Needs};

/// Device requirements of a plan.
pub fn needs(_: &Plan) -> Needs {
    Needs::default()
}

/// A submission, of which there is none.
pub(crate) enum Submission {}

/// An executor, of which there is none.
pub(crate) enum GpuExecutor {}

/// Methods of the executor, which cannot be called.
macro_rules! methods {
    ($($name:ident($($of:ty),*) -> $result:ty;)+) => {
        #[allow(dead_code, reason = "stands in for all that an executor does")]
        impl GpuExecutor {
            /// Makes no executor: there is no GPU.
            pub(crate) fn new(gpu: Gpu, _: &Plan, _: &Tables) -> Result<Self, SynthError> {
                drop(gpu);
                Err(GpuError::Absent.into())
            }

            $(
                pub(crate) fn $name(&self, $(_: $of),*) -> $result {
                    match *self {}
                }
            )+
        }
    };
}
methods! {
    fit(&Plan, &Tables, &[&'static Buffer]) -> Result<(), SynthError>;
    reserve_frames(&Plan, &Tables, usize) -> Result<usize, SynthError>;
    stage(&Plan, &Tables, &[&FrameState]) -> Result<(), SynthError>;
    submit(&Tables, usize, usize) -> Result<Submission, SynthError>;
    is_ready(usize) -> Result<bool, SynthError>;
    take((&Plan, &Tables), Submission, usize, &mut [Frame]) -> Result<(), SynthError>;
    release(usize) -> ();
    render_to_texture(&Plan, &Tables, &FrameState) -> Result<(), SynthError>;
    run_until(&str, &Plan, &Tables, &FrameState) -> Result<(), SynthError>;
    run_on(&str, &str) -> Result<(), SynthError>;
    time_passes(bool, &Plan, &Tables) -> Result<(), SynthError>;
    beam(bool, &Tables) -> Result<Beam, SynthError>;
    gpu() -> &Gpu;
    times() -> &[PassTime];
    frame_ms() -> Option<f64>;
    pipelines() -> std::iter::Empty<&'static str>;
    bytes() -> u64;
}
