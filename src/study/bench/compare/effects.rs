//! Cost of each effect alone and combined with the others, and resources that remain after its removal.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use super::super::removable;
use super::{CompareOptions, Factor, Subject};
use crate::tradeoff::{Axis, Choice, Column, Table};
use insonify::Error;
use insonify_base::statistics::Spread;
use insonify_imaging::effects::Effect;
use insonify_imaging::effects::buffers::Buffer;
use insonify_imaging::plan::Plan;
use insonify_imaging::synth::tables::{Anatomy, Settings, Tables};
use insonify_imaging::synth::{Backend, FrameState, Synthesizer};

/// Minimum and maximum number of frame pairs.
const MIN: usize = 3;
const MAX: usize = 60;

/// Returns the scene with only the effects to keep.
fn with(subject: &Subject<'_>, settings: &Settings, keep: impl Fn(&Effect) -> bool) -> (Anatomy, Settings) {
    let (mut anatomy, mut settings) = (subject.anatomy.clone(), settings.clone());
    for (_, remove) in removable().filter(|(effect, _)| !keep(effect)) {
        remove(&mut anatomy, &mut settings);
    }
    (anatomy, settings)
}

/// Returns the effects that the scene has and that can be removed.
fn present(subject: &Subject<'_>, settings: &Settings) -> Result<Vec<&'static Effect>, Error> {
    let plan = Plan::new(&Tables::new(subject.anatomy.clone(), settings.clone())?);
    let changes = |effect: &&'static Effect| {
        let (anatomy, without) = with(subject, settings, |other| other.name != effect.name);
        plan.has(effect.name) && (without != *settings || anatomy.mesh.is_none() != subject.anatomy.mesh.is_none())
    };
    Ok(removable().map(|(effect, _)| effect).filter(changes).collect())
}

fn backends(options: &CompareOptions) -> Vec<(String, Box<dyn Fn() -> Backend + '_>)> {
    let mut all: Vec<(String, Box<dyn Fn() -> Backend>)> = vec![("cpu".to_owned(), Box::new(|| Backend::Cpu))];
    for gpu in &options.gpus {
        let backend = move || Backend::Gpu(Box::new(gpu.clone()));
        all.push((gpu.report().name.clone(), Box::new(backend)));
    }
    all
}

/// Synthesizer and frame state, warmed up by one untimed frame.
struct Ready {
    synth: Synthesizer,
    state: FrameState,
}

impl Ready {
    /// Creates a synthesizer of the given scene and renders a first frame.
    fn new(subject: &Subject<'_>, (anatomy, settings): (Anatomy, Settings), backend: Backend) -> Result<Self, Error> {
        let mut state = subject.state.clone();
        if anatomy.mesh.is_none() {
            (state.nodes, state.reference) = (None, None);
        }
        let mut synth = Synthesizer::new(anatomy, settings, backend)?;
        synth.render(&state)?;
        Ok(Self { synth, state })
    }

    /// Renders a frame and returns its time, ms.
    fn frame(&mut self) -> Result<f64, Error> {
        let start = Instant::now();
        self.synth.render(&self.state)?;
        Ok(start.elapsed().as_secs_f64() * 1e3)
    }

    /// Returns the working memory, MB.
    fn megabytes(&self) -> f64 {
        self.synth.memory_bytes() as f64 * 1e-6
    }
}

/// Renders frames of two scenes alternately, so that other load on the machine affects both equally, for twice
/// `patience` in total.
fn in_turn(one: &mut Ready, other: &mut Ready, patience: Duration) -> Result<[Option<Spread>; 2], Error> {
    let (start, mut times) = (Instant::now(), [Vec::new(), Vec::new()]);
    while times[0].len() < MIN || (times[0].len() < MAX && start.elapsed() < 2 * patience) {
        times[0].push(one.frame()?);
        times[1].push(other.frame()?);
    }
    Ok(times.map(Spread::of))
}

/// A frame without an effect, and one with it alone.
struct EffectRow {
    backend: String,
    what: &'static str,
    without: Option<Spread>,
    /// A frame with everything, in turn with one without the effect.
    whole: [Option<Spread>; 2],
    /// Slicing and the effect alone, in turn with slicing.
    alone: [Option<Spread>; 2],
    without_mb: f64,
    alone_mb: Option<f64>,
}

