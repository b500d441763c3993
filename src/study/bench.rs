//! Benchmarks: cost of a frame on a backend, pass by pass, and its fall as effects are removed.
//!
//! Frames are timed by wall clock with pass timing off, as in a simulator. Passes are timed on separate frames, on the
//! GPU by timestamps where the device offers them. Timestamps of neighbouring passes may overlap, so pass times need
//! not add up to the frame time.
//!
//! [`compare`] compares GPU and CPU over image sizes, and measures the cost of each effect alone and combined with the
//! others.

pub mod compare;
mod report;

use std::num::NonZero;
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use insonify_base::output::folder::Folder;
use insonify_base::output::png::{self, Compression};
use insonify_base::output::queue::Queue;
use insonify_gpu::Traffic;
use insonify_imaging::effects::{Effect, LISTED};
use insonify_imaging::synth::tables::{Anatomy, Settings};
use insonify_imaging::synth::{Backend, FrameState, SynthError, Synthesizer};

pub use insonify_base::statistics::Spread;
pub use report::{BackendReport, BatchRates, BenchReport, Exchange, PassSpread, Rung};

/// Duration of a measurement.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchOptions {
    /// Frames per measurement, 1 or more.
    pub frames: usize,
    /// Frames rendered and discarded before each measurement, while caches fill, clocks rise and drivers finish
    /// compiling.
    pub warm_up: usize,
    /// Time after which a measurement ends early, provided that it has `MIN_FRAMES` frames.
    pub patience: Duration,
}

/// Minimum number of frames per measurement, unless fewer are requested.
pub(crate) const MIN_FRAMES: usize = 5;

impl Default for BenchOptions {
    fn default() -> Self {
        Self {
            frames: 100,
            warm_up: 3,
            patience: Duration::from_secs(4),
        }
    }
}

/// Measures one backend on a scene. The frames cycle through `states`, which must not be empty.
pub fn bench(
    anatomy: &Anatomy,
    settings: &Settings,
    states: &[FrameState],
    backend: &Backend,
    options: &BenchOptions,
) -> Result<BackendReport, SynthError> {
    let mut synth = Synthesizer::new(anatomy.clone(), settings.clone(), backend.clone())?;
    let clock = Clock { states, options };
    let frame = clock.wall(&mut synth, |synth, state| synth.render(state).map(drop))?;
    // A first frame tells whether this backend can leave frames on its GPU.
    let frame_left_on_gpu = match synth.gpu().cloned() {
        Some(gpu) if synth.render_to_texture(&states[0]).is_ok() => Some(clock.wall(&mut synth, |synth, state| {
            synth.render_to_texture(state)?;
            Ok(gpu.wait("the end of a frame")?)
        })?),
        _ => None,
    };
    let exchange = clock.exchange(&mut synth)?;
    let memory_bytes = synth.memory_bytes();
    let (passes, gpu_time) = clock.passes(&mut synth)?;
    let batch = clock.batches(&mut synth, frame)?;
    Ok(BackendReport {
        backend: synth.backend(),
        adapter: synth.gpu().map(|gpu| gpu.report().name.clone()),
        software: synth.gpu().is_some_and(|gpu| gpu.report().software),
        frame,
        frame_left_on_gpu,
        gpu_time,
        exchange,
        passes,
        batch,
        memory_bytes,
        ladder: clock.ladder(anatomy.clone(), synth, backend, frame)?,
    })
}

struct Clock<'a> {
    states: &'a [FrameState],
    options: &'a BenchOptions,
}

