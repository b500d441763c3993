//! Choice of remeshing level, nodes, needle elements and probe candidates by step costs in blocks, verified on the
//! insertion.

use std::path::Path;
use std::time::Duration;

use crate::imaging::quality::trial::{Tried, pick_tried};
use crate::imaging::quality::{Picked, QualitySpec};
use crate::input::scenario::{NeedleModel, NeedleTable, ScenarioFile, TissueModel, Trial};
use crate::mechanics::tissue::remesh::Level;
use crate::study::step_costs::{self, Nodes, Situation, StepCosts};

use super::{QualityArgs, tell};
use crate::cli::failure::Failure;
use crate::cli::study::watched;
use crate::cli::terminal;

/// Time limit of a trial insertion.
const PATIENCE: Duration = Duration::from_secs(20);

impl QualityArgs {
    /// Picks, sets and reports the open settings of a scenario that states a step time budget. `folder` is the base of relative paths
    /// of the scenario.
    pub fn steps(&self, file: &mut ScenarioFile, folder: &Path) -> Result<Option<Picked>, Failure> {
        let QualitySpec { step_ms, .. } = file.quality();
        // A budget out of range is refused with its place in the file when the scenario is resolved.
        let Some(budget_ms) = step_ms.filter(|_| file.quality().out_of_range().is_none()) else {
            return Ok(None);
        };
        if file.tissue.model != TissueModel::FiniteElement {
            terminal::warn("quality.step_ms: only tissue of `model = \"finite-element\"` has something to pick");
            return Ok(None);
        }
        let costs: StepCosts = self.kept(
            &["steps"],
            "measuring what choices cost in blocks of tissue",
            |costs: &StepCosts| costs.dials().all(|dial| dial.keys.len() == 1 && dial.is_sound(stands)),
            || {
                // Errors of the scenario take precedence.
                file.resolve(folder, |_| {})?;
                watched(|progress| Ok(step_costs::measure(progress)?))
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
        let needle = |wanted: NeedleModel, stated: fn(&NeedleTable) -> bool| {
            model == Some(wanted) && file.needle.as_ref().is_some_and(|needle| !stated(needle))
        };
        let open = |key: &str| match key {
            // Precision, columns and device imply a level: stating them fixes the choice.
            step_costs::LEVEL => file.tissue.level.is_none() && !dense,
            // Offered only where it is open.
            step_costs::NODES => true,
            step_costs::LINK => needle(NeedleModel::Springs, |needle| needle.link_mm.is_some()),
            step_costs::ELEMENT => needle(NeedleModel::Beam, |needle| needle.element_mm.is_some()),
            step_costs::THINNING => file
                .contact_probe
                .as_ref()
                .is_some_and(|probe| probe.thinning.is_none()),
            _ => false,
        };
        // Costs are measured in blocks; the picked settings are tried on the insertion itself.
        let described = file.described(folder)?;
        let thing = ["trial", &format!("{budget_ms}"), &described];
        let sound = |picked: &Option<Picked>| {
            let mut settings = picked.iter().flat_map(|picked| &picked.settings);
            settings.all(|setting| stands(&setting.key, &setting.value))
        };
        let picked = self.kept(&thing, "trying it on this insertion", sound, || {
            pick_tried("step_ms", &costs, budget_ms, open, |picked| tried(file, folder, picked))
        })?;
        let Some(picked) = picked else {
            terminal::warn("quality.step_ms: the scenario states all that could be picked");
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

/// Applies the picked settings.
fn set(file: &mut ScenarioFile, picked: &Picked) {
    if let Some(level) = picked.value(step_costs::LEVEL) {
        file.tissue.level = level_named(level);
    }
    if let Some(nodes) = picked.value(step_costs::NODES) {
        file.tissue.nodes = nodes.parse().ok();
    }
    if let (Some(link), Some(needle)) = (picked.value(step_costs::LINK), &mut file.needle) {
        needle.link_mm = link.parse().ok();
    }
    if let (Some(element), Some(needle)) = (picked.value(step_costs::ELEMENT), &mut file.needle) {
        needle.element_mm = element.parse().ok();
    }
    if let (Some(every), Some(probe)) = (picked.value(step_costs::THINNING), &mut file.contact_probe) {
        probe.thinning = every.parse().ok();
    }
}

/// Runs the scenario with the picked settings.
fn tried(file: &ScenarioFile, folder: &Path, picked: &Picked) -> Result<Tried, Failure> {
    let mut file = file.clone();
    set(&mut file, picked);
    let budget_ms = picked.budget_ms;
    let found = watched(|progress| {
        progress("trying an insertion", 0.0);
        let scenario = file.resolve(folder, |_| {})?;
        let mut model = scenario.model(|_, _| {})?;
        let told = |share| progress("trying an insertion", share);
        Ok::<_, Failure>(scenario.trial(model.as_mut(), budget_ms, PATIENCE, told)?)
    })?;
    let Trial {
        steps,
        over,
        longest_ms,
        ..
    } = found;
    let counted = match found.remeshing {
        0 => "median of the steps of this insertion, of which none remeshes".to_owned(),
        1 => "the step of this insertion that remeshes".to_owned(),
        remeshing => format!("median of the {remeshing} steps of this insertion that remesh"),
    };
    Ok(Tried {
        ms: found.ms,
        measured: format!(
            "{counted}; {over} of {steps} steps take longer than {budget_ms} ms, the longest {longest_ms:.2} ms"
        ),
    })
}

/// Level by its name in a file.
fn level_named(name: &str) -> Option<Level> {
    let all = [Level::Exact, Level::I, Level::II, Level::III, Level::IV];
    all.into_iter().find(|level| format!("\"{level}\"") == name)
}
