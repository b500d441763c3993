//! Cost of each effect alone and combined with the others, and resources that remain after its removal.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use super::super::removable;
use super::{CompareOptions, Factor, Subject};
use crate::tradeoff::{Axis, Table};
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

/// Renders frames of two scenes alternately, so that other load on the machine affects both equally, for twice `patience` in total.
fn in_turn(one: &mut Ready, other: &mut Ready, patience: Duration) -> Result<[Option<Spread>; 2], Error> {
    let (start, mut times) = (Instant::now(), [Vec::new(), Vec::new()]);
    while times[0].len() < MIN || (times[0].len() < MAX && start.elapsed() < 2 * patience) {
        times[0].push(one.frame()?);
        times[1].push(other.frame()?);
    }
    Ok(times.map(Spread::of))
}

/// Returns the difference of the median times, first less second, ms.
fn longer(pair: [Option<Spread>; 2]) -> Option<f64> {
    let [one, other] = pair.map(|time| time.map(|time| time.median_ms));
    Some(one? - other?)
}

const AXES: [Axis; 9] = [
    Axis::log(
        "without_ms",
        "without ms",
        "a frame with everything but it (median), ms",
    ),
    Axis::log(
        "without_p95_ms",
        "p95 ms",
        "a frame with everything but it (95 of 100), ms",
    ),
    Axis::log(
        "whole_ms",
        "with ms",
        "a frame with everything, in turn with one without it (median), ms",
    ),
    Axis::linear(
        "saved_ms",
        "saves ms",
        "what leaving it out saves: with less without, ms",
    ),
    Axis::log("alone_ms", "alone ms", "slicing and it alone (median), ms"),
    Axis::log(
        "bare_ms",
        "slicing ms",
        "slicing alone, in turn with slicing and it (median), ms",
    ),
    Axis::linear("adds_ms", "adds ms", "what it adds to slicing: alone less slicing, ms"),
    Axis::log("without_mb", "without MB", "working memory with everything but it, MB"),
    Axis::log("alone_mb", "alone MB", "working memory of slicing and it alone, MB"),
];

/// Measures frames with all effects, all but one, only one, and none.
pub(super) fn effects(subject: &Subject<'_>, options: &CompareOptions) -> Result<Table, Error> {
    let settings = subject.sized(options.effects_grid);
    let factors = [Factor::new("backend", "backend"), Factor::new("effect", "effect")];
    let title = "Cost of each effect: frame time without it, and with it alone";
    let mut table = Table::new("compare_effects", title, &factors, &AXES);
    let present = present(subject, &settings)?;
    for (name, backend) in backends(options) {
        let ready = |keep: &dyn Fn(&Effect) -> bool| Ready::new(subject, with(subject, &settings, keep), backend());
        // Both stay for all effects: each is timed afresh in turn with its partner, so that the load of the
        // machine while one effect is measured does not count for another.
        let (mut all, mut none) = (ready(&|_| true)?, ready(&|_| false)?);
        let [whole, bare] = in_turn(&mut all, &mut none, options.patience)?;
        let mut push = |what: &str,
                        time: Option<Spread>,
                        company: [Option<Spread>; 2],
                        alone: [Option<Spread>; 2],
                        mb: [Option<f64>; 2]| {
            let median = |time: Option<Spread>| time.map(|time| time.median_ms);
            let values = vec![
                median(time),
                time.map(|time| time.p95_ms),
                median(company[0]),
                longer(company),
                median(alone[0]),
                median(alone[1]),
                longer(alone),
                mb[0],
                mb[1],
            ];
            table.push(vec![name.clone(), what.to_owned()], values, None);
        };
        push(
            "(everything)",
            whole,
            [None; 2],
            [None; 2],
            [Some(all.megabytes()), None],
        );
        for effect in &present {
            let mut but = ready(&|other| other.name != effect.name)?;
            let company = in_turn(&mut all, &mut but, options.patience)?;
            let mut only = ready(&|other| other.name == effect.name)?;
            let alone = in_turn(&mut only, &mut none, options.patience)?;
            push(
                effect.name,
                company[1],
                company,
                alone,
                [Some(but.megabytes()), Some(only.megabytes())],
            );
        }
        push(
            "(slicing alone)",
            bare,
            [None; 2],
            [None; 2],
            [Some(none.megabytes()), None],
        );
    }
    Ok(table)
}

/// Returns the resources that only the passes of one effect bind.
fn own(plan: &Plan, effect: &str) -> BTreeSet<&'static Buffer> {
    let bound = |of: bool| -> BTreeSet<&'static Buffer> {
        let passes = plan.passes.iter().filter(|planned| (planned.effect == effect) == of);
        passes
            .flat_map(|planned| planned.pass.bindings)
            .map(|&(resource, _)| resource)
            .collect()
    };
    bound(true).difference(&bound(false)).copied().collect()
}

/// Counts the bytes, passes and, on a GPU, pipelines that each effect needs, and what remains of them after its removal from a scene, which
/// must be nothing.
pub(super) fn memory(subject: &Subject<'_>, options: &CompareOptions) -> Result<Table, Error> {
    let settings = subject.sized(options.effects_grid);
    let factors = [Factor::new("backend", "backend"), Factor::new("effect", "effect")];
    let axes = [
        Axis::log("own_bytes", "own bytes", "bytes that nothing else works on"),
        Axis::linear("passes", "passes", "passes"),
        Axis::linear("left_bytes", "left, bytes", "bytes left where the scene does without"),
        Axis::linear(
            "left_passes",
            "left, passes",
            "passes and pipelines left where the scene does without",
        ),
    ];
    let title = "What each effect holds, and what is left of that once it is taken away";
    let mut table = Table::new("compare_memory", title, &factors, &axes);
    for (name, backend) in backends(options) {
        // Without a curve the tone pass displays amplitudes linearly: it is always present and cannot be removed.
        let present = present(subject, &settings)?
            .into_iter()
            .filter(|effect| effect.name != "tone");
        for effect in present {
            let plan = Plan::new(&Tables::new(subject.anatomy.clone(), settings.clone())?);
            let resources = own(&plan, effect.name);
            let held = plan
                .resources
                .iter()
                .filter(|planned| resources.contains(&planned.resource));
            let held: u64 = held.map(|planned| planned.bytes).sum();
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
            let left_passes = own_passes.iter().filter(|pass| names.contains(pass)).count();
            let flag = (left > 0.0 || left_passes > 0)
                .then(|| format!("{left} bytes and {left_passes} passes are left of what the scene does without"));
            table.push(
                vec![name.clone(), effect.name.to_owned()],
                vec![
                    Some(held as f64),
                    Some(own_passes.len() as f64),
                    Some(left),
                    Some(left_passes as f64),
                ],
                flag,
            );
        }
    }
    Ok(table)
}
