//! Times of transfers to and from a device.

use std::time::Instant;

use super::{CompareError, CompareOptions, GPU_MS, Subject, factor};
use crate::base::report::statistics::Spread;
use crate::gpu::{Gpu, GpuError, Readback, StorageBuffer};
use crate::imaging::effects::buffers::{Buffer, CELL_ELEMENTS, CELL_STARTS, ELEMENT_MAPS, PIXELS};
use crate::imaging::plan::Plan;
use crate::imaging::synth::tables::Tables;
use crate::study::tradeoff::{Axis, Table};

/// Number of repetitions of each transfer.
const TIMES: usize = 7;

/// Data sent for a frame with a moving mesh: the element maps and the search grid.
const MOVED: [&Buffer; 3] = [&ELEMENT_MAPS, &CELL_STARTS, &CELL_ELEMENTS];

pub fn transfers(subject: &Subject<'_>, options: &CompareOptions) -> Result<Option<Table>, CompareError> {
    if options.gpus.is_empty() {
        return Ok(None);
    }
    let factors = [factor("gpu", "GPU"), factor("what", "what"), factor("grid", "grid")];
    let axes = [
        Axis::log("megabytes", "MB", "bytes moved, MB"),
        GPU_MS,
        Axis::log("gb_s", "GB/s", "bytes moved a second, GB/s"),
    ];
    let title = "Transfers of a frame, apart from what is computed (wall clock, waited for)";
    let mut table = Table::new("compare_transfers", title, &factors, &axes);
    for gpu in &options.gpus {
        for (at, &grid) in options.grids.iter().enumerate() {
            let tables = Tables::new(subject.anatomy.clone(), subject.sized(grid))?;
            let plan = Plan::new(&tables);
            let limit = gpu.limits().max_storage_buffer_binding_size;
            let mut moves: Vec<(&str, u64, Transfer)> = Vec::new();
            // The mesh is independent of the image grid.
            if at == 0 && plan.has("warp") {
                let bytes = MOVED.iter().map(|buffer| buffer.bytes(&tables)).sum();
                moves.push(("up: the moved mesh", bytes, upload));
            }
            if at == 0 {
                moves.push(("up: parameters", 256 * plan.passes.len() as u64, upload));
            }
            moves.push(("back: pixels", PIXELS.bytes(&tables), read_back));
            for (what, bytes, transfer) in moves {
                if bytes == 0 || bytes > limit {
                    continue;
                }
                let ms = transfer(gpu, bytes)?;
                let megabytes = bytes as f64 * 1e-6;
                let name = match what {
                    "back: pixels" => format!("{} x {}", grid[0], grid[1]),
                    _ => "any".to_owned(),
                };
                table.push(
                    vec![gpu.report().name.clone(), what.to_owned(), name],
                    vec![Some(megabytes), ms, ms.map(|ms| megabytes / ms.max(1e-6))],
                    None,
                );
            }
        }
    }
    Ok(Some(table))
}

/// Returns the median time to transfer a number of bytes, ms.
type Transfer = fn(&Gpu, u64) -> Result<Option<f64>, GpuError>;

fn upload(gpu: &Gpu, bytes: u64) -> Result<Option<f64>, GpuError> {
    let buffer = StorageBuffer::zeroed(gpu, "upload", bytes)?;
    let data = vec![1u32; bytes.div_ceil(4) as usize];
    timed(|| {
        buffer.write(gpu, 0, &data)?;
        // Writes are sent with the next submission.
        gpu.submit("upload", |_| Ok(()))?;
        gpu.wait("an upload")
    })
}

fn read_back(gpu: &Gpu, bytes: u64) -> Result<Option<f64>, GpuError> {
    let buffer = StorageBuffer::zeroed(gpu, "pixels", bytes)?;
    let mut readback = Readback::new(gpu, "pixels", bytes)?;
    let mut data = vec![0u32; bytes.div_ceil(4) as usize];
    timed(|| {
        gpu.submit("read back", |recorder| recorder.read_back(&buffer, &readback))?;
        readback.read(gpu, &mut data)
    })
}

fn timed(mut work: impl FnMut() -> Result<(), GpuError>) -> Result<Option<f64>, GpuError> {
    work()?;
    let mut times = Vec::with_capacity(TIMES);
    for _ in 0..TIMES {
        let start = Instant::now();
        work()?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(Spread::of(times).map(|spread| spread.median_ms))
}
