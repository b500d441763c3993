//! Read-back from the GPU to the CPU through one persistent staging buffer.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, Ordering};

use bytemuck::Pod;

use super::buffer::whole_words;
use super::faults::check_limit;
use super::{Gpu, GpuError};

const WAITING: u8 = 0;
const MAPPED: u8 = 1;
const FAILED: u8 = 2;

/// A staging buffer: [`Recorder::read_back`](super::Recorder::read_back) fills it, [`Readback::read`] empties it.
#[derive(Debug)]
pub struct Readback {
    label: String,
    staging: wgpu::Buffer,
    state: Arc<AtomicU8>,
}

impl Readback {
    /// Creates a staging buffer of `bytes`, rounded up to complete 32-bit words.
    pub fn new(gpu: &Gpu, label: &str, bytes: u64) -> Result<Self, GpuError> {
        check_limit(
            || format!("read-back of '{label}'"),
            "max_buffer_size",
            bytes,
            gpu.limits().max_buffer_size,
        )?;
        let descriptor = wgpu::BufferDescriptor {
            label: Some(label),
            size: whole_words(bytes.max(1)),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        };
        let staging = gpu.scoped(&format!("making the read-back of '{label}'"), || {
            Ok(gpu.device().create_buffer(&descriptor))
        })?;
        Ok(Self {
            label: label.to_owned(),
            staging,
            state: Arc::new(AtomicU8::new(WAITING)),
        })
    }

    /// Size, bytes, a multiple of 4.
    pub fn bytes(&self) -> u64 {
        self.staging.size()
    }

    /// Underlying staging buffer.
    pub fn raw(&self) -> &wgpu::Buffer {
        &self.staging
    }

