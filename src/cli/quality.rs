//! Choice of open settings of a scene or a scenario by their cost on this machine.

use std::path::Path;
use std::time::Duration;

use clap::Args;
use nalgebra::Matrix4;

use crate::backend::BackendArgs;
use crate::failure::{Error, Failure};
use crate::study::watched;
use crate::terminal;
use insonify::input::scenario::{NeedleModel, Scenario, ScenarioFile};
use insonify::run::Trial;
use insonify_base::machine::Machine;
use insonify_base::range::Ranges;
use insonify_base::statistics::Spread;
use insonify_imaging::quality::cache::Cache;
use insonify_imaging::quality::trial::{Tried, pick_tried};
use insonify_imaging::quality::{Costs, Picked, QualitySpec, grid, pick};
use insonify_imaging::scene::Scene;
use insonify_imaging::synth::FrameState;
use insonify_mechanics::tissue::remesh::Level;
use insonify_study::step_costs::{self, Nodes, Situation, StepCosts};

#[derive(Args)]
pub(crate) struct QualityArgs {
    /// Repeat the timing used by `quality`, even if this machine was timed before
    #[arg(long)]
    recalibrate: bool,
}

impl QualityArgs {
    /// Returns a cached measurement, or measures now and caches the result. A file that is not `sound` is reported
    /// and measured again.
    fn kept<T>(
        &self,
        key: &[&str],
        what: &str,
        sound: impl Fn(&T) -> bool,
        measure: impl FnOnce() -> Result<T, Error>,
    ) -> Result<T, Error>
    where
        T: serde::Serialize + serde::de::DeserializeOwned,
    {
        let cache = Cache::of_user(&Machine::here().to_string());
        if !self.recalibrate {
            match cache.get(key, sound) {
                Ok(Some(known)) => return Ok(known),
                Ok(None) => {}
                Err(bad) => terminal::warn(format_args!("the cached costs are ignored: {bad}")),
            }
        }
        terminal::say(format_args!("quality: {what}; the result is cached"));
        let unkept = |error: &dyn std::fmt::Display| {
            terminal::warn(format_args!("measured costs cannot be cached: {error}"));
        };
        let kept = cache.check(key).inspect_err(|error| unkept(error)).is_ok();
        let costs = measure()?;
        if kept {
            let _ = cache.put(key, &costs).inspect_err(|error| unkept(error));
        }
        Ok(costs)
    }
}

/// Reports the picked settings, and warns if they exceed the budget.
fn tell(picked: &Picked) {
    if picked.met {
        terminal::say(format_args!("quality: {}", picked.why))
    } else {
        terminal::warn(format_args!("quality.{}: {}", picked.asked, picked.why))
    }
}

// Choice of the numbers of scanlines and samples by timing frames of the scene.

/// Number of timed frames on each grid; the 95th percentile (19 of them) counts, as in the reports.
const FRAMES: usize = 20;

impl QualityArgs {
    /// Picks, sets and reports the grid of a scene that states a frame time budget and leaves the grid open.
    pub(crate) fn frames(&self, scene: &mut Scene, backend: &BackendArgs) -> Result<Option<Picked>, Error> {
        let Some(budget_ms) = scene.quality.frame_ms else {
            return Ok(None);
        };
        self.grid(scene, budget_ms, backend)
    }

