//! GPU execution of a plan: its buffers, pipelines and bind groups persist; a submission has one frame or several, one upload, and the
//! dispatches of the fused passes.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::layers::{Beam, numbered};
use super::linker::{self, ENTRY, Linked};
use super::slab::{Slab, States};
use super::tables::Tables;
use super::{Frame, FrameState, PassTime, SynthError};
use crate::effects::buffers::{
    self, AMPLITUDE, Buffer, ELEMENT, ELEMENT_MAPS, HITS, LABEL, LOSS, NEEDLE_MASK, PIXELS, POSITION, SCAN_MAP,
};
use crate::effects::pass::{Band, ParamBlock, Pass, View};
use crate::effects::truth::{self, LAYERS};
use crate::fusion::{Bound, Fused, MAX_BUFFERS, Sequence};
use crate::plan::{Plan, PlannedResource};
use insonify_base::memory;
use insonify_base::parallel::{for_each, try_for_each};
use insonify_gpu::{
    Access, Dispatch, Gpu, GpuError, Loops, Needs, PassSource, Pipeline, Readback, Recorder, StorageBuffer, TextureOut,
    Timer,
};
use insonify_mesh::InvalidMesh;
use insonify_mesh::element::{Carry, Frame as ElementFrame};

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

/// Bytes of the resources that a frame uploads.
fn uploads(plan: &Plan) -> u64 {
    let resources = plan.resources.iter();
    let uploaded = resources.filter(|planned| planned.resource.per_frame.is_some() || planned.resource.is_packed);
    uploaded.map(|planned| planned.bytes).sum()
}

/// A submission of frames.
pub(crate) type Submission = wgpu::SubmissionIndex;

/// Every loop of these shaders counts towards a bound that does not change within it, or narrows an interval of integers.
#[allow(unsafe_code, reason = "says that loops end")]
// SAFETY: as above.
const LOOPS: Loops = unsafe { Loops::ending() };

/// Alignment of what is bound of a buffer, bytes.
const ALIGNED: usize = ParamBlock::CAPACITY;

/// Largest number of frames of a submission.
const MAX_FRAMES: usize = 16;

/// Largest number of bytes that the passes of a submission write.
const FRAMES_BYTES: u64 = 512 << 20;

/// Size from which buffers filled from the tables are shared with other executors on the device, bytes.
const SHARED_BYTES: u64 = 64 << 10;

/// Number of pipelines kept, those of former settings included.
const MAX_PIPELINES: usize = 64;

/// Allowance for the parameters of a frame, bytes.
const UPLOAD_BYTES: u64 = 64 << 10;

/// Bytes of the maps of an element: in the reference state, and in the deformed state.
const OF_REFERENCE: usize = size_of::<ElementFrame<f32>>();
const OF_DEFORMED: usize = size_of::<ElementFrame<f32>>() + size_of::<Carry<f32>>();

/// A dispatch of a frame.
struct Step {
    passes: Vec<&'static Pass>,
    pipeline: Pipeline,
    bindings: wgpu::BindGroup,
    band: Band,
    /// Start of its blocks of parameters in the uploads, one a frame.
    blocks_at: usize,
    /// Workgroups of one frame.
    workgroups: [u32; 3],
}

/// Places in the buffer of uploads, bytes: element maps of the reference state, blocks of parameters of the passes one by one and fused,
/// buffers filled before every frame, and element maps of the deformed state, which end with those that a submission has.
#[derive(Default)]
struct Uploads {
    /// The buffer.
    buffer: Option<StorageBuffer>,
    /// Its contents.
    contents: Vec<u8>,
    /// Start of the element maps of the reference state that a submission uploads.
    start: usize,
    single_at: usize,
    fused_at: usize,
    /// Buffers, with their starts and sizes for one frame.
    per_frame: Vec<(&'static Buffer, usize, usize)>,
    maps_at: usize,
    /// Bytes of the resources of the plan that it holds.
    planned: u64,
    /// End of what a submission uploads.
    end: usize,
}

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
    /// Of the passes one by one, and of a frame.
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

