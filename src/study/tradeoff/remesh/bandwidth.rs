//! How fast memory is copied: what a matrix that is read and written once can be compared with.

use std::time::Instant;

use rayon::prelude::*;

use crate::gpu::{Gpu, GpuError, StorageBuffer};

/// Bytes that are copied at once: more than caches hold, little beside the matrices of a study.
pub const BYTES: usize = 128 << 20;
/// The best of so many runs counts: others were disturbed.
const RUNS: usize = 7;
/// Copies in one submission, so that the way to the device and back weighs little.
const COPIES: usize = 8;

/// Bytes read and written a second when this machine copies memory on all threads.
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

/// Bytes read and written a second when a device copies its own memory.
///
/// # Errors
/// [`GpuError`].
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