fn median(time: Option<Spread>) -> Option<f64> {
    Some(time?.median_ms)
}

/// Returns the difference of the median times, first less second, ms.
fn longer([one, other]: [Option<Spread>; 2]) -> Option<f64> {
    Some(median(one)? - median(other)?)
}

const BACKEND: Factor = Factor::new("backend", "backend");
const EFFECT: Factor = Factor::new("effect", "effect");

const CHOICES: [Choice<EffectRow>; 2] = [
    BACKEND.of(|row| row.backend.clone()),
    EFFECT.of(|row| row.what.to_owned()),
];

const COLUMNS: [Column<EffectRow>; 9] = [
    Axis::log(
        "without_ms",
        "without ms",
        "a frame with everything but it (median), ms",
    )
    .of(|row| median(row.without)),
    Axis::log(
        "without_p95_ms",
        "p95 ms",
        "a frame with everything but it (95 of 100), ms",
    )
    .of(|row| Some(row.without?.p95_ms)),
    Axis::log(
        "whole_ms",
        "with ms",
        "a frame with everything, in turn with one without it (median), ms",
    )
    .of(|row| median(row.whole[0])),
    Axis::linear(
        "saved_ms",
        "saves ms",
        "what leaving it out saves: with less without, ms",
    )
    .of(|row| longer(row.whole)),
    Axis::log("alone_ms", "alone ms", "slicing and it alone (median), ms").of(|row| median(row.alone[0])),
    Axis::log(
        "bare_ms",
        "slicing ms",
        "slicing alone, in turn with slicing and it (median), ms",
    )
    .of(|row| median(row.alone[1])),
    Axis::linear("adds_ms", "adds ms", "what it adds to slicing: alone less slicing, ms").of(|row| longer(row.alone)),
    Axis::log("without_mb", "without MB", "working memory with everything but it, MB").of(|row| Some(row.without_mb)),
    Axis::log("alone_mb", "alone MB", "working memory of slicing and it alone, MB").of(|row| row.alone_mb),
];

/// Measures frames with all effects, all but one, only one, and none.
pub(super) fn effects(subject: &Subject<'_>, options: &CompareOptions) -> Result<Table, Error> {
    let settings = subject.sized(options.effects_grid);
    let mut rows = Vec::new();
    let present = present(subject, &settings)?;
    for (name, backend) in backends(options) {
        let ready = |keep: &dyn Fn(&Effect) -> bool| Ready::new(subject, with(subject, &settings, keep), backend());
        // Both stay for all effects: each is timed afresh in turn with its partner, so that the load of the
        // machine while one effect is measured does not count for another.
        let (mut all, mut none) = (ready(&|_| true)?, ready(&|_| false)?);
        let [time_of_all, time_of_none] = in_turn(&mut all, &mut none, options.patience)?;
        let single = |what, without, ready: &Ready| EffectRow {
            backend: name.clone(),
            what,
            without,
            whole: [None; 2],
            alone: [None; 2],
            without_mb: ready.megabytes(),
            alone_mb: None,
        };
        rows.push(single("(everything)", time_of_all, &all));
        for effect in &present {
            let mut but = ready(&|other| other.name != effect.name)?;
            let whole = in_turn(&mut all, &mut but, options.patience)?;
            let mut only = ready(&|other| other.name == effect.name)?;
            let alone = in_turn(&mut only, &mut none, options.patience)?;
            rows.push(EffectRow {
                whole,
                alone,
                alone_mb: Some(only.megabytes()),
                ..single(effect.name, whole[1], &but)
            });
        }
        rows.push(single("(slicing alone)", time_of_none, &none));
    }
    let title = "Cost of each effect: frame time without it, and with it alone";
    Ok(Table::of("compare_effects", title, &CHOICES, &COLUMNS, &rows))
}

/// Returns the buffers that only the passes of one effect bind.
fn exclusive_buffers(plan: &Plan, effect: &str) -> BTreeSet<&'static Buffer> {
    let bound = |of: bool| -> BTreeSet<&'static Buffer> {
        let passes = plan.passes.iter().filter(|planned| (planned.effect == effect) == of);
        passes
            .flat_map(|planned| planned.pass.bindings)
            .map(|&(resource, _)| resource)
            .collect()
    };
    bound(true).difference(&bound(false)).copied().collect()
}

