//! Times of passes, and of transfers to and from a GPU.

use super::{
    CPU_MS, Clock, CompareOptions, Compared, Factor, GPU, GPU_MS, RATIO, Subject, WHAT, choices, clock_options,
};
use crate::bench::PassSpread;
use crate::tradeoff::{Axis, Choice, Column, Table};
use insonify::Error;
use insonify_base::statistics::Spread;
use insonify_gpu::{Gpu, GpuError, Readback, StorageBuffer};
use insonify_imaging::effects::REGISTRY;
use insonify_imaging::effects::buffers::PIXELS;
use insonify_imaging::plan::Plan;
use insonify_imaging::synth::slab::Slab;
use insonify_imaging::synth::tables::Tables;
use insonify_imaging::synth::{Backend, SynthError, Synthesizer};

const GRID: Factor = Factor::new("grid", "grid");

/// In place of the stage of a pass: the frame as a whole.
pub(super) const FRAME: &str = "frame";

/// Name of the stage of a frame in which a pass runs.
fn stage(plan: &Plan, pass: &str) -> &'static str {
    let planned = plan.passes.iter().find(|planned| planned.pass.name == pass);
    let effect = planned.and_then(|planned| REGISTRY.iter().find(|effect| effect.name == planned.effect));
    effect.map_or(FRAME, |effect| effect.stage.name())
}

