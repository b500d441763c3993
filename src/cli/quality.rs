//! Levels that a scene leaves open, picked from what they cost here.

use std::time::Instant;

use clap::Args;
use insonify::mechanics::tissue::remesh::Level;
use insonify::quality::cache::Cache;
use insonify::quality::{Picked, QualitySpec, grid, pick};
use insonify::scenario::{LevelName, NeedleModel, NeedleTable, Scenario, ScenarioFile, TissueModel};
use insonify::scene::Scene;
use insonify::study::machine::Machine;
use insonify::study::step_costs::{self as steps, Nodes, Situation, StepCosts};
use insonify::synth::FrameState;
use nalgebra::Matrix4;

use super::backend::BackendArgs;
use super::failure::Failure;
use super::study::watched;
use super::terminal;

/// Frames that are timed on each grid; the fastest counts, since other work on the machine only adds.
const FRAMES: usize = 9;

#[derive(Args)]
pub struct QualityArgs {
    /// Where the scene asks for `quality`: measure anew what it is picked from, though it was measured on this machine before
    #[arg(long)]
    recalibrate: bool,
}

impl QualityArgs {
    /// Picks the grid of a scene that says how long a frame may take and leaves the grid open, sets it, and tells.
    pub fn frames(&self, scene: &mut Scene, backend: &BackendArgs, quiet: bool) -> Result<Option<Picked>, Failure> {
        let Some(budget_ms) = scene.quality.frame_ms else {
            return Ok(None);
        };
        self.grid(scene, budget_ms, backend, quiet)
    }

    fn grid(
        &self,
        scene: &mut Scene,
        budget_ms: f64,
        backend: &BackendArgs,
        quiet: bool,
    ) -> Result<Option<Picked>, Failure> {
        let open = scene.open_grid;
        let image = [scene.settings.image.width, scene.settings.image.height];
        if open == [false; 2] {
            terminal::warn(
                "quality.frame_ms: the scene states probe.lines and probe.samples, so there is nothing to pick",
            );
            return Ok(None);
        }
        let grids = grid::candidates(&scene.settings.probe, open, image);
        let on = |scene: &Scene| backend.synthesizer(scene.anatomy.clone(), scene.settings.clone());
        let (adapter, software) = {
            let chosen = on(scene)?;
            let adapter = chosen.adapter().map_or(String::new(), |name| format!(", {name}"));
            let software = chosen.synth.gpu().is_some_and(|gpu| gpu.report().software);
            (format!("{}{adapter}", chosen.synth.backend()), software)
        };
        let described = serde_json::to_string(&scene.file).map_err(|error| Failure::Output(error.into()))?;
        let thing = ["frame", &adapter, &format!("{budget_ms}"), &described];
        let costs = self.costs(&thing, quiet, || {
            let measured = format!("fastest of {FRAMES} frames of this scene on {adapter}");
            let mut state = FrameState::at(Matrix4::identity());
            scene.state(0, scene.frames(), &mut state)?;
            let mut trial = scene.clone();
            grid::measure(&grids, open, budget_ms, measured, |[lines, samples]| {
                (trial.settings.probe.lines, trial.settings.probe.samples) = (lines, samples);
                let mut synth = on(&trial)?.synth;
                synth.render(&state)?;
                let mut fastest = f64::INFINITY;
                for _ in 0..FRAMES {
                    let start = Instant::now();
                    synth.render(&state)?;
                    fastest = fastest.min(start.elapsed().as_secs_f64() * 1e3);
                }
                Ok(fastest)
            })
        })?;
        let Some(picked) = pick("frame_ms", &costs, budget_ms, |_| true) else {
            return Ok(None);
        };
        let number = |key: &str, stated: u32| picked.value(key).and_then(|value| value.parse().ok()).unwrap_or(stated);
        let probe = &mut scene.settings.probe;
        probe.lines = number(grid::KEYS[0], probe.lines);
        probe.samples = number(grid::KEYS[1], probe.samples);
        if let Some(spec) = &mut scene.file.probe {
            (spec.lines, spec.samples) = (Some(probe.lines), Some(probe.samples));
        }
        tell(&picked, quiet);
        if software && !picked.met {
            terminal::warn("quality.frame_ms: this GPU is software: --backend cpu is faster");
        }
        Ok(Some(picked))
    }