impl Clock<'_> {
    /// Calls `work` for one frame after another and returns its results, those of warm-up frames excluded.
    fn repeat<T>(&self, mut work: impl FnMut(&FrameState) -> Result<T, SynthError>) -> Result<Vec<T>, SynthError> {
        let mut states = self.states.iter().cycle();
        for state in states.by_ref().take(self.options.warm_up) {
            work(state)?;
        }
        let start = Instant::now();
        let mut results = Vec::with_capacity(self.options.frames);
        for state in states.take(self.options.frames.max(1)) {
            results.push(work(state)?);
            if results.len() >= MIN_FRAMES && start.elapsed() > self.options.patience {
                break;
            }
        }
        Ok(results)
    }

    fn wall(
        &self,
        synth: &mut Synthesizer,
        work: impl Fn(&mut Synthesizer, &FrameState) -> Result<(), SynthError>,
    ) -> Result<Spread, SynthError> {
        let times = self.repeat(|state| {
            let start = Instant::now();
            work(synth, state)?;
            Ok(start.elapsed().as_secs_f64() * 1e3)
        })?;
        // `repeat` measures one frame or more.
        Ok(Spread::of(times).unwrap_or(Spread {
            median_ms: 0.0,
            p95_ms: 0.0,
            fps: 0.0,
            frames: 0,
        }))
    }

    fn exchange(&self, synth: &mut Synthesizer) -> Result<Option<Exchange>, SynthError> {
        let Some(gpu) = synth.gpu().cloned() else {
            return Ok(None);
        };
        let frames = self.repeat(|state| {
            let (before, start) = (gpu.traffic(), Instant::now());
            let ticket = synth.submit(state)?;
            let ms = start.elapsed().as_secs_f64() * 1e3;
            synth.take(ticket)?;
            Ok((ms, gpu.traffic() - before))
        })?;
        let mean = |field: fn(&Traffic) -> u64| {
            let sum: u64 = frames.iter().map(|(_, traffic)| field(traffic)).sum();
            sum as f64 / frames.len() as f64
        };
        let before_submission = Spread::of(frames.iter().map(|(ms, _)| *ms).collect());
        Ok(before_submission.map(|before_submission| Exchange {
            before_submission,
            dispatches: synth.plan().report(&Default::default()).dispatches.len(),
            uploads: mean(|traffic| traffic.uploads),
            submissions: mean(|traffic| traffic.submissions),
            waits: mean(|traffic| traffic.waits),
            up_kb: mean(|traffic| traffic.bytes_up) * 1e-3,
            down_kb: mean(|traffic| traffic.bytes_down) * 1e-3,
        }))
    }

    fn passes(&self, synth: &mut Synthesizer) -> Result<(Vec<PassSpread>, Option<Spread>), SynthError> {
        synth.time_passes(true)?;
        let frames = self.repeat(|state| {
            synth.render(state)?;
            Ok((synth.pass_times().to_vec(), synth.gpu_frame_ms()))
        })?;
        synth.time_passes(false)?;
        let names = frames.first().map_or(&[][..], |(passes, _)| passes.as_slice());
        let spread = |index: usize, name: &'static str| {
            let times = frames.iter().filter_map(|(passes, _)| passes.get(index));
            let time = Spread::of(times.map(|pass| pass.ms).collect())?;
            Some(PassSpread { name, time })
        };
        let passes = names.iter().enumerate();
        Ok((
            passes.filter_map(|(index, pass)| spread(index, pass.name)).collect(),
            Spread::of(frames.iter().filter_map(|&(_, frame_ms)| frame_ms).collect()),
        ))
    }

    /// Frames a second of batches, whose first frames are not counted, in memory and as a folder of PNG files.
    fn batches(&self, synth: &mut Synthesizer, frame: Spread) -> Result<BatchRates, SynthError> {
        let affordable = (self.options.patience.as_secs_f64() * frame.fps) as usize;
        let count = self.options.frames.min(affordable).max(MIN_FRAMES);
        let states: Vec<FrameState> = self.states.iter().cycle().take(count).cloned().collect();
        let rate = |start: Instant| count as f64 / start.elapsed().as_secs_f64();
        // Starts the threads.
        synth.render_batch(&states[..MIN_FRAMES], |_, _| Ok::<_, SynthError>(()))?;
        let start = Instant::now();
        synth.render_batch(&states, |_, _| Ok::<_, SynthError>(()))?;
        let fps = rate(start);
        let scratch = tempfile::tempdir().ok().and_then(|directory| {
            let folder = Folder::open(directory.path(), "bench", &[], &[], false).ok()?;
            Some((directory, folder))
        });
        let Some((_directory, folder)) = scratch else {
            return Ok(BatchRates { fps, png_fps: None });
        };
        let writers = Queue::new(available_parallelism().map_or(1, NonZero::get));
        let mut png_result = Ok(());
        let start = Instant::now();
        synth.render_batch(&states, |index, frame| {
            let path = png::frame_path(folder.path(), index, count);
            let (size, pixels) = ([frame.width, frame.height], frame.pixels.clone());
            let job = move || png::write_grey_with(Compression::Fast, &path, size, &pixels);
            if png_result.is_ok() {
                png_result = writers.put(Box::new(job));
            }
            Ok::<_, SynthError>(())
        })?;
        let png_result = png_result.and_then(|()| writers.finish());
        Ok(BatchRates {
            fps,
            png_fps: png_result.is_ok().then(|| rate(start)),
        })
    }

    fn ladder(
        &self,
        mut anatomy: Anatomy,
        mut synth: Synthesizer,
        backend: &Backend,
        full: Spread,
    ) -> Result<Vec<Rung>, SynthError> {
        let mut rungs = vec![Rung {
            without: None,
            passes: synth.plan().passes.len(),
            time: full,
        }];
        let at_rest = |state: &FrameState| FrameState {
            nodes: None,
            reference: None,
            ..state.clone()
        };
        let at_rest: Vec<FrameState> = self.states.iter().map(at_rest).collect();
        let mut states = self.states;
        for (effect, remove) in removable() {
            let mut settings = synth.settings().clone();
            let had_mesh = anatomy.mesh.is_some();
            remove(&mut anatomy, &mut settings);
            let mesh_removed = had_mesh && anatomy.mesh.is_none();
            if !synth.plan().has(effect.name) || (!mesh_removed && settings == *synth.settings()) {
                continue;
            }
            if mesh_removed {
                // The mesh is fixed on creation; states of its nodes go with it.
                states = &at_rest;
                drop(synth);
                synth = Synthesizer::new(anatomy.clone(), settings, backend.clone())?;
            } else {
                synth.set(settings)?;
            }
            let clock = Clock {
                states,
                options: self.options,
            };
            let time = clock.wall(&mut synth, |synth, state| synth.render(state).map(drop))?;
            rungs.push(Rung {
                without: Some(effect.name),
                passes: synth.plan().passes.len(),
                time,
            });
        }
        Ok(rungs)
    }
}

/// Effects that can be taken out of a scene, and what takes them, in the order of removal: from the last of the list to
/// the first.
fn removable() -> impl Iterator<Item = (&'static Effect, fn(&mut Anatomy, &mut Settings))> {
    let listed = LISTED.iter().copied().rev();
    listed.filter_map(|effect| Some((effect, effect.remove?)))
}

#[cfg(test)]
mod tests;