    /// Waits for the submitted work, and fills `out` with the first bytes copied.
    pub fn read<T: Pod>(&mut self, gpu: &Gpu, out: &mut [T]) -> Result<(), GpuError> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(out);
        let length = bytes.len();
        self.read_rows(gpu, bytes, length, length)
    }

    /// Reads as [`Readback::read`] does, and waits for no work after `submission`, which has the copy.
    pub fn read_after<T: Pod>(
        &mut self,
        gpu: &Gpu,
        submission: wgpu::SubmissionIndex,
        out: &mut [T],
    ) -> Result<(), GpuError> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(out);
        let length = bytes.len();
        self.read_waiting(gpu, Some(submission), bytes, length, length)
    }

    /// Reads as [`Readback::read`] does, from rows of `row_bytes` that start `stride` bytes apart, into `out`
    /// without gaps.
    pub fn read_rows(&mut self, gpu: &Gpu, out: &mut [u8], row_bytes: usize, stride: usize) -> Result<(), GpuError> {
        self.read_waiting(gpu, None, out, row_bytes, stride)
    }

    fn read_waiting(
        &mut self,
        gpu: &Gpu,
        submission: Option<wgpu::SubmissionIndex>,
        out: &mut [u8],
        row_bytes: usize,
        stride: usize,
    ) -> Result<(), GpuError> {
        if out.is_empty() {
            return gpu.check();
        }
        self.check_rows(0, out.len(), row_bytes, stride)?;
        gpu.scoped(&self.label, || {
            self.request();
            let waited = gpu.wait_for(&self.label, submission);
            let copied = waited.and_then(|()| self.copy_rows(0, out, row_bytes, stride));
            self.release(gpu);
            copied
        })
    }

    /// Asks for the bytes of a submitted copy; [`Readback::is_ready`] tells when they have come.
    pub fn request(&self) {
        self.state.store(WAITING, Ordering::Release);
        let state = Arc::clone(&self.state);
        self.staging.map_async(wgpu::MapMode::Read, .., move |result| {
            state.store(if result.is_ok() { MAPPED } else { FAILED }, Ordering::Release);
        });
    }

    /// Whether the bytes asked for have come, or have been refused.
    pub fn is_ready(&self) -> bool {
        self.state.load(Ordering::Acquire) != WAITING
    }

    /// Copies rows, as [`Readback::read_rows`] does, of bytes that have come, from a multiple of 8 bytes on.
    pub fn copy_rows(&self, start: usize, out: &mut [u8], row_bytes: usize, stride: usize) -> Result<(), GpuError> {
        let rows = self.check_rows(start, out.len(), row_bytes, stride)?;
        if self.state.load(Ordering::Acquire) != MAPPED {
            return Err(GpuError::Lost {
                reason: format!("the read-back of '{}' was refused", self.label),
            });
        }
        let span = whole_words(((rows - 1) * stride + row_bytes) as u64);
        let view = self
            .staging
            .get_mapped_range(start as u64..start as u64 + span)
            .map_err(|error| GpuError::Internal {
                what: self.label.clone(),
                message: error.to_string(),
            })?;
        for (to, from) in out.chunks_exact_mut(row_bytes).zip(view.chunks(stride)) {
            to.copy_from_slice(&from[..row_bytes]);
        }
        Ok(())
    }

    /// Frees the buffer for the next copy; bytes that have been asked for and have not come are given up.
    pub fn release(&self, gpu: &Gpu) {
        // A refused mapping must also be undone, though there is nothing to unmap: that error is irrelevant.
        let ignored = gpu.device().push_error_scope(wgpu::ErrorFilter::Validation);
        self.staging.unmap();
        drop(ignored);
    }

    fn check_rows(&self, start: usize, total: usize, row_bytes: usize, stride: usize) -> Result<usize, GpuError> {
        let mismatch = |what: &str, expected: usize, found: usize| GpuError::Mismatch {
            what: format!("{what} of the read-back of '{}'", self.label),
            expected: expected as u64,
            found: found as u64,
        };
        let rows = total.checked_div(row_bytes).unwrap_or(0);
        if rows == 0 || rows * row_bytes != total {
            return Err(mismatch(
                "bytes (whole rows)",
                (rows + 1).saturating_mul(row_bytes),
                total,
            ));
        }
        if stride < row_bytes {
            return Err(mismatch("stride", row_bytes, stride));
        }
        let span = start
            .saturating_add((rows - 1).saturating_mul(stride))
            .saturating_add(row_bytes);
        if whole_words(span as u64) > self.bytes() {
            return Err(mismatch("bytes (at most)", self.bytes() as usize, span));
        }
        Ok(rows)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::{Access, Dispatch, Loops, Parameters, PassSource, Pipeline, StorageBuffer, testing};

    fn filled(gpu: &Gpu, bytes: usize) -> Readback {
        let data: Vec<u8> = (0..bytes).map(|i| i as u8).collect();
        let buffer = StorageBuffer::upload(gpu, "rows", &data).unwrap();
        let readback = Readback::new(gpu, "rows", buffer.bytes()).unwrap();
        gpu.submit("copy", |recorder| recorder.read_back(&buffer, &readback))
            .unwrap();
        readback
    }

    #[test]
    fn rows_come_back_without_their_padding() {
        let Some(gpu) = testing::open() else { return };
        let mut readback = filled(&gpu, 24);
        let mut rows = [0; 9];
        readback.read_rows(&gpu, &mut rows, 3, 8).unwrap();
        assert_eq!(rows, [0, 1, 2, 8, 9, 10, 16, 17, 18]);
    }

    #[test]
    fn the_same_staging_buffer_serves_again_and_again() {
        let Some(gpu) = testing::open() else { return };
        let buffer = StorageBuffer::zeroed(&gpu, "counter", 4).unwrap();
        let mut readback = Readback::new(&gpu, "counter", 4).unwrap();
        for expected in 0..20_u32 {
            buffer.write(&gpu, 0, &[expected]).unwrap();
            gpu.submit("copy", |recorder| recorder.read_back(&buffer, &readback))
                .unwrap();
            let mut value = [u32::MAX];
            readback.read(&gpu, &mut value).unwrap();
            assert_eq!(value, [expected]);
        }
    }

    #[test]
    fn a_wait_too_long_is_a_timeout_after_which_reading_works_again() {
        let Some(gpu) = testing::open() else { return };
        let pass = PassSource {
            label: "spin",
            source: "@group(0) @binding(1) var<storage, read_write> out: array<u32>;
                @compute @workgroup_size(1) fn spin() {
                    var x = out[0];
                    for (var i = 0u; i < 60000u; i++) { x = (x ^ (x >> 7u)) * 1664525u + 1013904223u; }
                    out[0] = x | 1u;
                }",
            entry: "spin",
            storage: &[Access::Write],
            loops: Loops::COUNTED,
        };
        let pipeline = Pipeline::new(&gpu, &pass).unwrap();
        let parameters = Parameters::new(&gpu, "none", 1).unwrap();
        let out = StorageBuffer::zeroed(&gpu, "out", 4).unwrap();
        let bindings = pipeline.bind(&gpu, &parameters, &[&out]).unwrap();
        let mut readback = Readback::new(&gpu, "out", 4).unwrap();
        gpu.submit("spin", |recorder| {
            let dispatch = Dispatch {
                pipeline: &pipeline,
                bindings: &bindings,
                slot: 0,
                workgroups: [1, 1, 1],
            };
            recorder.run("spin", [dispatch; 400])?;
            recorder.read_back(&out, &readback)
        })
        .unwrap();

        let mut value = [0_u32];
        let mut hasty = gpu.clone();
        hasty.set_wait_timeout(Duration::ZERO);
        let result = readback.read(&hasty, &mut value);
        assert!(matches!(result, Err(GpuError::Timeout { .. })), "{result:?}");
        readback.read(&gpu, &mut value).unwrap();
        assert_eq!(value[0] & 1, 1);
    }

    #[test]
    fn sizes_that_do_not_fit_are_errors() {
        let Some(gpu) = testing::open() else { return };
        let mut readback = filled(&gpu, 8);
        let mismatch = |result| assert!(matches!(result, Err(GpuError::Mismatch { .. })), "{result:?}");
        mismatch(readback.read(&gpu, &mut [0_u32; 3]));
        mismatch(readback.read_rows(&gpu, &mut [0; 5], 2, 4));
        mismatch(readback.read_rows(&gpu, &mut [0; 4], 0, 4));
        mismatch(readback.read_rows(&gpu, &mut [0; 4], 4, 2));
        mismatch(readback.read_rows(&gpu, &mut [0; 4], 2, usize::MAX));
        assert_eq!(readback.read(&gpu, &mut [0_u32; 0]), Ok(()));
        let mut all = [0_u8; 8];
        readback.read(&gpu, &mut all).unwrap();
        assert_eq!(all, [0, 1, 2, 3, 4, 5, 6, 7]);
        let limit = gpu.limits().max_buffer_size;
        let huge = Readback::new(&gpu, "huge", limit + 1);
        assert_eq!(testing::exceeded("huge", huge), ("max_buffer_size", limit + 1, limit));
    }
}