    /// Picks what a scenario leaves open where it says how long a step may take, sets it, and tells.
    pub fn steps(&self, file: &mut ScenarioFile, quiet: bool) -> Result<Option<Picked>, Failure> {
        let QualitySpec { step_ms, .. } = file.quality();
        // What is out of range is refused with its place in the file when that is resolved.
        let Some(budget_ms) = step_ms.filter(|_| file.quality().out_of_range().is_none()) else {
            return Ok(None);
        };
        if file.tissue.model != TissueModel::FiniteElement {
            terminal::warn("quality.step_ms: only tissue of `model = \"finite-element\"` has something to pick");
            return Ok(None);
        }
        let costs: StepCosts = self.costs(&["steps"], quiet, || {
            watched(quiet, |progress| Ok(steps::measure(progress)?))
        })?;
        let model = file.needle.as_ref().map(|needle| needle.model);
        let costs = costs.in_situation(&Situation {
            probe: file.contact_probe.is_some(),
            beam: model == Some(NeedleModel::Beam),
            needle_mm: file.needle.as_ref().and_then(|needle| needle.length_mm),
            nodes: match (&file.tissue.mesh, file.tissue.nodes) {
                (Some(_), _) => Nodes::Unknown,
                (None, Some(nodes)) => Nodes::Stated(nodes),
                (None, None) => Nodes::Open,
            },
        });
        let dense = file.tissue.precision.is_some() || file.tissue.columns.is_some();
        let needle = |wanted: NeedleModel, stated: fn(&NeedleTable) -> bool| {
            model == Some(wanted) && file.needle.as_ref().is_some_and(|needle| !stated(needle))
        };
        let open = |key: &str| match key {
            // Precision and columns belong to a level: who states them has chosen.
            steps::LEVEL => file.tissue.level.is_none() && !dense,
            // Offered only where they are open.
            steps::NODES => true,
            steps::LINK => needle(NeedleModel::Springs, |needle| needle.link_mm.is_some()),
            steps::ELEMENT => needle(NeedleModel::Beam, |needle| needle.element_mm.is_some()),
            steps::THINNING => file
                .contact_probe
                .as_ref()
                .is_some_and(|probe| probe.thinning.is_none()),
            _ => false,
        };
        let Some(picked) = pick("step_ms", &costs, budget_ms, open) else {
            terminal::warn("quality.step_ms: the scenario states all that could be picked");
            return Ok(None);
        };
        if let Some(level) = picked.value(steps::LEVEL) {
            file.tissue.level = level_named(level);
        }
        if let Some(nodes) = picked.value(steps::NODES) {
            file.tissue.nodes = nodes.parse().ok();
        }
        if let (Some(link), Some(needle)) = (picked.value(steps::LINK), &mut file.needle) {
            needle.link_mm = link.parse().ok();
        }
        if let (Some(element), Some(needle)) = (picked.value(steps::ELEMENT), &mut file.needle) {
            needle.element_mm = element.parse().ok();
        }
        if let (Some(every), Some(probe)) = (picked.value(steps::THINNING), &mut file.contact_probe) {
            probe.thinning = every.parse().ok();
        }
        tell(&picked, quiet);
        Ok(Some(picked))
    }

    /// Picks the grid of a scenario's frames; its own time counts before that of its scene.
    pub fn frames_of(
        &self,
        scenario: &mut Scenario,
        backend: &BackendArgs,
        quiet: bool,
    ) -> Result<Option<Picked>, Failure> {
        match scenario.quality.frame_ms.or(scenario.scene.quality.frame_ms) {
            Some(budget_ms) => self.grid(&mut scenario.scene, budget_ms, backend, quiet),
            None => Ok(None),
        }
    }

    /// Costs that are kept, or measured now and kept.
    fn costs<T>(&self, thing: &[&str], quiet: bool, measure: impl FnOnce() -> Result<T, Failure>) -> Result<T, Failure>
    where
        T: serde::Serialize + serde::de::DeserializeOwned,
    {
        let cache = Cache::of_user(&Machine::here().to_string());
        if let Some(costs) = cache.get(thing).filter(|_| !self.recalibrate) {
            return Ok(costs);
        }
        if !quiet {
            terminal::say("quality: measuring what choices cost on this machine; it is kept for the next time");
        }
        let costs = measure()?;
        if let Err(error) = cache.put(thing, &costs) {
            terminal::warn(format_args!("what was measured is not kept: {error}"));
        }
        Ok(costs)
    }
}

/// Says what was picked. What cannot be met is said in any case.
fn tell(picked: &Picked, quiet: bool) {
    match picked.met {
        true if quiet => {}
        true => terminal::say(format_args!("quality: {}", picked.why)),
        false => terminal::warn(format_args!("quality.{}: {}", picked.asked, picked.why)),
    }
}

/// A level by its name, as it stands in a file.
fn level_named(name: &str) -> Option<LevelName> {
    let all = [
        LevelName::Exact,
        LevelName::I,
        LevelName::II,
        LevelName::III,
        LevelName::IV,
    ];
    all.into_iter()
        .find(|level| format!("\"{}\"", Level::from(*level)) == name)
}
