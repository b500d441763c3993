//! Does memory stay flat in long runs? Frames with every effect, a mesh that moves and a needle on each backend of this
//! machine, then steps of an insertion with all that `insonify insert` keeps of them. The resident memory (Linux) is
//! printed at equal intervals; a run whose memory grows faster than the limits below after its first tenth ends with
//! status 1.
//!
//! `cargo run --release --example soak -- 20000 10000000` (frames of each backend and steps; these if left out)

use std::error::Error;
use std::io;

use insonify::{
    AdapterChoice, Backend, FrameState, Observer, Record, Requests, ScenarioFile, Step, Synthesizer, run_scenario,
};
use insonify_gpu::adapter;
use insonify_study::bench::compare;
use nalgebra::Matrix4;

/// Most growth a frame and a step, bytes.
const LIMITS: [f64; 2] = [256.0, 0.5];
/// Times that the memory is printed.
const PRINTED: u64 = 20;
/// Poses and deformations that the frames go through.
const STATES: usize = 50;

/// A needle that goes in and out of a block.
const INSERTION: &str = r#"
run = { dt_ms = 1 }
tissue = { nodes = 300, fix = [{ box_mm = [[-inf, -inf, 40], [inf, inf, inf]] }] }
[scene.volume]
phantom = "two-layer"
resolution_mm = 5
[needle]
length_mm = 100
"#;

fn main() -> Result<(), Box<dyn Error>> {
    let mut counts = [20_000, 10_000_000];
    for (count, text) in counts.iter_mut().zip(std::env::args().skip(1)) {
        *count = text.parse()?;
    }
    let [count, steps] = counts;
    let mut flat = frames("cpu", Backend::Cpu, count)?;
    for adapter in adapter::list() {
        let name = format!("{} ({})", adapter.name, adapter.backend);
        flat &= frames(&name, Backend::Adapter(AdapterChoice::named(name.clone())), count)?;
    }
    flat &= insertion(steps)?;
    flat.then_some(()).ok_or_else(|| "memory grows".into())
}

fn frames(name: &str, backend: Backend, count: u64) -> Result<bool, Box<dyn Error>> {
    let mut scene = compare::scene()?;
    (scene.settings.probe.lines, scene.settings.probe.samples) = (24, 48);
    (scene.settings.image.width, scene.settings.image.height) = (64, 48);
    let mut state = FrameState::at(Matrix4::identity());
    let mut synth = Synthesizer::new(scene.anatomy.clone(), scene.settings.clone(), backend)?;
    let mut watch = Watch::new(format!("frames, {name}"), count, LIMITS[0]);
    for number in 0..count {
        scene.state(number as usize % STATES, STATES, &mut state)?;
        state.frame = number;
        let moved = 0.1 * (number as f64).sin();
        state.nodes.iter_mut().flatten().for_each(|node| node[0] += moved);
        synth.render(&state)?;
        watch.after(number + 1);
    }
    Ok(watch.is_flat())
}

fn insertion(steps: u64) -> Result<bool, Box<dyn Error>> {
    let mut text = INSERTION.to_owned();
    for (at, depth_mm) in [-47, -20, -47].into_iter().enumerate() {
        let time_s = 5e-4 * steps as f64 * at as f64;
        let place = format!("time_s = {time_s}\ntip_mm = [3, 2, {depth_mm}]\ndirection = [0, 0, 1]\n");
        text += &format!("[[needle.motion.keyframes]]\n{place}");
    }
    let scenario = ScenarioFile::parse(&text, "soak")?.resolve(".".as_ref(), |_| {})?;
    let mut model = scenario.model(|_, _| {})?;
    let mut kept = Kept {
        record: Record::new(&scenario),
        watch: Watch::new("steps".to_owned(), steps, LIMITS[1]),
    };
    let summary = run_scenario(&scenario, model.as_mut(), Requests::default(), &mut kept)?;
    println!(
        "{:.4} ms a step, {} remeshes",
        summary.step_ms.wall.median, summary.remeshes
    );
    Ok(kept.watch.is_flat())
}

/// All that is kept of an insertion, its table aside.
struct Kept {
    record: Record,
    watch: Watch,
}

impl Observer for Kept {
    type Error = Box<dyn Error>;

    fn step(&mut self, step: &Step<'_>) -> Result<(), Self::Error> {
        self.record.step(step, &mut io::sink())?;
        self.watch.after(step.number);
        Ok(())
    }
}

/// The resident memory over a run.
struct Watch {
    what: String,
    count: u64,
    limit: f64,
    /// After the first tenth, and last: frames or steps done, bytes.
    ends: [Option<(u64, f64)>; 2],
}

impl Watch {
    fn new(what: String, count: u64, limit: f64) -> Self {
        Self {
            what,
            count,
            limit,
            ends: [None; 2],
        }
    }

    fn after(&mut self, done: u64) {
        if !done.is_multiple_of((self.count / PRINTED).max(1)) {
            return;
        }
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let resident = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let Some(kib) = resident.and_then(|rest| rest.trim().strip_suffix(" kB")?.parse::<f64>().ok()) else {
            return;
        };
        println!("{done} {}: {:.1} MiB", self.what, kib / 1024.0);
        let now = Some((done, 1024.0 * kib));
        if 10 * done >= self.count && self.ends[0].is_none() {
            self.ends[0] = now;
        }
        self.ends[1] = now;
    }

    fn is_flat(&self) -> bool {
        let [Some((from, before)), Some((to, after))] = self.ends else {
            println!("{}: this system does not say how much memory is resident", self.what);
            return true;
        };
        let growth = (after - before) / (to - from).max(1) as f64;
        let flat = growth <= self.limit;
        let verdict = if flat { "flat" } else { "GROWS" };
        println!(
            "{}: {growth:.3} bytes each, at most {}: {verdict}",
            self.what, self.limit
        );
        flat
    }
}
