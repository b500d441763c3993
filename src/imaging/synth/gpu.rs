//! GPU execution of a plan: its buffers, pipelines and bind groups persist; a submission has one frame or several, one
//! upload, and the dispatches of the fused passes.

mod memory;
mod readback;
mod run;
mod steps;
mod texture;
mod timing;
mod upload;

use std::collections::BTreeMap;

use crate::effects::buffers::Buffer;
use crate::effects::pass::Band;
use crate::plan::Plan;
use crate::synth::slab::Slab;
use crate::synth::tables::Tables;
use crate::synth::{PassTime, SynthError};
use insonify_gpu::{Gpu, Needs, Pipeline, Readback, StorageBuffer, TextureOut, Timer};
use steps::Step;
use upload::{UPLOAD_BYTES, Uploads, uploads};

/// Device requirements of a plan beyond the default limits.
pub fn needs(plan: &Plan) -> Needs {
    let resources = plan.resources.iter().filter(|planned| !planned.resource.is_per_pixel);
    let largest = resources.map(|planned| planned.bytes).max().unwrap_or(0);
    let largest = largest.max(uploads(plan) + UPLOAD_BYTES);
    let most = plan.passes.iter().map(|planned| planned.pass.bindings.len()).max();
    Needs {
        storage_binding_bytes: largest,
        buffer_bytes: largest,
        // One more for the parameters.
        storage_buffers_per_stage: most.map_or(0, |most| most as u32 + 1),
    }
}

/// A submission of frames.
pub(crate) type Submission = wgpu::SubmissionIndex;

/// The GPU backend.
pub(crate) struct GpuExecutor {
    gpu: Gpu,
    /// Pipelines by source, those of former settings included.
    pipelines: BTreeMap<String, Pipeline>,
    buffers: BTreeMap<(&'static Buffer, usize), StorageBuffer>,
    bands: Vec<Band>,
    /// Number of frames for which there is memory.
    frames: usize,
    /// Place of the last frame in the last submission.
    last: usize,
    /// Dispatches of fused passes.
    fused: Vec<Step>,
    /// Dispatches of passes one by one, made when they are first needed: for timing and inspection.
    single: Vec<Step>,
    uploads: Uploads,
    /// Read-backs of the submissions in flight, one set a place; a place gets its set when it is first used.
    ring: Vec<Vec<Readback>>,
    texture: Option<TextureOut>,
    /// Elements of the mesh, if there is one, in the slab of each frame of a submission.
    slabs: Vec<Slab<f32>>,
    /// Set if all element maps must be sent with the next frame: the last submission placed them elsewhere, or failed.
    resend: bool,

    /// Contents of a per-frame buffer, before their upload.
    numbers: Vec<f32>,
    /// Ground truth of a frame.
    layers: Vec<u32>,
    /// Timers of the passes one by one, and of a frame.
    timers: Option<[Timer; 2]>,
    times: Vec<PassTime>,
    frame_ms: Option<f64>,
}

impl GpuExecutor {
    /// Compiles the passes of a plan and allocates the buffers of its resources.
    pub(crate) fn new(gpu: Gpu, plan: &Plan, tables: &Tables) -> Result<Self, SynthError> {
        let mut executor = Self {
            gpu,
            pipelines: BTreeMap::new(),
            buffers: BTreeMap::new(),
            bands: Vec::new(),
            frames: 1,
            last: 0,
            fused: Vec::new(),
            single: Vec::new(),
            uploads: Uploads::default(),
            ring: Vec::new(),
            texture: None,
            slabs: Vec::new(),
            resend: false,
            numbers: Vec::new(),
            layers: Vec::new(),
            timers: None,
            times: Vec::new(),
            frame_ms: None,
        };
        executor.fit(plan, tables, &[])?;
        Ok(executor)
    }

    /// GPU device of this executor.
    pub(crate) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Names of the compiled passes.
    pub(crate) fn pipelines(&self) -> impl Iterator<Item = &'static str> + '_ {
        self.fused.iter().flat_map(|step| &step.passes).map(|pass| pass.name)
    }

    /// Size of the resources of the plan, bytes.
    pub(crate) fn bytes(&self) -> u64 {
        self.uploads.planned + self.buffers.values().map(StorageBuffer::bytes).sum::<u64>()
    }
}