    /// Adapts to a changed plan: creates new objects, drops unused ones, and uploads changed data.
    pub(crate) fn fit(&mut self, plan: &Plan, tables: &Tables, changed: &[&'static Buffer]) -> Result<(), SynthError> {
        if self.gpu.report().software {
            memory::check(plan.bytes().saturating_sub(self.bytes()), "a frame on software Vulkan")?;
        }
        self.frames = 1;
        self.fit_frames(plan, tables, changed)
    }

    /// Makes memory for several frames of a submission, as many of these as limits and memory allow, and returns their number.
    pub(crate) fn reserve_frames(&mut self, plan: &Plan, tables: &Tables, wanted: usize) -> Result<usize, SynthError> {
        let uploads = uploads(plan);
        let resources = plan.resources.iter();
        let written = || {
            resources
                .clone()
                .filter(|planned| linker::has_copy_per_frame(planned.resource))
        };
        let largest = written().map(|planned| planned.bytes).max().unwrap_or(0);
        let one = written().map(|planned| planned.bytes).sum::<u64>() + uploads;
        let fit = self.gpu.limits().max_storage_buffer_binding_size / (largest.max(uploads) + UPLOAD_BYTES);
        // The frames lie along z.
        let deepest = self.fused.iter().map(|step| step.workgroups[2]).max().unwrap_or(1);
        let along_z = self.gpu.limits().max_compute_workgroups_per_dimension / deepest.max(1);
        let fit = fit.min(FRAMES_BYTES / one.max(1)).min(along_z.into());
        let within = (fit as usize).clamp(1, MAX_FRAMES);
        // An image in bands is a submission of its own.
        let frames = if self.bands.len() > 1 {
            1
        } else {
            wanted.clamp(1, within)
        };
        if frames > self.frames {
            let more = one * (frames - self.frames) as u64;
            if self.gpu.report().software && memory::check(more, "frames of a submission").is_err() {
                return Ok(self.frames);
            }
            let before = std::mem::replace(&mut self.frames, frames);
            if let Err(error) = self.fit_frames(plan, tables, &[]) {
                self.frames = before;
                if !matches!(error, SynthError::Gpu(GpuError::OutOfMemory { .. })) {
                    return Err(error);
                }
                self.fit_frames(plan, tables, &[])?;
                return Ok(before);
            }
        }
        Ok(frames)
    }

    /// Makes what frames need. On an error nothing is kept, and the next frame makes it.
    fn fit_frames(&mut self, plan: &Plan, tables: &Tables, changed: &[&'static Buffer]) -> Result<(), SynthError> {
        // The bind groups hold buffers that may be replaced.
        self.fused.clear();
        self.single.clear();
        self.bands = plan.bands(tables, self.gpu.limits().max_storage_buffer_binding_size);
        let fitted = self
            .gpu
            .clone()
            .scoped("buffers and passes", || self.make_frames(plan, tables, changed));
        if fitted.is_err() {
            self.fused.clear();
            self.buffers.clear();
            self.uploads = Uploads::default();
            self.ring.clear();
        }
        fitted
    }

    fn make_frames(&mut self, plan: &Plan, tables: &Tables, changed: &[&'static Buffer]) -> Result<(), SynthError> {
        let parts = |buffer: &Buffer, bands: &[Band]| if buffer.is_per_pixel { bands.len() } else { 1 };
        self.buffers
            .retain(|&(buffer, part), _| plan.uses(buffer) && part < parts(buffer, &self.bands));
        let slab = self.slabs.drain(..).nth(std::mem::take(&mut self.last));
        if let Some(mesh) = tables.mesh.as_ref().filter(|_| plan.uses(&ELEMENT_MAPS)) {
            let mut slab = slab.unwrap_or_else(|| Slab::new(mesh));
            slab.invalidate();
            let others: Vec<_> = (1..self.frames).map(|_| slab.new_for_same_mesh()).collect();
            self.slabs.push(slab);
            self.slabs.extend(others);
        }
        let owned = |planned: &&PlannedResource| planned.resource.per_frame.is_none() && !planned.resource.is_packed;
        for planned in plan.resources.iter().filter(owned) {
            for part in 0..parts(planned.resource, &self.bands) {
                let changed = changed.contains(&planned.resource);
                self.fit_buffer(planned.resource, planned.bytes, part, tables, changed)?;
            }
        }
        self.fit_uploads(plan, tables)?;
        if self.pipelines.len() > MAX_PIPELINES {
            self.pipelines.clear();
        }
        self.fused = self.steps(plan, tables, plan.fused(self.most_buffers()), self.uploads.fused_at)?;
        self.fit_outputs(tables)?;
        if self.timers.is_some() {
            self.time_passes(true, plan, tables)?;
        }
        Ok(())
    }

    fn most_buffers(&self) -> usize {
        // One is taken by the parameters.
        (self.gpu.limits().max_storage_buffers_per_shader_stage as usize - 1).min(MAX_BUFFERS)
    }

    /// Keeps read-backs and the host's texture as long as the image size does not change.
    fn fit_outputs(&mut self, tables: &Tables) -> Result<(), GpuError> {
        let sizes = self.read_back_sizes(tables);
        let kept = self
            .ring
            .first()
            .is_some_and(|first| sizes.into_iter().eq(first.iter().map(Readback::bytes)));
        if !kept {
            self.ring.clear();
            self.reserve_place(tables, 0)?;
        }
        let size = (tables.width() as u32, tables.height() as u32);
        self.texture
            .take_if(|kept| (kept.texture().width(), kept.texture().height()) != size);
        Ok(())
    }

    /// Bytes that come back from a submission: the pixels of each band, and behind them the ground truth, if there is any.
    fn read_back_sizes(&self, tables: &Tables) -> Vec<u64> {
        let row_bytes = (self.frames * tables.words_per_row() * 4) as u64;
        let pixels = self.bands.iter().map(|band| u64::from(band.rows) * row_bytes);
        let layers = self.buffers.get(&(&LAYERS, 0)).map(StorageBuffer::bytes);
        pixels.chain(layers).collect()
    }

    /// Makes read-backs for the places of the ring up to one.
    fn reserve_place(&mut self, tables: &Tables, place: usize) -> Result<(), GpuError> {
        while self.ring.len() <= place {
            let sizes = self.read_back_sizes(tables).into_iter();
            let readbacks = sizes.map(|bytes| Readback::new(&self.gpu, "frame", bytes));
            self.ring.push(readbacks.collect::<Result<_, _>>()?);
        }
        Ok(())
    }

    fn fit_buffer(
        &mut self,
        buffer: &'static Buffer,
        bytes: u64,
        part: usize,
        tables: &Tables,
        changed: bool,
    ) -> Result<(), GpuError> {
        let bytes = if buffer.is_per_pixel {
            bytes / tables.height() as u64 * u64::from(self.bands[part].rows)
        } else {
            bytes
        };
        let bytes = bytes
            * if linker::has_copy_per_frame(buffer) {
                self.frames as u64
            } else {
                1
            };
        let key = (buffer, part);
        let present = self.buffers.get(&key);
        let fits = present.is_some_and(|buffer| buffer.bytes() == bytes.next_multiple_of(4).max(4));
        let contents = buffer.contents.filter(|_| !fits || changed);
        let contents = contents.map(|contents| contents.bytes(tables, self.bands[part]));
        match contents {
            Some(mut contents) if bytes >= SHARED_BYTES => {
                self.buffers.remove(&key);
                contents.resize(bytes as usize, 0);
                let shared = StorageBuffer::shared(&self.gpu, buffer.name, &contents)?;
                self.buffers.insert(key, shared);
                return Ok(());
            }
            _ if fits => {}
            _ => {
                // Freed before it is made in another size.
                self.buffers.remove(&key);
                let zeroed = StorageBuffer::zeroed(&self.gpu, buffer.name, bytes)?;
                self.buffers.insert(key, zeroed);
            }
        }
        contents.map_or(Ok(()), |contents| self.buffers[&key].write(&self.gpu, 0, &contents))
    }

    fn fit_uploads(&mut self, plan: &Plan, tables: &Tables) -> Result<(), GpuError> {
        let elements = if self.slabs.is_empty() {
            0
        } else {
            ELEMENT_MAPS.bytes(tables) as usize / (OF_REFERENCE + OF_DEFORMED)
        };
        let bands = |passes: &[&Pass]| {
            if passes.iter().any(|pass| is_per_pixel(pass)) {
                self.bands.len()
            } else {
                1
            }
        };
        let single_at = (self.frames * elements * OF_REFERENCE).next_multiple_of(ALIGNED);
        let single = plan
            .passes
            .iter()
            .map(|planned| bands(&[planned.pass]) * linker::block_bytes(1));
        let fused_at = single_at + self.frames * single.sum::<usize>();
        let fused = plan.fused(self.most_buffers()).into_iter().map(|fused| {
            let passes: Vec<_> = numbers_of(&fused).map(|at| plan.passes[at].pass).collect();
            bands(&passes) * linker::block_bytes(passes.len())
        });
        let mut end = fused_at + self.frames * fused.sum::<usize>();
        let per_frame = plan
            .resources
            .iter()
            .filter(|planned| planned.resource.per_frame.is_some());
        let (mut longest, mut planned) = (0, 0);
        let place = |resource: &PlannedResource| {
            let (at, bytes) = (end, resource.bytes as usize);
            end += (self.frames * bytes).next_multiple_of(ALIGNED);
            longest = longest.max(bytes);
            planned += bytes;
            (resource.resource, at, bytes)
        };
        let per_frame = per_frame.map(place).collect();
        let bytes = end + self.frames * elements * OF_DEFORMED;
        let kept = self.uploads.buffer.take().filter(|kept| kept.bytes() == bytes as u64);
        let buffer = match kept {
            Some(kept) => kept,
            None => StorageBuffer::zeroed(&self.gpu, "uploads", bytes as u64)?,
        };
        self.uploads = Uploads {
            buffer: Some(buffer),
            contents: vec![0; bytes],
            start: single_at,
            single_at,
            fused_at,
            per_frame,
            planned: (self.frames * (planned + elements * (OF_REFERENCE + OF_DEFORMED))) as u64,
            maps_at: end,
            end,
        };
        self.numbers.clear();
        // Twice their size, as some compute them in two steps.
        self.numbers.reserve(longest / 2);
        Ok(())
    }

    /// Dispatches of passes, with their constants in the uploads.
    fn steps(
        &mut self,
        plan: &Plan,
        tables: &Tables,
        fused: Vec<Fused>,
        mut blocks_at: usize,
    ) -> Result<Vec<Step>, GpuError> {
        let all_rows = Band {
            first_row: 0,
            rows: tables.height() as u32,
        };
        let bound = plan.bound();
        let mut steps = Vec::new();
        for fused in fused {
            let linked = linker::link(&bound, &fused);
            // Kept by source: other settings mostly link to the same.
            let pipeline = match self.pipelines.get(&linked.source) {
                Some(pipeline) => pipeline.clone(),
                None => {
                    let pipeline = self.pipeline(&bound, &fused, &linked)?;
                    self.pipelines.insert(linked.source.clone(), pipeline.clone());
                    pipeline
                }
            };
            let passes: Vec<&'static Pass> = numbers_of(&fused).map(|at| bound[at].pass).collect();
            // Buffers of the beam fit whole; those of pixels may exceed a binding.
            let bands: Cow<[Band]> = if passes.iter().any(|pass| is_per_pixel(pass)) {
                self.bands.clone().into()
            } else {
                vec![all_rows].into()
            };
            for (part, &band) in bands.iter().enumerate() {
                let extents: Vec<_> = passes.iter().map(|pass| pass.grid.workgroups(tables, band)).collect();
                self.write_constants(blocks_at, &extents, &linked, part);
                steps.push(Step {
                    bindings: self.bind(&pipeline, &linked, part, blocks_at)?,
                    pipeline: pipeline.clone(),
                    band,
                    blocks_at,
                    workgroups: linker::workgroups(&bound, &fused, &extents),
                    passes: passes.clone(),
                });
                blocks_at += self.frames * linker::block_bytes(passes.len());
            }
        }
        Ok(steps)
    }

    /// Writes the extents of the passes and the strides between the frames of each buffer into the blocks of a dispatch.
    fn write_constants(&mut self, blocks_at: usize, extents: &[[u32; 3]], linked: &Linked, part: usize) {
        let (block, passes) = (linker::block_bytes(extents.len()), extents.len());
        let extents = extents.iter().flat_map(|&[x, y, z]| [x, y, z, 0]);
        let strides = linked.buffers.iter().map(|bound| {
            let per_frame = self
                .uploads
                .per_frame
                .iter()
                .find(|(buffer, ..)| *buffer == bound.buffer);
            let part = if bound.buffer.is_per_pixel { part } else { 0 };
            let bytes = match per_frame {
                Some(&(_, _, bytes)) => bytes as u64,
                None => self.buffers.get(&(bound.buffer, part)).map_or(0, StorageBuffer::bytes) / self.frames as u64,
            };
            bytes as u32 / bound.element
        });
        let constants: Vec<u32> = extents.chain(strides).collect();
        let at = blocks_at + passes * ParamBlock::CAPACITY;
        for frame in 0..self.frames {
            let of_frame = &mut self.uploads.contents[at + frame * block..];
            of_frame[..4 * constants.len()].copy_from_slice(bytemuck::cast_slice(&constants));
        }
    }

    fn make_single(&mut self, plan: &Plan, tables: &Tables) -> Result<(), GpuError> {
        if self.single.is_empty() {
            let alone = |at| {
                vec![Sequence {
                    passes: vec![at],
                    by_line: false,
                }]
            };
            let alone = (0..plan.passes.len()).map(alone).collect();
            self.single = self.steps(plan, tables, alone, self.uploads.single_at)?;
        }
        Ok(())
    }

    fn pipeline(&self, bound: &[Bound], fused: &Fused, linked: &Linked) -> Result<Pipeline, GpuError> {
        let names: Vec<&str> = numbers_of(fused).map(|at| bound[at].pass.name).collect();
        let storage: Vec<Access> = linked.buffers.iter().map(|bound| bound.access).collect();
        let source = PassSource {
            label: &names.join(" + "),
            source: &linked.source,
            entry: ENTRY,
            storage: &storage,
            loops: LOOPS,
        };
        Pipeline::with_block(&self.gpu, &source, linker::block_bytes(linked.passes) as u64)
    }

    fn bind(
        &self,
        pipeline: &Pipeline,
        linked: &Linked,
        part: usize,
        blocks_at: usize,
    ) -> Result<wgpu::BindGroup, GpuError> {
        let uploads = self.uploads_buffer()?;
        let blocks = uploads.part(
            blocks_at as u64,
            (self.frames * linker::block_bytes(linked.passes)) as u64,
        );
        let storage = linked.buffers.iter().map(|bound| {
            let buffer = bound.buffer;
            let per_frame = self.uploads.per_frame.iter().find(|(known, ..)| *known == buffer);
            match per_frame {
                Some(&(_, at, bytes)) => uploads.part(at as u64, (self.frames * bytes) as u64),
                None if buffer.is_packed => uploads.part(0, uploads.bytes()),
                None => self.buffers[&(buffer, if buffer.is_per_pixel { part } else { 0 })].entire(),
            }
        });
        pipeline.bind_parts(&self.gpu, blocks, &storage.collect::<Vec<_>>())
    }

    /// Takes over the states of the frames of the next submission, in order.
    pub(crate) fn stage(&mut self, plan: &Plan, tables: &Tables, states: &[&FrameState]) -> Result<(), SynthError> {
        let single = self.timers.is_some();
        let staged = self.stage_for(single, (plan, tables), states);
        self.resend_maps_on_error(staged)
    }

    fn stage_for(
        &mut self,
        single: bool,
        (plan, tables): (&Plan, &Tables),
        states: &[&FrameState],
    ) -> Result<(), SynthError> {
        if self.fused.is_empty() {
            self.fit_frames(plan, tables, &[])?;
        }
        if single {
            self.make_single(plan, tables)?;
        }
        self.stage_maps(tables, states)?;
        let Uploads {
            contents, per_frame, ..
        } = &mut self.uploads;
        let singles = if single { &self.single[..] } else { &[] };
        for (frame, &state) in states.iter().enumerate() {
            let view = View {
                tables,
                state,
                slab: self.slabs.get(frame),
            };
            for step in singles.iter().chain(&self.fused) {
                let block = step.blocks_at + frame * linker::block_bytes(step.passes.len());
                let blocks = contents[block..].chunks_exact_mut(ParamBlock::CAPACITY);
                for (pass, block) in step.passes.iter().zip(blocks) {
                    block.copy_from_slice((pass.params)(&view, step.band).slot());
                }
            }
            for &(buffer, at, bytes) in &*per_frame {
                let Some(fill) = buffer.per_frame else { continue };
                fill(tables, state, &mut self.numbers);
                let numbers: &[u8] = bytemuck::cast_slice(&self.numbers);
                contents[at + frame * bytes..][..numbers.len()].copy_from_slice(numbers);
            }
        }
        Ok(())
    }

    /// Cuts the mesh for each frame, and takes over what has changed.
    fn stage_maps(&mut self, tables: &Tables, states: &[&FrameState]) -> Result<(), SynthError> {
        let uploads = &mut self.uploads;
        (uploads.start, uploads.end) = (uploads.single_at, uploads.maps_at);
        let last = std::mem::replace(&mut self.last, states.len() - 1);
        if self.slabs.is_empty() {
            return Ok(());
        }
        self.slabs.swap(0, last);
        let slabs = &mut self.slabs[..states.len()];
        let moved = match (&mut *slabs, states) {
            ([slab], [state]) => slab.update(tables, state)?,
            _ => {
                cut(slabs, tables, states)?;
                States::BOTH
            }
        };
        let resend = std::mem::take(&mut self.resend);
        for frame in 0..slabs.len() {
            let (before, slabs) = slabs.split_at_mut(frame);
            let slab = &mut slabs[0];
            match before.last() {
                Some(before) if slab.has_reference_of(before) => slab.maps_at[0] = before.maps_at[0],
                _ if moved.reference || resend => {
                    // Before the blocks, so that one write takes both.
                    let maps: &[u8] = bytemuck::cast_slice(slab.reference.frames.as_flattened());
                    uploads.start -= maps.len();
                    slab.maps_at[0] = (uploads.start / 16) as u32;
                    uploads.contents[uploads.start..][..maps.len()].copy_from_slice(maps);
                }
                _ => {}
            }
            if moved.deformed || resend {
                for (place, maps) in [
                    bytemuck::cast_slice::<_, u8>(slab.deformed.frames.as_flattened()),
                    bytemuck::cast_slice(slab.deformed.carries.as_flattened()),
                ]
                .into_iter()
                .enumerate()
                {
                    slab.maps_at[1 + place] = (uploads.end / 16) as u32;
                    uploads.contents[uploads.end..][..maps.len()].copy_from_slice(maps);
                    uploads.end += maps.len();
                }
            }
        }
        Ok(())
    }

    /// Uploads what has been staged, all at once.
    fn upload(&self, single: bool) -> Result<(), GpuError> {
        let uploads = &self.uploads;
        let start = if single || uploads.start < uploads.single_at {
            uploads.start
        } else {
            uploads.fused_at
        };
        let contents = &uploads.contents[start..uploads.end];
        self.uploads_buffer()?.write(&self.gpu, start as u64, contents)
    }

    fn uploads_buffer(&self) -> Result<&StorageBuffer, GpuError> {
        self.uploads.buffer.as_ref().ok_or_else(|| GpuError::Mismatch {
            what: "buffers of uploads".into(),
            expected: 1,
            found: 0,
        })
    }

    /// Submits the frames that have been staged, whose pixels are asked for at a place of the ring.
    pub(crate) fn submit(&mut self, tables: &Tables, count: usize, place: usize) -> Result<Submission, SynthError> {
        let gpu = self.gpu.clone();
        let submitted = gpu.scoped("frame", || {
            self.reserve_place(tables, place)?;
            self.upload(self.timers.is_some())?;
            let submission = gpu.submit("frame", |recorder| {
                self.run_all(recorder, count)?;
                let pixels = (0..self.bands.len()).map(|part| (&PIXELS, part));
                for (source, readback) in pixels.chain([(&LAYERS, 0)]).zip(&self.ring[place]) {
                    let bytes = readback.bytes() / self.frames as u64 * count as u64;
                    recorder.read_back_part(&self.buffers[&source], 0..bytes, readback)?;
                }
                Ok(())
            })?;
            self.ring[place].iter().for_each(Readback::request);
            Ok(submission)
        });
        if submitted.is_err() {
            self.release(place);
        }
        // The maps of several frames lie elsewhere than those of one.
        self.resend |= submitted.is_err() || count > 1;
        submitted
    }

    /// On an error, marks the element maps for upload with the next frame.
    fn resend_maps_on_error<T>(&mut self, result: Result<T, SynthError>) -> Result<T, SynthError> {
        self.resend |= result.is_err();
        result
    }

    /// Whether the pixels of a place have come; never waits.
    pub(crate) fn is_ready(&self, place: usize) -> Result<bool, SynthError> {
        self.gpu.poll_once()?;
        Ok(self.ring[place].iter().all(Readback::is_ready))
    }

    /// Waits for a submission, and copies the pixels of its frames.
    pub(crate) fn take(
        &mut self,
        (plan, tables): (&Plan, &Tables),
        submission: Submission,
        place: usize,
        frames: &mut [Frame],
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        gpu.scoped("pixels", || {
            let waited = gpu.wait_for("a frame", Some(submission));
            let (width, stride) = (tables.width(), tables.words_per_row() * 4);
            let copied = waited.and_then(|()| {
                for (at, frame) in frames.iter_mut().enumerate() {
                    for (band, readback) in self.bands.iter().zip(&self.ring[place]) {
                        let rows = &mut frame.pixels[band.first_row as usize * width..][..band.rows as usize * width];
                        readback.copy_rows(at * band.rows as usize * stride, rows, width, stride)?;
                    }
                    if let Some(readback) = self.ring[place].get(self.bands.len()) {
                        let bytes = readback.bytes() as usize / self.frames;
                        self.layers.resize(bytes / 4, 0);
                        readback.copy_rows(at * bytes, bytemuck::cast_slice_mut(&mut self.layers), bytes, bytes)?;
                    }
                    truth::images(tables, &self.layers, |value| value as u16, &mut frame.layers);
                }
                Ok(())
            });
            self.release(place);
            copied?;
            self.read_times(plan)
        })
    }

    /// Gives up the pixels of a place.
    pub(crate) fn release(&self, place: usize) {
        for readback in self.ring.get(place).into_iter().flatten() {
            readback.release(&self.gpu);
        }
    }

    /// Renders a frame into the texture.
    pub(crate) fn render_to_texture(
        &mut self,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        self.with_texture(plan, tables, state, |executor| {
            gpu.submit("frame", |recorder| executor.run_into_texture(recorder))?;
            executor.read_times(plan)
        })
    }

    /// Records a frame into a host's encoder, up to its copy into the texture.
    pub(crate) fn encode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        self.with_texture(plan, tables, state, |executor| {
            Ok(executor.run_into_texture(&mut Recorder::new(&gpu, encoder))?)
        })
    }

    /// Uploads a frame and has `run` record it, in one error scope.
    fn with_texture(
        &mut self,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
        run: impl FnOnce(&mut Self) -> Result<(), SynthError>,
    ) -> Result<(), SynthError> {
        let gpu = self.gpu.clone();
        let done = gpu.scoped("frame", || {
            if self.texture.is_none() {
                self.texture = Some(self.make_texture(tables)?);
            }
            self.stage(plan, tables, &[state])?;
            self.upload(self.timers.is_some())?;
            run(self)
        });
        self.resend_maps_on_error(done)
    }

    fn run_into_texture(&self, recorder: &mut Recorder) -> Result<(), GpuError> {
        self.run_all(recorder, 1)?;
        match &self.texture {
            Some(texture) => recorder.copy_to_texture(&self.buffers[&(&PIXELS, 0)], texture),
            None => Ok(()),
        }
    }

    fn run_all(&self, recorder: &mut Recorder, frames: usize) -> Result<(), GpuError> {
        self.clear_hits(recorder);
        let Some([of_passes, of_frame]) = &self.timers else {
            return recorder.run("frame", dispatches(&self.fused, frames));
        };
        recorder.run_timed(of_passes, dispatches(&self.single, frames))?;
        self.clear_hits(recorder);
        recorder.run_timed_whole(of_frame, dispatches(&self.fused, frames))
    }

    /// Runs the steps up to and including a pass; all of them if there is none of that name.
    pub(crate) fn run_until(
        &mut self,
        pass: &str,
        plan: &Plan,
        tables: &Tables,
        state: &FrameState,
    ) -> Result<(), SynthError> {
        let staged = self.stage_for(true, (plan, tables), &[state]);
        let run = staged.and_then(|()| {
            self.upload(true)?;
            self.gpu.submit("clear", |recorder| {
                self.clear_hits(recorder);
                Ok(())
            })?;
            self.run_steps(0, self.end_of(pass))
        });
        self.resend_maps_on_error(run)
    }

    /// Zeroes the hits of the warp.
    fn clear_hits(&self, recorder: &mut Recorder) {
        if let Some(hits) = self.buffers.get(&(&HITS, 0)) {
            recorder.clear(hits);
        }
    }

    /// Goes on with the frame that [`Self::run_until`] began: from behind a pass up to and including another.
    #[cfg(any(test, feature = "analysis"))]
    pub(crate) fn run_on(&mut self, behind: &str, pass: &str) -> Result<(), SynthError> {
        let start = self.end_of(behind);
        self.run_steps(start, self.end_of(pass).max(start))
    }

    fn end_of(&self, pass: &str) -> usize {
        let last = self.single.iter().rposition(|step| step.passes[0].name == pass);
        last.map_or(self.single.len(), |at| at + 1)
    }

    fn run_steps(&mut self, start: usize, end: usize) -> Result<(), SynthError> {
        self.gpu.submit("part of a frame", |recorder| {
            recorder.run("part of a frame", dispatches(&self.single[start..end], 1))
        })?;
        Ok(())
    }

    fn make_texture(&self, tables: &Tables) -> Result<TextureOut, GpuError> {
        if self.bands.len() > 1 {
            return Err(GpuError::Limit {
                what: "a frame left on the GPU in one piece".into(),
                limit: "max_storage_buffer_binding_size",
                needed: SCAN_MAP.bytes(tables),
                available: self.gpu.limits().max_storage_buffer_binding_size,
            });
        }
        TextureOut::new(&self.gpu, tables.width() as u32, tables.height() as u32)
    }

    /// Enables or disables timing: each frame is then made twice, by passes one by one and fused.
    pub(crate) fn time_passes(&mut self, on: bool, plan: &Plan, tables: &Tables) -> Result<(), SynthError> {
        if on {
            self.make_single(plan, tables)?;
        }
        let names: Vec<&str> = self.single.iter().map(|step| step.passes[0].name).collect();
        let timers = |names: &[&str]| Timer::new(&self.gpu, names);
        self.timers = if on {
            timers(&names)?.zip(timers(&["frame"])?).map(<[Timer; 2]>::from)
        } else {
            None
        };
        self.times.clear();
        self.frame_ms = None;
        self.times.reserve_exact(plan.passes.len());
        Ok(())
    }

    fn read_times(&mut self, plan: &Plan) -> Result<(), SynthError> {
        self.times.clear();
        self.frame_ms = None;
        let Some([of_passes, of_frame]) = &mut self.timers else {
            return Ok(());
        };
        let timings = of_passes.read(&self.gpu)?;
        self.frame_ms = Some(of_frame.read(&self.gpu)?.frame_ms);
        for planned in &plan.passes {
            let name = planned.pass.name;
            let ms = timings
                .passes
                .iter()
                .filter(|pass| pass.name == name)
                .map(|pass| pass.ms)
                .sum();
            self.times.push(PassTime { name, ms });
        }
        Ok(())
    }

    /// Reads the beam-space results of the last frame, relative to the local origin, as they were after the last executed pass.
    pub(crate) fn beam(&self, flipped: bool, tables: &Tables) -> Result<Beam, SynthError> {
        let count = tables.lines() * tables.samples();
        let words = |buffer: &'static Buffer, per_sample: usize| -> Result<Vec<u32>, GpuError> {
            // Scenes without the passes that bind a buffer have none; its field of the beam stays empty.
            let Some(buffer) = self.buffers.get(&(buffer, 0)) else {
                return Ok(Vec::new());
            };
            let mut readback = Readback::new(&self.gpu, "beam", (count * per_sample * 4) as u64)?;
            let mut words = vec![0u32; count * per_sample];
            // Frames of a submission lie one behind the other in the buffer.
            let (start, bytes) = (self.last as u64 * buffer.bytes() / self.frames as u64, readback.bytes());
            self.gpu.submit("beam", |recorder| {
                recorder.read_back_part(buffer, start..start + bytes, &readback)
            })?;
            readback.read(&self.gpu, &mut words)?;
            Ok(words)
        };
        let numbers =
            |words: Vec<u32>| -> Vec<f64> { words.into_iter().map(|word| f64::from(f32::from_bits(word))).collect() };
        let mask = numbers(words(&NEEDLE_MASK, 2)?);
        let elements = self
            .slabs
            .get(self.last)
            .map_or(&[][..], |slab| &slab.deformed.elements);
        Ok(Beam {
            lines: tables.lines(),
            samples: tables.samples(),
            position: numbers(words(&POSITION, 4)?)
                .chunks_exact(4)
                .map(|p| [p[0], p[1], p[2], p[3]])
                .collect(),
            element: numbered(elements, words(&ELEMENT, 1)?),
            label: words(&LABEL, 1)?.into_iter().map(|word| word as u8).collect(),
            amplitude: numbers(words(buffers::bound(&AMPLITUDE, flipped), 1)?),
            needle: mask.iter().step_by(2).copied().collect(),
            shade: mask.iter().skip(1).step_by(2).copied().collect(),
            loss: words(&LOSS, 1)?,
        })
    }

    /// GPU device of this executor.
    pub(crate) fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Texture of the last frame rendered into it.
    pub(crate) fn texture(&self) -> Option<&wgpu::Texture> {
        self.texture.as_ref().map(TextureOut::texture)
    }

    /// Durations of the passes of the last frame.
    pub(crate) fn times(&self) -> &[PassTime] {
        &self.times
    }

    /// GPU time of the fused passes of the last frame, ms.
    pub(crate) fn frame_ms(&self) -> Option<f64> {
        self.frame_ms
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

/// Cuts the mesh for several frames. Nodes that a frame leaves as they were are those of the frame before; the first slab has those of
/// the last submission.
fn cut(slabs: &mut [Slab<f32>], tables: &Tables, states: &[&FrameState]) -> Result<(), InvalidMesh> {
    try_for_each((&mut *slabs, states), &|(slab, state)| slab.move_nodes(state))?;
    for (frame, state) in states.iter().enumerate().skip(1) {
        let unmoved = States {
            deformed: state.nodes.is_none(),
            reference: state.reference.is_none(),
        };
        let (before, slabs) = slabs.split_at_mut(frame);
        slabs[0].copy_states_from(&before[frame - 1], unmoved);
    }
    for_each((slabs, states), &|(slab, state)| {
        slab.cut(tables, &state.probe_to_world);
    });
    Ok(())
}

/// Dispatches of steps, for a number of frames.
fn dispatches(steps: &[Step], frames: usize) -> impl Iterator<Item = Dispatch<'_>> {
    steps.iter().map(move |step| {
        let [x, y, z] = step.workgroups;
        Dispatch {
            pipeline: &step.pipeline,
            bindings: &step.bindings,
            slot: 0,
            workgroups: [x, y, z * frames as u32],
        }
    })
}

/// Numbers of the passes of a dispatch, in the order in which it has them.
fn numbers_of(fused: &Fused) -> impl Iterator<Item = usize> + '_ {
    fused.iter().flat_map(|sequence| &sequence.passes).copied()
}

fn is_per_pixel(pass: &Pass) -> bool {
    pass.bindings.iter().any(|(buffer, _)| buffer.is_per_pixel)
}
