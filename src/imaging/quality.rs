//! Automatic choice of accuracy settings from their measured cost on this machine.
//!
//! A scene may state a time budget for a frame, and a scenario one for a step
//! (`quality = { frame_ms = 16, step_ms = 1 }`). Settings left open are then picked: among those within the budget, the
//! ones with the smallest error. Keys that are stated stay unchanged. Costs are measured once and cached ([`cache`]);
//! the choice and its reason are reported, so that it can be written into the file and reproduced on any machine.
//!
//! | file | contents |
//! |---|---|
//! | [`grid`] | grids of scanlines and samples, and the frame time on each |
//! | [`trial`] | trial runs that verify a choice |
//! | [`cache`] | cache of measured costs |
//!
//! Costs of steps are measured by a study: nothing here depends on studies or scenes.

pub mod cache;
pub mod grid;
#[cfg(test)]
mod tests;
pub mod trial;

use serde::{Deserialize, Serialize};

use insonify_base::number::milliseconds;
use insonify_base::pareto;
use insonify_base::range::parameters;

parameters! {
    /// Time budgets of frames and steps. What a scene leaves open is picked from what it costs on this machine.
    #[derive(Copy)]
    pub struct QualitySpec {
        /// Longest time of a frame, ms: picks the scanlines and samples of a probe that states none.
        #[serde(skip_serializing_if = "Option::is_none")]
        frame_ms: Option<f64>, in 0.01..=10000 "ms";
        /// Longest time of a step of an insertion, ms: picks the level of remeshing, the nodes of a mesh made from the
        /// scene, the length of links or of a beam's elements, and the thinning of the probe's candidates where a
        /// scenario states none.
        #[serde(skip_serializing_if = "Option::is_none")]
        step_ms: Option<f64>, in 0.01..=10000 "ms";
    }
}

/// Measured costs of settings on a machine. Costs of different settings add up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Costs {
    /// Description of the measurement.
    pub measured: String,
    /// Unit of the errors, in words that follow a number; `None` where errors only rank the options.
    pub errors: Option<String>,
    /// Time with every setting at the option without extra cost, ms.
    pub base_ms: f64,
    /// Settings that can be varied.
    pub settings: Vec<VariedSetting>,
}

/// A setting that can be varied: keys that change together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VariedSetting {
    /// Keys as written in a file.
    pub keys: Vec<String>,
    /// Available values.
    pub options: Vec<SettingOption>,
}

/// Maximum number of options of a setting read from a file: all combinations of a few such settings are tried.
const MAX_OPTIONS: usize = 16;

impl VariedSetting {
    /// Whether each option has finite costs and a value for each key that `stands` for it, and there are no more than
    /// can be tried.
    pub fn is_sound(&self, stands: impl Fn(&str, &str) -> bool) -> bool {
        let sound = |option: &SettingOption| {
            let pairs = self.keys.iter().zip(&option.values);
            option.values.len() == self.keys.len()
                && [option.extra_ms, option.error].iter().all(|number| number.is_finite())
                && pairs.into_iter().all(|(key, value)| stands(key, value))
        };
        self.options.len() <= MAX_OPTIONS && self.options.iter().all(sound)
    }
}

/// One value of a setting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SettingOption {
    /// A value for each key, as written in a file.
    pub values: Vec<String>,
    /// Time in addition to [`Costs::base_ms`], ms; negative if it saves time.
    pub extra_ms: f64,
    /// Error of this option; errors of different settings add up.
    pub error: f64,
}

/// A key with its picked value.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Setting {
    /// The key as written in a file.
    pub key: String,
    /// The value as written in a file.
    pub value: String,
}

/// Picked settings and the reason.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Picked {
    /// Key of the budget: `frame_ms` or `step_ms`.
    pub asked: String,
    /// Time budget, ms.
    pub budget_ms: f64,
    /// Expected time, ms.
    pub expected_ms: f64,
    /// Whether the expected time is within the budget.
    pub met: bool,
    /// Picked settings.
    pub settings: Vec<Setting>,
    /// Explanation of the choice in words.
    pub why: String,
}

impl Picked {
    /// Returns the value picked for a key.
    pub fn value(&self, key: &str) -> Option<&str> {
        let setting = self.settings.iter().find(|setting| setting.key == key)?;
        Some(&setting.value)
    }
}

