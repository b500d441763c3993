//! Memory bandwidth of copies, the yardstick for a matrix that is read and written once.

use std::time::Instant;

use rayon::prelude::*;

use crate::gpu::{Gpu, GpuError, StorageBuffer};

/// Bytes per copy: more than fits in caches, small beside the matrices of a study.
pub const BYTES: usize = 128 << 20;
/// Number of runs, of which the fastest counts: others were disturbed.
const RUNS: usize = 7;
/// Number of copies per submission, so that the round trip to the device has little weight.
const COPIES: usize = 8;

/// Returns the bytes read and written per second by memory copies on all threads.
pub fn of_cpu() -> f64 {
    let chunk = 1 << 20;
    let from = vec![1u8; BYTES];
    let mut to = vec![0u8; BYTES];
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        to.par_chunks_mut(chunk)
            .zip(from.par_chunks(chunk))
            .for_each(|(to, from)| to.copy_from_slice(from));
        std::hint::black_box(&mut to);
        best = best.min(start.elapsed().as_secs_f64());
    }
    2.0 * BYTES as f64 / best
}

/// Returns the bytes read and written per second by copies within a device's memory.
///
/// # Errors
/// [`GpuError`] if the device fails.
pub fn of_gpu(gpu: &Gpu) -> Result<f64, GpuError> {
    let bytes = (BYTES as u64).min(gpu.limits().max_storage_buffer_binding_size);
    let source = StorageBuffer::zeroed(gpu, "copy source", bytes)?;
    let target = StorageBuffer::zeroed(gpu, "copy target", bytes)?;
    let mut best = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        gpu.submit("copies", |recorder| {
            for _ in 0..COPIES {
                recorder
                    .encoder()
                    .copy_buffer_to_buffer(source.raw(), 0, target.raw(), 0, bytes);
            }
            Ok(())
        })?;
        gpu.wait("copies")?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(2.0 * COPIES as f64 * bytes as f64 / best)
}