/// A frame or a pass: its name, its stage and its median time, ms.
type Timed = (String, &'static str, f64);

/// Times of one backend at one size.
type Times = Vec<Timed>;

pub(crate) const WHOLE: &str = "frame, pixels on the CPU";
pub(super) const LEFT: &str = "frame, pixels left on the GPU";

/// Times frames and every pass of a backend at one size.
fn at_size(subject: &Subject<'_>, options: &CompareOptions, grid: [u32; 2], backend: Backend) -> Result<Times, Error> {
    let mut synth = Synthesizer::new(subject.anatomy.clone(), subject.sized(grid), backend)?;
    let timing = clock_options(&mut synth, subject.state, options.patience)?;
    let states = std::slice::from_ref(subject.state);
    let clock = Clock {
        states,
        options: &timing,
    };
    let frame = clock.wall(&mut synth, |synth, state| synth.render(state).map(drop))?;
    let mut times: Times = vec![(WHOLE.to_owned(), FRAME, frame.median_ms)];
    if let Some(gpu) = synth.gpu().cloned()
        && synth.render_to_texture(subject.state).is_ok()
    {
        let left = clock.wall(&mut synth, |synth, state| {
            synth.render_to_texture(state)?;
            Ok(gpu.wait("the end of a frame")?)
        })?;
        times.push((LEFT.to_owned(), FRAME, left.median_ms));
    }
    let (passes, _) = clock.passes(&mut synth)?;
    let timed = |pass: PassSpread| {
        (
            pass.name.to_owned(),
            stage(synth.plan(), pass.name),
            pass.time.median_ms,
        )
    };
    times.extend(passes.into_iter().map(timed));
    Ok(times)
}

/// Measures the sizes in ascending order; `None` for those after a frame that took too long or did not fit on the
/// device.
fn all_sizes(
    subject: &Subject<'_>,
    options: &CompareOptions,
    name: &str,
    backend: impl Fn() -> Backend,
    notes: &mut Vec<String>,
) -> Result<Vec<Option<Times>>, Error> {
    let mut sizes: Vec<Option<Times>> = Vec::new();
    let mut stopped = false;
    for &grid in &options.grids {
        if stopped {
            sizes.push(None);
            continue;
        }
        match at_size(subject, options, grid, backend()) {
            Ok(times) => {
                stopped = times.first().is_some_and(|(_, _, ms)| *ms > options.most_ms);
                if stopped && grid != options.grids[options.grids.len() - 1] {
                    notes.push(format!(
                        "{name}: a frame of {} x {} took over {} ms; larger ones were not measured",
                        grid[0], grid[1], options.most_ms
                    ));
                }
                sizes.push(Some(times));
            }
            Err(error) if matches!(error.downcast_ref(), Some(SynthError::Gpu(_))) => {
                notes.push(format!("{name}: no frame of {} x {}: {error}", grid[0], grid[1]));
                (stopped, _) = (true, sizes.push(None));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(sizes)
}

/// Columns of a frame or a pass beside its times.
pub(super) struct Frame {
    stage: &'static str,
    samples: f64,
}

const PASSES: [Column<Compared<Frame>>; 4] = [
    Axis::log("samples", "samples", "samples of a frame").of(|row| Some(row.beside.samples)),
    CPU_MS.of(|row| row.cpu_ms),
    GPU_MS.of(|row| row.gpu_ms),
    RATIO.of(Compared::ratio),
];

/// Tabulates frames and passes.
pub(super) fn table(rows: &[Compared<Frame>]) -> Table {
    let [gpu, what, grid] = choices(GRID);
    let stage = Factor::new("stage", "stage").of(|row: &Compared<Frame>| row.beside.stage.to_owned());
    let title = "Frames (wall clock) and passes (timestamps of the GPU), CPU in single precision";
    Table::of("compare_passes", title, &[gpu, what, grid, stage], &PASSES, rows)
}

/// Measures all sizes: each GPU beside the CPU, or only the CPU if there is no GPU.
pub(super) fn passes(
    subject: &Subject<'_>,
    options: &CompareOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<Compared<Frame>>, Error> {
    let cpu = all_sizes(subject, options, "the CPU", || Backend::Cpu, notes)?;
    let mut gpus: Vec<(String, Vec<Option<Times>>)> = Vec::new();
    for gpu in &options.gpus {
        let name = gpu.report().name.clone();
        let sizes = all_sizes(subject, options, &name, || Backend::Gpu(Box::new(gpu.clone())), notes)?;
        gpus.push((name, sizes));
    }
    if gpus.is_empty() {
        gpus.push(("none".to_owned(), vec![None; options.grids.len()]));
    }
    let find = |times: &Option<Times>, what: &str| {
        let times = times.as_ref()?;
        times.iter().find(|(name, ..)| name == what).map(|(_, _, ms)| *ms)
    };
    let mut rows = Vec::new();
    for (name, sizes) in &gpus {
        let seen = cpu.iter().chain(sizes).flatten();
        let longest = seen.max_by_key(|times| times.len());
        for (what, stage, _) in longest.cloned().unwrap_or_default() {
            for ((grid, on_cpu), on_gpu) in options.grids.iter().zip(&cpu).zip(sizes) {
                // A frame that stays on the GPU is compared with a finished frame on the CPU.
                let (cpu_ms, gpu_ms) = (
                    find(on_cpu, if what == LEFT { WHOLE } else { &what }),
                    find(on_gpu, &what),
                );
                if cpu_ms.is_none() && gpu_ms.is_none() {
                    continue;
                }
                let samples = f64::from(grid[0]) * f64::from(grid[1]);
                rows.push(Compared {
                    gpu: name.clone(),
                    what: what.clone(),
                    size: format!("{} x {}", grid[0], grid[1]),
                    cpu_ms,
                    gpu_ms,
                    beside: Frame { stage, samples },
                });
            }
        }
    }
    Ok(rows)
}

/// Number of repetitions of each transfer.
const TIMES: usize = 7;

/// Bytes sent for a frame in which the mesh moves and the probe does not: the maps of the deformed elements in the
/// slab.
fn moved_mesh(subject: &Subject<'_>, tables: &Tables) -> Result<u64, Error> {
    let Some(mesh) = &tables.mesh else { return Ok(0) };
    let mut slab = Slab::<f32>::new(mesh);
    slab.update(tables, subject.state).map_err(SynthError::from)?;
    let maps = [
        size_of_val(&slab.deformed.frames[..]),
        size_of_val(&slab.deformed.carries[..]),
    ];
    Ok(maps.iter().sum::<usize>() as u64)
}

/// A transfer to or from a GPU.
struct Transferred {
    gpu: String,
    what: &'static str,
    grid: String,
    megabytes: f64,
    ms: Option<f64>,
}

const TRANSFER_CHOICES: [Choice<Transferred>; 3] = [
    GPU.of(|row| row.gpu.clone()),
    WHAT.of(|row| row.what.to_owned()),
    GRID.of(|row| row.grid.clone()),
];

const TRANSFER_COLUMNS: [Column<Transferred>; 3] = [
    Axis::log("megabytes", "MB", "bytes moved, MB").of(|row| Some(row.megabytes)),
    GPU_MS.of(|row| row.ms),
    Axis::log("gb_s", "GB/s", "bytes moved a second, GB/s").of(|row| Some(row.megabytes / row.ms?.max(1e-6))),
];

pub(super) fn transfers(subject: &Subject<'_>, options: &CompareOptions) -> Result<Option<Table>, Error> {
    if options.gpus.is_empty() {
        return Ok(None);
    }
    let mut rows = Vec::new();
    for gpu in &options.gpus {
        for (index, &grid) in options.grids.iter().enumerate() {
            let tables = Tables::new(subject.anatomy.clone(), subject.sized(grid))?;
            let plan = Plan::new(&tables);
            let limit = gpu.limits().max_storage_buffer_binding_size;
            let mut moves: Vec<(&'static str, u64, Transfer)> = Vec::new();
            // Neither the mesh nor the parameters depend on the grid of samples: one size is enough.
            if index == 0 && plan.has("warp") {
                moves.push(("up: the moved mesh", moved_mesh(subject, &tables)?, upload));
            }
            if index == 0 {
                moves.push(("up: parameters", 256 * plan.passes.len() as u64, upload));
            }
            moves.push(("back: pixels", PIXELS.bytes(&tables), read_back));
            for (what, bytes, transfer) in moves {
                if bytes == 0 || bytes > limit {
                    continue;
                }
                rows.push(Transferred {
                    gpu: gpu.report().name.clone(),
                    what,
                    grid: match what {
                        "back: pixels" => format!("{} x {}", grid[0], grid[1]),
                        _ => "any".to_owned(),
                    },
                    megabytes: bytes as f64 * 1e-6,
                    ms: transfer(gpu, bytes)?,
                });
            }
        }
    }
    let title = "Transfers of a frame, apart from what is computed (wall clock, waited for)";
    let table = Table::of("compare_transfers", title, &TRANSFER_CHOICES, &TRANSFER_COLUMNS, &rows);
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
    Ok(Spread::of_runs(TIMES, work)?.map(|spread| spread.median_ms))
}
