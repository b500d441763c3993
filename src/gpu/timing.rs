//! GPU time of each pass and of the complete frame, by timestamps.
//!
//! On Vulkan, wgpu 30 writes both timestamps of a pass at the bottom of the pipe: the first one when the work before
//! the pass has drained, so neighbouring passes may overlap and their times need not add up to the frame's. The time of
//! the frame, from its first to its last timestamp, is suitable for comparisons; wall-clock time is the most reliable.

use serde::Serialize;

use super::{Gpu, GpuError, Readback};

/// Times [`Recorder::run_timed`](super::Recorder::run_timed) pass by pass, or
/// [`Recorder::run_timed_whole`](super::Recorder::run_timed_whole) as one.
#[derive(Debug)]
pub struct Timer {
    names: Vec<String>,
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readback: Readback,
    ticks: Vec<u64>,
    milliseconds_per_tick: f64,
}

/// Times measured by a [`Timer`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Timings {
    /// Time from the first timestamp of the frame to its last, ms.
    pub frame_ms: f64,
    /// Times of the passes in order.
    pub passes: Vec<PassTime>,
}

/// GPU time of one pass.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PassTime {
    /// Name of the pass.
    pub name: String,
    /// Time from its first timestamp to its last, ms.
    pub ms: f64,
}

