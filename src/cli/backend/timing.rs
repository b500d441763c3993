//! Times of a frame on a GPU and on the CPU, by which `auto` chooses, kept in the user's cache.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use insonify_base::cache::program;
use insonify_base::number::milliseconds;
use insonify_base::output::OutputError;
use insonify_base::statistics::median;
use insonify_gpu::adapter::AdapterReport;
use insonify_imaging::plan::Plan;
use insonify_imaging::quality::cache::Cache;
use insonify_imaging::synth::tables::Tables;
use insonify_imaging::synth::{FrameState, SynthError, Synthesizer};

/// Largest number of frames of which the median is taken.
const FRAMES: usize = 5;
/// Time after which no further frame is begun on a device, ms.
const PATIENCE_MS: f64 = 100.0;
/// Ratio of the frame time on the GPU to that on the CPU up to which the GPU is taken.
const TIE: f64 = 1.1;
/// Largest number of scenes whose times are kept for an adapter.
const MAX_KEPT: usize = 200;

/// Median times of a frame of a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FrameTimes {
    /// Sizes of the scene, for people.
    pub scene: String,
    /// Hash of what decides the times: the passes and the sizes of their buffers.
    key: String,
    /// Time on the GPU, ms.
    pub gpu_ms: f64,
    /// Time on the CPU in single precision, ms.
    pub cpu_ms: f64,
}

impl FrameTimes {
    /// Whether the GPU is taken.
    pub(crate) fn is_gpu(&self) -> bool {
        self.gpu_ms <= TIE * self.cpu_ms
    }

    /// The times, that of the device taken first.
    pub(crate) fn text(&self, adapter: &str) -> String {
        let [gpu, cpu] = [self.gpu_ms, self.cpu_ms].map(milliseconds);
        let near = if self.gpu_ms > self.cpu_ms { ", within 10 %" } else { "" };
        if self.is_gpu() {
            format!("{gpu} ms a frame, the CPU {cpu} ms{near}")
        } else {
            format!("{cpu} ms a frame, {adapter} {gpu} ms")
        }
    }

    /// Times frames of a state. A mesh moves in each of them.
    pub(crate) fn measure(
        gpu: &mut Synthesizer,
        cpu: &mut Synthesizer,
        state: &FrameState,
    ) -> Result<Self, SynthError> {
        let (scene, key) = described(gpu.tables(), gpu.plan());
        let mut state = state.clone();
        if let (None, Some(mesh)) = (&state.nodes, &gpu.tables().anatomy.mesh) {
            state.nodes = Some(mesh.nodes().to_vec());
        }
        let timed = |synth: &mut Synthesizer| {
            let start = Instant::now();
            synth.render(&state)?;
            Ok::<_, SynthError>(start.elapsed().as_secs_f64() * 1e3)
        };
        // Drivers compile at the first frame.
        timed(gpu)?;
        Ok(Self {
            scene,
            key,
            gpu_ms: median_ms(|| timed(gpu))?,
            cpu_ms: median_ms(|| timed(cpu))?,
        })
    }
}

/// Median of the times (ms) of up to five frames, and of none that begins after 100 ms. The first one warms up: it
/// counts only where it takes as long alone.
fn median_ms<E>(mut frame: impl FnMut() -> Result<f64, E>) -> Result<f64, E> {
    let (mut times, mut sum) = (Vec::new(), 0.0);
    while times.len() <= FRAMES && sum < PATIENCE_MS {
        times.push(frame()?);
        sum += times[times.len() - 1];
    }
    let counted = times.split_off(usize::from(times.len() > 1));
    Ok(median(counted).unwrap_or(f64::INFINITY))
}

/// Sizes of a scene for people, and a hash of what decides its times.
fn described(tables: &Tables, plan: &Plan) -> (String, String) {
    let scene = format!(
        "{} x {} samples to {} x {} pixels, {} passes, {:.1} MB",
        tables.lines(),
        tables.samples(),
        tables.width(),
        tables.height(),
        plan.passes.len(),
        plan.bytes() as f64 * 1e-6
    );
    let passes = plan.passes.iter().map(|planned| planned.pass.name);
    let sizes = plan
        .resources
        .iter()
        .map(|planned| (planned.resource.name, planned.bytes));
    let fingerprint = format!(
        "{scene} {:?} {:?}",
        passes.collect::<Vec<_>>(),
        sizes.collect::<Vec<_>>()
    );
    (scene, blake3::hash(fingerprint.as_bytes()).to_hex()[..16].to_owned())
}

/// Times kept for an adapter: by this very program, on this machine, with its number of threads.
pub(crate) struct Kept<'a> {
    cache: &'a Cache,
    /// What they are kept by.
    key: [String; 2],
    /// The times, the last measured last.
    pub times: Vec<FrameTimes>,
}

