//! Memory of frames: buffers for the resources of a plan, and for several frames of a submission.

use super::GpuExecutor;
use super::upload::{UPLOAD_BYTES, Uploads, uploads};
use crate::effects::buffers::{Buffer, ELEMENT_MAPS};
use crate::effects::pass::Band;
use crate::plan::{Plan, PlannedResource};
use crate::synth::SynthError;
use crate::synth::linker;
use crate::synth::slab::Slab;
use crate::synth::tables::Tables;
use insonify_base::memory;
use insonify_gpu::{GpuError, StorageBuffer};

/// Largest number of frames of a submission.
const MAX_FRAMES: usize = 16;

/// Largest number of bytes that the passes of a submission write.
const FRAMES_BYTES: u64 = 512 << 20;

/// Size from which buffers filled from the tables are shared with other executors on the device, bytes.
const SHARED_BYTES: u64 = 64 << 10;

/// Number of pipelines kept, those of former settings included.
const MAX_PIPELINES: usize = 64;

impl GpuExecutor {
    /// Adapts to a changed plan: creates new objects, drops unused ones, and uploads changed data.
    pub(crate) fn fit(&mut self, plan: &Plan, tables: &Tables, changed: &[&'static Buffer]) -> Result<(), SynthError> {
        if self.gpu.report().software {
            memory::check(plan.bytes().saturating_sub(self.bytes()), "a frame on software Vulkan")?;
        }
        self.frames = 1;
        self.fit_frames(plan, tables, changed)
    }

    /// Makes memory for several frames of a submission, as many of these as limits and memory allow, and returns their
    /// number.
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
    pub(super) fn fit_frames(
        &mut self,
        plan: &Plan,
        tables: &Tables,
        changed: &[&'static Buffer],
    ) -> Result<(), SynthError> {
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
}
