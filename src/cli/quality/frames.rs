//! Choice of the numbers of scanlines and samples by timing frames of the scene.

use std::time::Instant;

use crate::base::report::statistics::Spread;
use crate::imaging::quality::{Costs, Picked, grid, pick};
use crate::imaging::synth::FrameState;
use crate::input::scenario::Scenario;
use crate::input::scene::Scene;
use nalgebra::Matrix4;

use super::{QualityArgs, tell};
use crate::cli::backend::BackendArgs;
use crate::cli::failure::Failure;
use crate::cli::terminal;

/// Number of timed frames on each grid; the 95th percentile (19 of them) counts, as in the reports.
const FRAMES: usize = 20;

impl QualityArgs {
    /// Picks, sets and reports the grid of a scene that states a frame time budget and leaves the grid open.
    pub fn frames(&self, scene: &mut Scene, backend: &BackendArgs) -> Result<Option<Picked>, Failure> {
        let Some(budget_ms) = scene.quality.frame_ms else {
            return Ok(None);
        };
        self.grid(scene, budget_ms, backend)
    }

    fn grid(&self, scene: &mut Scene, budget_ms: f64, backend: &BackendArgs) -> Result<Option<Picked>, Failure> {
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
        let stands = |key: &str, value: &str| {
            let column = usize::from(key == grid::KEYS[1]);
            grid::KEYS.contains(&key) && grids.iter().any(|grid| grid[column].to_string() == value)
        };
        let sound = |costs: &Costs| costs.dials.len() == 1 && costs.dials.iter().all(|dial| dial.is_sound(stands));
        let costs = self.kept(&thing, "measuring frames of this scene", sound, || {
            let measured = format!("kept to by 19 of {FRAMES} frames of this scene on {adapter}");
            let mut state = FrameState::at(Matrix4::identity());
            scene.state(0, scene.frames(), &mut state)?;
            let mut trial = scene.clone();
            grid::measure(&grids, open, budget_ms, measured, |[lines, samples]| {
                (trial.settings.probe.lines, trial.settings.probe.samples) = (lines, samples);
                let mut synth = on(&trial)?.synth;
                synth.render(&state)?;
                let times = (0..FRAMES).map(|_| {
                    let start = Instant::now();
                    synth.render(&state)?;
                    Ok(start.elapsed().as_secs_f64() * 1e3)
                });
                let times = times.collect::<Result<Vec<f64>, Failure>>()?;
                Ok(Spread::of(times).map_or(0.0, |spread| spread.p95_ms))
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
        tell(&picked);
        if software && !picked.met {
            terminal::warn("quality.frame_ms: this GPU is software: --backend cpu is faster");
        }
        Ok(Some(picked))
    }

    /// Picks the grid of a scenario's frames; a budget of the scenario takes precedence over that of its scene.
    pub fn frames_of(&self, scenario: &mut Scenario, backend: &BackendArgs) -> Result<Option<Picked>, Failure> {
        match scenario.quality.frame_ms.or(scenario.scene.quality.frame_ms) {
            Some(budget_ms) => self.grid(&mut scenario.scene, budget_ms, backend),
            None => Ok(None),
        }
    }
}