impl<'a> Kept<'a> {
    /// Reads them; a file that is not sound counts as none.
    pub(crate) fn of(adapter: &AdapterReport, cache: &'a Cache) -> Self {
        let AdapterReport {
            name,
            backend,
            driver,
            driver_info,
            ..
        } = adapter;
        let key = [
            format!("auto {name} {backend} {driver} {driver_info}"),
            program().unwrap_or_default(),
        ];
        let is_time = |ms: f64| ms.is_finite() && ms >= 0.0;
        let sound = |kept: &Vec<FrameTimes>| kept.iter().all(|times| is_time(times.gpu_ms) && is_time(times.cpu_ms));
        let times = cache.get(&[&key[0], &key[1]], sound).ok().flatten();
        Self {
            cache,
            key,
            times: times.unwrap_or_default(),
        }
    }

    /// Times of a scene.
    pub(crate) fn find(&self, tables: &Tables) -> Option<&FrameTimes> {
        let (_, key) = described(tables, &Plan::new(tables));
        self.times.iter().find(|times| times.key == key)
    }

    /// Keeps the times of a scene; those measured first make room.
    pub(crate) fn put(&mut self, times: FrameTimes) -> Result<(), OutputError> {
        self.times.retain(|old| old.key != times.key);
        self.times.push(times);
        self.times.drain(..self.times.len().saturating_sub(MAX_KEPT));
        self.cache.put(&[&self.key[0], &self.key[1]], &self.times)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Median of frames that take these times, and the number of them made.
    fn median_of(ms: &[f64]) -> (f64, usize) {
        let mut calls = 0;
        let median = median_ms(|| {
            calls += 1;
            ms.get(calls - 1).copied().ok_or("too many")
        });
        (median.unwrap(), calls)
    }

    #[test]
    fn few_frames_are_timed_and_slow_ones_once() {
        assert_eq!(
            median_of(&[50.0, 3.0, 1.0, 9.0, 2.0, 4.0]),
            (3.0, 6),
            "the first warms up"
        );
        assert_eq!(median_of(&[2000.0]), (2000.0, 1));
        assert_eq!(median_of(&[60.0, 50.0]), (50.0, 2));
        assert_eq!(median_of(&[30.0, 20.0, 40.0, 10.0]), (20.0, 4));
        assert_eq!(median_ms(|| Err("lost")), Err("lost"));
    }

    fn times(key: &str, gpu_ms: f64, cpu_ms: f64) -> FrameTimes {
        FrameTimes {
            scene: "a scene".to_owned(),
            key: key.to_owned(),
            gpu_ms,
            cpu_ms,
        }
    }

    #[test]
    fn the_gpu_is_taken_up_to_a_tie() {
        let text = |gpu_ms, cpu_ms| {
            let times = times("", gpu_ms, cpu_ms);
            (times.is_gpu(), times.text("the card"))
        };
        assert_eq!(text(0.4, 6.3), (true, "0.40 ms a frame, the CPU 6.30 ms".to_owned()));
        assert_eq!(
            text(6.6, 6.3),
            (true, "6.60 ms a frame, the CPU 6.30 ms, within 10 %".to_owned())
        );
        assert_eq!(text(9.4, 6.3), (false, "6.30 ms a frame, the card 9.40 ms".to_owned()));
    }

    #[test]
    fn the_last_times_are_kept_for_an_adapter() {
        let Some(gpu) = insonify_testing::gpu::gpu_or_skip() else {
            return;
        };
        let folder = tempfile::tempdir().unwrap();
        let cache = Cache::at(folder.path(), "here");
        for number in 0..MAX_KEPT + 2 {
            let mut kept = Kept::of(gpu.report(), &cache);
            kept.put(times(&number.to_string(), 1.0, 2.0)).unwrap();
        }
        let mut kept = Kept::of(gpu.report(), &cache);
        assert_eq!((kept.times.len(), &*kept.times[0].key), (MAX_KEPT, "2"));
        kept.put(times("9", 3.0, 4.0)).unwrap();
        let kept = Kept::of(gpu.report(), &cache);
        assert_eq!(
            (kept.times.len(), kept.times.last()),
            (MAX_KEPT, Some(&times("9", 3.0, 4.0)))
        );
        let updated = AdapterReport {
            driver_info: "newer".to_owned(),
            ..gpu.report().clone()
        };
        assert!(Kept::of(&updated, &cache).times.is_empty());
        let mut kept = Kept::of(&updated, &cache);
        kept.put(times("bad", -1.0, 2.0)).unwrap();
        assert!(Kept::of(&updated, &cache).times.is_empty(), "no time is negative");
    }
}
