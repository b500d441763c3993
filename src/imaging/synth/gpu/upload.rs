//! Uploads of frames: parameters, buffers filled before every frame, and the maps of the elements in their slabs.

use super::GpuExecutor;
use super::steps::{is_per_pixel, numbers_of};
use crate::effects::buffers::{Buffer, ELEMENT_MAPS};
use crate::effects::pass::{ParamBlock, Pass, View};
use crate::plan::{Plan, PlannedResource};
use crate::synth::linker;
use crate::synth::slab::{Slab, States};
use crate::synth::tables::Tables;
use crate::synth::{FrameState, SynthError};
use insonify_base::parallel::{for_each, try_for_each};
use insonify_gpu::{GpuError, StorageBuffer};
use insonify_mesh::InvalidMesh;
use insonify_mesh::element::{Carry, Frame as ElementFrame};

/// Alignment of what is bound of a buffer, bytes.
const ALIGNED: usize = ParamBlock::CAPACITY;

/// Allowance for the parameters of a frame, bytes.
pub(super) const UPLOAD_BYTES: u64 = 64 << 10;

/// Bytes of the maps of an element: in the reference state, and in the deformed state.
const OF_REFERENCE: usize = size_of::<ElementFrame<f32>>();
const OF_DEFORMED: usize = size_of::<ElementFrame<f32>>() + size_of::<Carry<f32>>();

/// Places in the buffer of uploads, bytes: element maps of the reference state, blocks of parameters of the passes one
/// by one and fused, buffers filled before every frame, and element maps of the deformed state, which end with those
/// that a submission has.
#[derive(Default)]
pub(super) struct Uploads {
    /// The buffer.
    buffer: Option<StorageBuffer>,
    /// Its contents.
    pub(super) contents: Vec<u8>,
    /// Start of the element maps of the reference state that a submission uploads.
    start: usize,
    pub(super) single_at: usize,
    pub(super) fused_at: usize,
    /// Buffers, with their starts and sizes for one frame.
    pub(super) per_frame: Vec<(&'static Buffer, usize, usize)>,
    maps_at: usize,
    /// Bytes of the resources of the plan that it holds.
    pub(super) planned: u64,
    /// End of what a submission uploads.
    end: usize,
}

/// Bytes of the resources that a frame uploads.
pub(super) fn uploads(plan: &Plan) -> u64 {
    let resources = plan.resources.iter();
    let uploaded = resources.filter(|planned| planned.resource.per_frame.is_some() || planned.resource.is_packed);
    uploaded.map(|planned| planned.bytes).sum()
}

impl GpuExecutor {
    pub(super) fn fit_uploads(&mut self, plan: &Plan, tables: &Tables) -> Result<(), GpuError> {
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
            let passes: Vec<_> = numbers_of(&fused).map(|pass| plan.passes[pass].pass).collect();
            bands(&passes) * linker::block_bytes(passes.len())
        });
        let mut end = fused_at + self.frames * fused.sum::<usize>();
        let per_frame = plan
            .resources
            .iter()
            .filter(|planned| planned.resource.per_frame.is_some());
        let (mut longest, mut planned) = (0, 0);
        let place = |resource: &PlannedResource| {
            let (start, bytes) = (end, resource.bytes as usize);
            end += (self.frames * bytes).next_multiple_of(ALIGNED);
            longest = longest.max(bytes);
            planned += bytes;
            (resource.resource, start, bytes)
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

    /// Takes over the states of the frames of the next submission, in order.
    pub(crate) fn stage(&mut self, plan: &Plan, tables: &Tables, states: &[&FrameState]) -> Result<(), SynthError> {
        let single = self.timers.is_some();
        let staged = self.stage_for(single, (plan, tables), states);
        self.resend_maps_on_error(staged)
    }

    pub(super) fn stage_for(
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
            for &(buffer, start, bytes) in &*per_frame {
                let Some(fill) = buffer.per_frame else { continue };
                fill(tables, state, &mut self.numbers);
                let numbers: &[u8] = bytemuck::cast_slice(&self.numbers);
                contents[start + frame * bytes..][..numbers.len()].copy_from_slice(numbers);
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
    pub(super) fn upload(&self, single: bool) -> Result<(), GpuError> {
        let uploads = &self.uploads;
        let start = if single || uploads.start < uploads.single_at {
            uploads.start
        } else {
            uploads.fused_at
        };
        let contents = &uploads.contents[start..uploads.end];
        self.uploads_buffer()?.write(&self.gpu, start as u64, contents)
    }

    pub(super) fn uploads_buffer(&self) -> Result<&StorageBuffer, GpuError> {
        self.uploads.buffer.as_ref().ok_or_else(|| GpuError::Mismatch {
            what: "buffers of uploads".into(),
            expected: 1,
            found: 0,
        })
    }

    /// On an error, marks the element maps for upload with the next frame.
    pub(super) fn resend_maps_on_error<T>(&mut self, result: Result<T, SynthError>) -> Result<T, SynthError> {
        self.resend |= result.is_err();
        result
    }
}

/// Cuts the mesh for several frames. Nodes that a frame leaves as they were are those of the frame before; the first
/// slab has those of the last submission.
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
