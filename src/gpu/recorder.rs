//! Recording of the dispatches and copies of a submission.

use std::ops::Range;

use super::buffer::SLOT_BYTES;
use super::faults::check_limit;
use super::{Gpu, GpuError, Pipeline, Readback, StorageBuffer, TextureOut, Timer};

/// A dispatch of a pass.
#[derive(Debug, Clone, Copy)]
pub struct Dispatch<'a> {
    /// Pipeline of the pass.
    pub pipeline: &'a Pipeline,
    /// Bind group from [`Pipeline::bind`].
    pub bindings: &'a wgpu::BindGroup,
    /// Slot of its parameters in the bound [`Parameters`](super::Parameters).
    pub slot: u32,
    /// Number of workgroups along x, y and z.
    pub workgroups: [u32; 3],
}

/// Records one submission, within [`Gpu::submit`].
#[derive(Debug)]
pub struct Recorder<'a> {
    gpu: &'a Gpu,
    encoder: &'a mut wgpu::CommandEncoder,
}

impl<'a> Recorder<'a> {
    /// Records into an encoder of the same device; its owner submits it.
    pub fn new(gpu: &'a Gpu, encoder: &'a mut wgpu::CommandEncoder) -> Self {
        Self { gpu, encoder }
    }

    /// Runs dispatches in sequence in one compute pass; each sees the writes of those before it.
    ///
    /// An error here, as in the other runs, must be returned from [`Gpu::submit`]: nothing is submitted then.
    pub fn run<'d>(&mut self, label: &str, dispatches: impl IntoIterator<Item = Dispatch<'d>>) -> Result<(), GpuError> {
        self.compute(label, None, dispatches)
    }

    /// Runs dispatches as [`Recorder::run`] does, each in a compute pass of its own, timed under the name of the
    /// same index in `timer`; the counts must match.
    pub fn run_timed<'d>(
        &mut self,
        timer: &Timer,
        dispatches: impl IntoIterator<Item = Dispatch<'d>>,
    ) -> Result<(), GpuError> {
        let mut count = 0;
        for dispatch in dispatches {
            self.compute(dispatch.pipeline.label(), timer.writes(count), [dispatch])?;
            count += 1;
        }
        timer.check_count(count)?;
        timer.resolve(self.encoder);
        Ok(())
    }

    /// Runs dispatches as [`Recorder::run`] does, timed as the only name of `timer`: the frame time without other
    /// measurements.
    pub fn run_timed_whole<'d>(
        &mut self,
        timer: &Timer,
        dispatches: impl IntoIterator<Item = Dispatch<'d>>,
    ) -> Result<(), GpuError> {
        timer.check_count(1)?;
        self.compute("frame", timer.writes(0), dispatches)?;
        timer.resolve(self.encoder);
        Ok(())
    }

    /// Fills a buffer with zeros.
    pub fn clear(&mut self, buffer: &StorageBuffer) {
        self.encoder.clear_buffer(buffer.raw(), 0, None);
    }

    /// Copies the first bytes of a buffer, as many as `readback` holds, to be read after submission.
    pub fn read_back(&mut self, buffer: &StorageBuffer, readback: &Readback) -> Result<(), GpuError> {
        self.read_back_part(buffer, 0..readback.bytes(), readback)
    }

    /// Copies a part of a buffer (multiples of 4 bytes) to the start of `readback`, to be read after submission.
    pub fn read_back_part(
        &mut self,
        buffer: &StorageBuffer,
        part: Range<u64>,
        readback: &Readback,
    ) -> Result<(), GpuError> {
        let bytes = part.end - part.start;
        buffer.check_span("read back", part.start, bytes)?;
        self.gpu.counter().fetched(bytes);
        self.encoder
            .copy_buffer_to_buffer(buffer.raw(), part.start, readback.raw(), 0, bytes);
        Ok(())
    }

    /// Copies a packed grey image into a texture; see [`TextureOut`] for its layout.
    pub fn copy_to_texture(&mut self, pixels: &StorageBuffer, texture: &TextureOut) -> Result<(), GpuError> {
        texture.copy(self.encoder, pixels)
    }

    /// Command encoder, for operations not offered here.
    pub fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        self.encoder
    }

    fn compute<'d>(
        &mut self,
        label: &str,
        timestamp_writes: Option<wgpu::ComputePassTimestampWrites<'_>>,
        dispatches: impl IntoIterator<Item = Dispatch<'d>>,
    ) -> Result<(), GpuError> {
        let available = self.gpu.limits().max_compute_workgroups_per_dimension;
        let descriptor = wgpu::ComputePassDescriptor {
            label: Some(label),
            timestamp_writes,
        };
        let mut pass = self.encoder.begin_compute_pass(&descriptor);
        for Dispatch {
            pipeline,
            bindings,
            slot,
            workgroups: [x, y, z],
        } in dispatches
        {
            check_limit(
                || format!("pass '{}'", pipeline.label()),
                "max_compute_workgroups_per_dimension",
                u64::from(x.max(y).max(z)),
                u64::from(available),
            )?;
            pass.set_pipeline(pipeline.raw());
            pass.set_bind_group(0, bindings, &[slot.saturating_mul(SLOT_BYTES as u32)]);
            pass.dispatch_workgroups(x, y, z);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Access, Loops, Parameters, PassSource, testing};

    #[test]
    fn a_dispatch_beyond_the_limit_or_its_slots_is_an_error_and_the_device_lives_on() {
        let Some(gpu) = testing::open() else { return };
        let pass = PassSource {
            label: "touch",
            source: "@group(0) @binding(0) var<storage, read> value: u32;
                @group(0) @binding(1) var<storage, read_write> out: array<u32>;
                @compute @workgroup_size(1) fn touch() { out[0] = value; }",
            entry: "touch",
            storage: &[Access::Write],
            loops: Loops::COUNTED,
        };
        let pipeline = Pipeline::new(&gpu, &pass).unwrap();
        let mut parameters = Parameters::new(&gpu, "value", 2).unwrap();
        let out = StorageBuffer::zeroed(&gpu, "out", 4).unwrap();
        let bindings = pipeline.bind(&gpu, &parameters, &[&out]).unwrap();
        let run = |slot, workgroups| {
            let dispatch = Dispatch {
                pipeline: &pipeline,
                bindings: &bindings,
                slot,
                workgroups,
            };
            gpu.submit("touch", |recorder| recorder.run("touch", [dispatch]))
        };

        let limit = gpu.limits().max_compute_workgroups_per_dimension;
        assert_eq!(
            testing::exceeded("touch", run(0, [1, limit + 1, 1])),
            (
                "max_compute_workgroups_per_dimension",
                u64::from(limit) + 1,
                u64::from(limit)
            )
        );
        assert!(matches!(run(2, [1, 1, 1]), Err(GpuError::Validation { .. })));

        parameters.set(1, &42_u32).unwrap();
        parameters.write(&gpu).unwrap();
        run(1, [1, 1, 1]).unwrap();
        let mut readback = Readback::new(&gpu, "out", 4).unwrap();
        let mut words = [0_u32];
        gpu.submit("copy", |recorder| recorder.read_back(&out, &readback))
            .unwrap();
        readback.read(&gpu, &mut words).unwrap();
        assert_eq!(words, [42]);

        gpu.submit("clear", |recorder| {
            recorder.clear(&out);
            recorder.read_back(&out, &readback)
        })
        .unwrap();
        readback.read(&gpu, &mut words).unwrap();
        assert_eq!(words, [0]);
        let mut wide = Readback::new(&gpu, "wide", 8).unwrap();
        let beyond = gpu.submit("copy", |recorder| recorder.read_back(&out, &wide));
        assert!(
            matches!(
                beyond,
                Err(GpuError::Mismatch {
                    expected: 4,
                    found: 8,
                    ..
                })
            ),
            "{beyond:?}"
        );
        wide.read(&gpu, &mut [0_u32; 2]).unwrap();
    }
}