    fn grid(&self, scene: &mut Scene, budget_ms: f64, backend: &BackendArgs) -> Result<Option<Picked>, Error> {
        let open = scene.open_grid;
        let image = [scene.settings.image.width, scene.settings.image.height];
        if open == [false; 2] {
            terminal::warn(
                "quality.frame_ms: the scene states probe.lines and probe.samples, so there is nothing to pick",
            );
            return Ok(None);
        }
        let grids = grid::candidates(&scene.settings.probe, open, image);
        let on = |scene: &Scene| backend.synthesizer(scene.anatomy.clone(), scene.settings.clone(), None);
        let (adapter, software) = {
            let chosen = on(scene)?;
            let adapter = chosen.adapter().map_or(String::new(), |name| format!(", {name}"));
            let software = chosen.synth.gpu().is_some_and(|gpu| gpu.report().software);
            (format!("{}{adapter}", chosen.synth.backend()), software)
        };
        let described = serde_json::to_string(&scene.file).map_err(|error| Failure::Output(error.into()))?;
        let key = ["frame", &adapter, &format!("{budget_ms}"), &described];
        let stands = |key: &str, value: &str| {
            let column = usize::from(key == grid::KEYS[1]);
            grid::KEYS.contains(&key) && grids.iter().any(|grid| grid[column].to_string() == value)
        };
        let sound =
            |costs: &Costs| costs.settings.len() == 1 && costs.settings.iter().all(|setting| setting.is_sound(stands));
        let costs = self.kept(&key, "measuring frames of this scene", sound, || {
            let measured = format!("kept to by 19 of {FRAMES} frames of this scene on {adapter}");
            let mut state = FrameState::at(Matrix4::identity());
            scene.state(0, scene.frames(), &mut state)?;
            // The scene itself keeps its grid until one is picked.
            let mut trial = scene.clone();
            grid::measure(&grids, open, budget_ms, measured, |[lines, samples]| {
                (trial.settings.probe.lines, trial.settings.probe.samples) = (lines, samples);
                let mut synth = on(&trial)?.synth;
                synth.render(&state)?;
                let spread = Spread::of_runs(FRAMES, || synth.render(&state).map(drop))?;
                Ok(spread.map_or(0.0, |spread| spread.p95_ms))
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
            (spec.sampling.lines, spec.sampling.samples) = (Some(probe.lines), Some(probe.samples));
        }
        tell(&picked);
        if software && !picked.met {
            terminal::warn("quality.frame_ms: this GPU is software: --backend cpu is faster");
        }
        Ok(Some(picked))
    }

    /// Picks the grid of a scenario's frames; a budget of the scenario takes precedence over that of its scene.
    pub(crate) fn frames_of(&self, scenario: &mut Scenario, backend: &BackendArgs) -> Result<Option<Picked>, Error> {
        match scenario.quality.frame_ms.or(scenario.scene.quality.frame_ms) {
            Some(budget_ms) => self.grid(&mut scenario.scene, budget_ms, backend),
            None => Ok(None),
        }
    }
}

// Choice of remeshing level, nodes, needle elements and probe candidates by step costs in blocks, verified on the
// insertion.

/// Time limit of a trial insertion.
const PATIENCE: Duration = Duration::from_secs(20);

impl QualityArgs {
    /// Picks, sets and reports the open settings of a scenario that states a step time budget. `folder` is the base of
    /// relative paths of the scenario.
    pub(crate) fn steps(&self, file: &mut ScenarioFile, folder: &Path) -> Result<Option<Picked>, Error> {
        let QualitySpec { step_ms, .. } = file.quality();
        // A budget out of range is refused with its place in the file when the scenario is resolved.
        let Some(budget_ms) = step_ms.filter(|_| file.quality().out_of_range().is_none()) else {
            return Ok(None);
        };
        if !file.tissue.model.is_remeshed() {
            terminal::warn("quality.step_ms: only `model = \"finite-element\"` has settings that can be chosen");
            return Ok(None);
        }
        let costs: StepCosts = self.kept(
            &["steps"],
            "measuring what choices cost in blocks of tissue",
            |costs: &StepCosts| {
                costs
                    .settings()
                    .all(|setting| setting.keys.len() == 1 && setting.is_sound(stands))
            },
            || {
                // Errors of the scenario take precedence.
                file.resolve(folder, |_| {})?;
                watched(|progress| step_costs::measure(progress))
            },
        )?;
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
        let dense = file.tissue.precision.is_some() || file.tissue.columns.is_some() || file.tissue.device.is_some();
        let open = |key: &str| match key {
            // Precision, columns and device imply a level: stating them fixes the choice.
            step_costs::LEVEL => file.tissue.level.is_none() && !dense,
            // Offered only where it is open.
            step_costs::NODES => true,
            step_costs::LINK | step_costs::ELEMENT => file
                .needle
                .as_ref()
                .is_some_and(|needle| needle.leaves_open(of_needle(key))),
            step_costs::THINNING => file
                .contact_probe
                .as_ref()
                .is_some_and(|probe| probe.thinning.is_none()),
            _ => false,
        };
        // Costs are measured in blocks; the picked settings are tried on the insertion itself.
        let described = file.described(folder)?;
        let key = ["trial", &format!("{budget_ms}"), &described];
        let sound = |picked: &Option<Picked>| {
            let mut settings = picked.iter().flat_map(|picked| &picked.settings);
            settings.all(|setting| stands(&setting.key, &setting.value))
        };
        let picked = self.kept(&key, "trying it on this insertion", sound, || {
            pick_tried("step_ms", &costs, budget_ms, open, |picked| tried(file, folder, picked))
        })?;
        let Some(picked) = picked else {
            terminal::warn("quality.step_ms: the scenario states every setting that could be chosen");
            return Ok(None);
        };
        set(file, &picked);
        tell(&picked);
        Ok(Some(picked))
    }
}

/// Whether a value is valid for a key.
fn stands(key: &str, value: &str) -> bool {
    match key {
        step_costs::LEVEL => level_named(value).is_some(),
        step_costs::NODES | step_costs::THINNING => value.parse::<u32>().is_ok_and(|count| count > 0),
        step_costs::LINK | step_costs::ELEMENT => value.parse().is_ok_and(|mm: f64| mm.is_finite() && mm > 0.0),
        _ => false,
    }
}

/// Key of the needle's table.
fn of_needle(key: &str) -> &str {
    key.strip_prefix("needle.").unwrap_or(key)
}

/// Applies the picked settings.
fn set(file: &mut ScenarioFile, picked: &Picked) {
    if let Some(level) = picked.value(step_costs::LEVEL) {
        file.tissue.level = level_named(level);
    }
    if let Some(nodes) = picked.value(step_costs::NODES) {
        file.tissue.nodes = nodes.parse().ok();
    }
    for key in [step_costs::LINK, step_costs::ELEMENT] {
        let length_mm = picked.value(key).and_then(|length| length.parse().ok());
        if let (Some(length_mm), Some(needle)) = (length_mm, &mut file.needle) {
            needle.state(of_needle(key), length_mm);
        }
    }
    if let (Some(every), Some(probe)) = (picked.value(step_costs::THINNING), &mut file.contact_probe) {
        probe.thinning = every.parse().ok();
    }
}

/// Runs the scenario with the picked settings.
fn tried(file: &ScenarioFile, folder: &Path, picked: &Picked) -> Result<Tried, Error> {
    let mut file = file.clone();
    set(&mut file, picked);
    let budget_ms = picked.budget_ms;
    let trial = watched(|progress| {
        progress("trying an insertion", 0.0);
        let scenario = file.resolve(folder, |_| {})?;
        let mut model = scenario.model(|_, _| {})?;
        let progressed = |share| progress("trying an insertion", share);
        Ok::<_, Error>(scenario.trial(model.as_mut(), budget_ms, PATIENCE, progressed)?)
    })?;
    let Trial {
        steps,
        over,
        longest_ms,
        ..
    } = trial;
    let counted = match trial.remeshing {
        0 => "median of the steps of this insertion, of which none remeshes".to_owned(),
        1 => "the step of this insertion that remeshes".to_owned(),
        remeshing => format!("median of the {remeshing} steps of this insertion that remesh"),
    };
    Ok(Tried {
        ms: trial.ms,
        measured: format!(
            "{counted}; {over} of {steps} steps take longer than {budget_ms} ms, the longest {longest_ms:.2} ms"
        ),
    })
}

/// Level by its name in a file.
fn level_named(name: &str) -> Option<Level> {
    let levels = [Level::Exact, Level::I, Level::II, Level::III, Level::IV];
    levels.into_iter().find(|level| format!("\"{level}\"") == name)
}