/// One option of each setting, with total time and error.
struct Combination<'a> {
    options: Vec<&'a SettingOption>,
    ms: f64,
    error: f64,
}

/// Picks an option of every open setting: among combinations within `budget_ms` the one with the smallest error, the
/// cheaper of two with equal error; if none is within the budget, the cheapest. `None` if no setting is open.
pub fn pick(asked: &str, costs: &Costs, budget_ms: f64, open: impl Fn(&str) -> bool) -> Option<Picked> {
    let choice = choose(costs, budget_ms, open, &[])?;
    Some(choice.picked(asked, budget_ms, costs, choice.ms, &costs.measured))
}

/// The selected combination.
#[derive(Clone, Debug)]
struct Choice {
    settings: Vec<Setting>,
    ms: f64,
    error: f64,
    /// The cheapest combination with a smaller error.
    better: Option<(Vec<Setting>, f64)>,
}

impl Choice {
    /// Describes the choice among `costs`, with the time `ms` and how that was `measured`.
    fn picked(&self, asked: &str, budget_ms: f64, costs: &Costs, ms: f64, measured: &str) -> Picked {
        let within_budget = ms <= budget_ms;
        let mut why = if within_budget {
            format!("{} of {budget_ms} ms", milliseconds(ms))
        } else {
            format!(
                "nothing stays within {budget_ms} ms: this is the cheapest, {} ms",
                milliseconds(ms)
            )
        };
        if let Some(errors) = costs.errors.as_ref().filter(|_| self.error > 0.0) {
            why += &format!(", off by {:.2} {errors}", self.error);
        }
        if let Some((better, ms)) = &self.better {
            why += &format!("; the next better, {}, takes {} ms", list(better), milliseconds(*ms));
        }
        Picked {
            asked: asked.to_owned(),
            budget_ms,
            expected_ms: ms,
            met: within_budget,
            why: format!("{}: {why} ({measured})", list(&self.settings)),
            settings: self.settings.clone(),
        }
    }
}

/// Picks as [`pick`] does, with times measured for some settings in place of those that their costs predict.
fn choose(costs: &Costs, budget_ms: f64, open: impl Fn(&str) -> bool, known: &[(Vec<Setting>, f64)]) -> Option<Choice> {
    let varied: Vec<&VariedSetting> = costs
        .settings
        .iter()
        .filter(|setting| setting.keys.iter().all(|key| open(key)))
        .collect();
    if varied.is_empty() {
        return None;
    }
    // All of them: settings are few, and of few options each.
    let mut combinations = vec![Combination {
        options: Vec::new(),
        ms: costs.base_ms,
        error: 0.0,
    }];
    for setting in &varied {
        let longer = combinations.iter().flat_map(|before| {
            setting.options.iter().map(|option| Combination {
                options: before.options.iter().copied().chain([option]).collect(),
                ms: before.ms + option.extra_ms,
                error: before.error + option.error,
            })
        });
        combinations = longer.collect();
    }
    let settings = |combination: &Combination<'_>| -> Vec<Setting> {
        let pairs = varied
            .iter()
            .zip(&combination.options)
            .flat_map(|(setting, option)| setting.keys.iter().zip(&option.values));
        pairs
            .map(|(key, value)| Setting {
                key: key.clone(),
                value: value.clone(),
            })
            .collect()
    };
    // A sum of costs misses what settings share; a trial does not.
    for (known, ms) in known {
        let measured = combinations
            .iter_mut()
            .find(|combination| settings(combination) == *known);
        measured.into_iter().for_each(|combination| combination.ms = *ms);
    }
    let choice = pareto::choose(&combinations, budget_ms, 1.0, |combination| {
        [combination.ms, combination.error]
    })?;
    Some(Choice {
        settings: settings(choice.taken),
        ms: choice.taken.ms,
        error: choice.taken.error,
        better: choice.better.map(|better| (settings(better), better.ms)),
    })
}

fn list(settings: &[Setting]) -> String {
    let pairs = settings
        .iter()
        .map(|setting| format!("{} = {}", setting.key, setting.value));
    pairs.collect::<Vec<_>>().join(", ")
}