/// Buffers and passes of an effect, and those left once it is taken away.
struct MemoryRow {
    backend: String,
    effect: &'static str,
    bytes: f64,
    passes: usize,
    left_bytes: f64,
    left_passes: usize,
}

const MEMORY_CHOICES: [Choice<MemoryRow>; 2] = [
    BACKEND.of(|row| row.backend.clone()),
    EFFECT.of(|row| row.effect.to_owned()),
];

const MEMORY_COLUMNS: [Column<MemoryRow>; 4] = [
    Axis::log("own_bytes", "own bytes", "bytes that nothing else works on").of(|row| Some(row.bytes)),
    Axis::linear("passes", "passes", "passes").of(|row| Some(row.passes as f64)),
    Axis::linear("left_bytes", "left, bytes", "bytes left where the scene does without").of(|row| Some(row.left_bytes)),
    Axis::linear(
        "left_passes",
        "left, passes",
        "passes and pipelines left where the scene does without",
    )
    .of(|row| Some(row.left_passes as f64)),
];

impl MemoryRow {
    fn flag(&self) -> Option<String> {
        let Self {
            left_bytes,
            left_passes,
            ..
        } = self;
        let is_left = *left_bytes > 0.0 || *left_passes > 0;
        is_left.then(|| format!("{left_bytes} bytes and {left_passes} passes are left of what the scene does without"))
    }
}

/// Counts the bytes, passes and, on a GPU, pipelines that each effect needs, and what remains of them after its removal
/// from a scene, which must be nothing.
pub(super) fn memory(subject: &Subject<'_>, options: &CompareOptions) -> Result<Table, Error> {
    let settings = subject.sized(options.effects_grid);
    let mut rows = Vec::new();
    let plan = Plan::new(&Tables::new(subject.anatomy.clone(), settings.clone())?);
    // Without a curve the tone pass displays amplitudes linearly: it is always present and cannot be removed.
    let mut effects = present(subject, &settings)?;
    effects.retain(|effect| effect.name != "tone");
    for (name, backend) in backends(options) {
        for effect in &effects {
            let resources = exclusive_buffers(&plan, effect.name);
            let of_effect = plan
                .resources
                .iter()
                .filter(|planned| resources.contains(&planned.resource));
            let bytes: u64 = of_effect.map(|planned| planned.bytes).sum();
            let own_passes = plan.passes.iter().filter(|planned| planned.effect == effect.name);
            let own_passes: Vec<&str> = own_passes.map(|planned| planned.pass.name).collect();
            let (anatomy, without) = with(subject, &settings, |other| other.name != effect.name);
            let fresh = Synthesizer::new(anatomy.clone(), without.clone(), backend())?;
            let idle = if anatomy.mesh.is_none() != subject.anatomy.mesh.is_none() {
                // The mesh is fixed on creation: a scene without it needs a new synthesizer.
                Synthesizer::new(anatomy, without, backend())?
            } else {
                let mut synth = Synthesizer::new(anatomy, settings.clone(), backend())?;
                synth.set(without)?;
                synth
            };
            let planned = idle.plan().resources.iter();
            let left: u64 = planned
                .filter(|planned| resources.contains(&planned.resource))
                .map(|planned| planned.bytes)
                .sum();
            let left = left as f64 + (idle.memory_bytes() as f64 - fresh.memory_bytes() as f64).abs();
            let passes = idle.plan().passes.iter().map(|planned| planned.pass.name);
            let names: Vec<&str> = passes.chain(idle.pipelines()).collect();
            rows.push(MemoryRow {
                backend: name.clone(),
                effect: effect.name,
                bytes: bytes as f64,
                passes: own_passes.len(),
                left_bytes: left,
                left_passes: own_passes.iter().filter(|pass| names.contains(pass)).count(),
            });
        }
    }
    let title = "What each effect holds, and what is left of that once it is taken away";
    let table = Table::of("compare_memory", title, &MEMORY_CHOICES, &MEMORY_COLUMNS, &rows);
    Ok(table.flagged(&rows, MemoryRow::flag))
}