impl Timer {
    /// Creates a timer for the named passes, or `None` if the device has no timestamps or there is nothing to time.
    pub fn new(gpu: &Gpu, names: &[&str]) -> Result<Option<Self>, GpuError> {
        if names.is_empty() || !gpu.has_timestamps() {
            return Ok(None);
        }
        let count = 2 * names.len() as u32;
        let bytes = u64::from(count) * u64::from(wgpu::QUERY_SIZE);
        let (queries, resolved) = gpu.scoped("making a timer", || {
            let queries = gpu.device().create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timer"),
                ty: wgpu::QueryType::Timestamp,
                count,
            });
            let resolved = gpu.device().create_buffer(&wgpu::BufferDescriptor {
                label: Some("timer"),
                size: bytes,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            });
            Ok((queries, resolved))
        })?;
        Ok(Some(Self {
            names: names.iter().map(|&name| name.to_owned()).collect(),
            queries,
            resolved,
            readback: Readback::new(gpu, "timer", bytes)?,
            ticks: vec![0; count as usize],
            milliseconds_per_tick: f64::from(gpu.queue().get_timestamp_period()) * 1e-6,
        }))
    }

    /// Waits for the submitted work and returns the times of the last submission that used this timer.
    pub fn read(&mut self, gpu: &Gpu) -> Result<Timings, GpuError> {
        self.readback.read(gpu, &mut self.ticks)?;
        let milliseconds = |from: u64, to: u64| to.saturating_sub(from) as f64 * self.milliseconds_per_tick;
        let first = self.ticks.iter().copied().min().unwrap_or(0);
        let last = self.ticks.iter().copied().max().unwrap_or(0);
        let passes = self.names.iter().zip(self.ticks.chunks_exact(2));
        Ok(Timings {
            frame_ms: milliseconds(first, last),
            passes: passes
                .map(|(name, ticks)| PassTime {
                    name: name.clone(),
                    ms: milliseconds(ticks[0], ticks[1]),
                })
                .collect(),
        })
    }

    pub(super) fn check_count(&self, dispatches: usize) -> Result<(), GpuError> {
        if dispatches == self.names.len() {
            return Ok(());
        }
        Err(GpuError::Mismatch {
            what: "timed dispatches".to_owned(),
            expected: self.names.len() as u64,
            found: dispatches as u64,
        })
    }

    /// Timestamp writes of a pass, or `None` beyond the last name.
    pub(super) fn writes(&self, index: usize) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let begin = (index < self.names.len()).then_some(2 * index as u32)?;
        Some(wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(begin),
            end_of_pass_write_index: Some(begin + 1),
        })
    }

    pub(super) fn resolve(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.resolve_query_set(&self.queries, 0..self.queries.count(), &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, self.readback.raw(), 0, self.readback.bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Access, AdapterChoice, Dispatch, Loops, Parameters, PassSource, Pipeline, StorageBuffer, adapter, testing,
    };

    const SPIN: &str = "
        const rounds = 1u;
        @group(0) @binding(1) var<storage, read_write> out: array<u32>;
        @compute @workgroup_size(64)
        fn spin(@builtin(global_invocation_id) id: vec3u) {
            var x = id.x;
            for (var i = 0u; i < rounds; i++) { x = x * 1664525u + 1013904223u; }
            out[id.x] = x;
        }";

    #[test]
    fn a_longer_pass_takes_longer_and_the_frame_holds_all() {
        let Some(gpu) = testing::open() else { return };
        let Some(mut timer) = Timer::new(&gpu, &["short", "long"]).unwrap() else {
            assert!(!gpu.report().timestamps);
            return insonify_testing::skip("the adapter does not support timestamps");
        };
        let mut whole = Timer::new(&gpu, &["whole"]).unwrap().unwrap();
        let out = StorageBuffer::zeroed(&gpu, "out", 4 * 4096).unwrap();
        let parameters = Parameters::new(&gpu, "none", 1).unwrap();
        let spin = |label, rounds| {
            let pass = PassSource {
                label,
                source: &SPIN.replace("rounds = 1u", rounds),
                entry: "spin",
                storage: &[Access::Write],
                loops: Loops::COUNTED,
            };
            let pipeline = Pipeline::new(&gpu, &pass).unwrap();
            let bindings = pipeline.bind(&gpu, &parameters, &[&out]).unwrap();
            (pipeline, bindings)
        };
        let passes = [spin("short", "rounds = 1u"), spin("long", "rounds = 60000u")];
        let dispatches: Vec<Dispatch<'_>> = passes
            .iter()
            .map(|(pipeline, bindings)| Dispatch {
                pipeline,
                bindings,
                slot: 0,
                workgroups: [64, 1, 1],
            })
            .collect();

        for _ in 0..2 {
            let start = std::time::Instant::now();
            gpu.submit("frame", |recorder| {
                recorder.run_timed(&timer, dispatches.iter().copied())
            })
            .unwrap();
            let timings = timer.read(&gpu).unwrap();
            let wall_ms = start.elapsed().as_secs_f64() * 1e3;
            let [short, long] = timings.passes.as_slice() else {
                panic!("{timings:?}")
            };
            assert_eq!((short.name.as_str(), long.name.as_str()), ("short", "long"));
            assert!(long.ms > 0.0 && long.ms > short.ms, "{timings:?}");
            assert!(
                timings.frame_ms >= long.ms && timings.frame_ms <= wall_ms,
                "{timings:?} in {wall_ms} ms"
            );

            gpu.submit("frame", |recorder| {
                recorder.run_timed_whole(&whole, dispatches.iter().copied())
            })
            .unwrap();
            let together = whole.read(&gpu).unwrap();
            assert_eq!(together.passes[0].ms, together.frame_ms);
            assert!(together.frame_ms > 0.1 * long.ms, "{together:?} against {timings:?}");
        }

        for count in [1, 3] {
            let other = dispatches.iter().copied().cycle().take(count);
            let result = gpu.submit("frame", |recorder| recorder.run_timed(&timer, other));
            assert!(
                matches!(result, Err(GpuError::Mismatch { expected: 2, .. })),
                "{count}: {result:?}"
            );
        }
    }

    #[test]
    fn without_the_feature_there_is_no_timer() {
        if testing::open().is_none() {
            return;
        }
        let adapter = adapter::pick(&AdapterChoice::from_flag(None)).unwrap();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default())).unwrap();
        let gpu = Gpu::from_host(device, queue, &Default::default()).unwrap();
        assert!(Timer::new(&gpu, &["pass"]).unwrap().is_none());
    }
}
