//! Levels picked from what they cost on this machine.
//!
//! A scene may say how long a frame may take, and a scenario how long a step (`quality = { frame_ms = 16, step_ms = 1 }`). What they
//! leave open is then picked: of all that stays within that time, what errs least. Keys that are stated stay as they are. Costs are
//! measured once and kept ([`cache`]); what was picked, and why, is told, so that it can be written into the file and stays so on
//! any machine.
//!
//! | file | what it holds |
//! |---|---|
//! | [`grid`] | grids of scanlines and samples: what a frame of a scene costs on each |
//! | [`trial`] | picks that are tried before they are believed |
//! | [`cache`] | where costs are kept |
//!
//! What steps cost is measured by [`crate::study::step_costs`]: nothing here knows studies or scenes.

pub mod cache;
pub mod grid;
#[cfg(test)]
mod tests;
pub mod trial;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How long frames and steps may take. What a scene leaves open is picked from what it costs on this machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct QualitySpec {
    /// Most time of a frame, ms (0.01 to 10000): picks the scanlines and samples of a probe that states none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame_ms: Option<f64>,
    /// Most time of a step of an insertion, ms (0.01 to 10000): picks the level of remeshing, the nodes of a mesh made from the scene,
    /// the length of links or of a beam's elements, and the thinning of the probe's candidates where a scenario states none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_ms: Option<f64>,
}

impl QualitySpec {
    /// What is expected of both.
    pub const EXPECTED: &str = "0.01 to 10000 ms";

    /// The first number out of range, with its key.
    pub fn out_of_range(&self) -> Option<(&'static str, f64)> {
        let numbers = [("frame_ms", self.frame_ms), ("step_ms", self.step_ms)];
        let given = numbers.into_iter().filter_map(|(key, ms)| Some((key, ms?)));
        given.into_iter().find(|(_, ms)| !(0.01..=10_000.0).contains(ms))
    }
}

/// What choices cost on a machine. Costs of different dials add up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Costs {
    /// What was measured, in words.
    pub measured: String,
    /// What errors are of, in words that follow a number; none where they only tell what is better.
    pub errors: Option<String>,
    /// Time with every dial at the rung that costs nothing extra, ms.
    pub base_ms: f64,
    /// What can be chosen.
    pub dials: Vec<Dial>,
}

/// One choice: some keys that are set together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dial {
    /// Keys as they stand in a file.
    pub keys: Vec<String>,
    /// What they may be.
    pub rungs: Vec<Rung>,
}

/// Most rungs of a dial that is read from a file: all combinations of a few such dials are tried.
const MOST_RUNGS: usize = 16;

impl Dial {
    /// Whether each rung has finite costs and a value for each key that `stands` for it, and there are no more than can be tried.
    pub fn is_sound(&self, stands: impl Fn(&str, &str) -> bool) -> bool {
        let sound = |rung: &Rung| {
            let pairs = self.keys.iter().zip(&rung.values);
            rung.values.len() == self.keys.len()
                && [rung.extra_ms, rung.error].iter().all(|number| number.is_finite())
                && pairs.into_iter().all(|(key, value)| stands(key, value))
        };
        self.rungs.len() <= MOST_RUNGS && self.rungs.iter().all(sound)
    }
}

/// One way to set a dial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rung {
    /// A value for each key, as it stands in a file.
    pub values: Vec<String>,
    /// Time beyond that of [`Costs::base_ms`], ms; below zero where it saves some.
    pub extra_ms: f64,
    /// How wrong it is; errors of different dials add up.
    pub error: f64,
}

/// A key with the value picked for it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Setting {
    /// The key as it stands in a file.
    pub key: String,
    /// The value as it stands there.
    pub value: String,
}

/// What was picked, and why.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Picked {
    /// What was asked for: `frame_ms` or `step_ms`.
    pub asked: String,
    /// The time asked for, ms.
    pub budget_ms: f64,
    /// The time to expect, ms.
    pub expected_ms: f64,
    /// Whether it stays within what was asked for.
    pub met: bool,
    /// What is set.
    pub settings: Vec<Setting>,
    /// All of it in words.
    pub why: String,
}

impl Picked {
    /// The value picked for a key.
    pub fn value(&self, key: &str) -> Option<&str> {
        let setting = self.settings.iter().find(|setting| setting.key == key)?;
        Some(&setting.value)
    }
}

/// One rung of each dial, with what they come to.
struct Combination<'a> {
    rungs: Vec<&'a Rung>,
    ms: f64,
    error: f64,
}

/// Picks a rung of every dial that is open: of those combinations that stay within `budget_ms` the one that errs least, the cheaper
/// of two that err alike; where none does, the cheapest. None where no dial is open.
pub fn pick(asked: &str, costs: &Costs, budget_ms: f64, open: impl Fn(&str) -> bool) -> Option<Picked> {
    let choice = choose(costs, budget_ms, open, &[])?;
    Some(choice.picked(asked, budget_ms, costs, choice.ms, &costs.measured))
}

/// A combination that was chosen.
#[derive(Clone, Debug)]
struct Choice {
    settings: Vec<Setting>,
    ms: f64,
    error: f64,
    /// The cheapest that errs less.
    better: Option<(Vec<Setting>, f64)>,
}

impl Choice {
    /// The choice among some costs, with the time that it takes, and how that was found.
    fn picked(&self, asked: &str, budget_ms: f64, costs: &Costs, ms: f64, measured: &str) -> Picked {
        let met = ms <= budget_ms;
        let mut why = match met {
            true => format!("{} of {budget_ms} ms", short(ms)),
            false => format!(
                "nothing stays within {budget_ms} ms: this is the cheapest, {} ms",
                short(ms)
            ),
        };
        if let Some(errors) = costs.errors.as_ref().filter(|_| self.error > 0.0) {
            why += &format!(", off by {:.2} {errors}", self.error);
        }
        if let Some((better, ms)) = &self.better {
            why += &format!("; the next better, {}, takes {} ms", list(better), short(*ms));
        }
        Picked {
            asked: asked.to_owned(),
            budget_ms,
            expected_ms: ms,
            met,
            why: format!("{}: {why} ({measured})", list(&self.settings)),
            settings: self.settings.clone(),
        }
    }
}

/// What [`pick`] picks, where some settings are known to take other times than their costs say.
fn choose(costs: &Costs, budget_ms: f64, open: impl Fn(&str) -> bool, known: &[(Vec<Setting>, f64)]) -> Option<Choice> {
    let dials: Vec<&Dial> = costs
        .dials
        .iter()
        .filter(|dial| dial.keys.iter().all(|key| open(key)))
        .collect();
    if dials.is_empty() {
        return None;
    }
    let mut combinations = vec![Combination {
        rungs: Vec::new(),
        ms: costs.base_ms,
        error: 0.0,
    }];
    for dial in &dials {
        let longer = combinations.iter().flat_map(|before| {
            dial.rungs.iter().map(|rung| Combination {
                rungs: before.rungs.iter().copied().chain([rung]).collect(),
                ms: before.ms + rung.extra_ms,
                error: before.error + rung.error,
            })
        });
        combinations = longer.collect();
    }
    let settings = |of: &Combination<'_>| -> Vec<Setting> {
        let pairs = dials
            .iter()
            .zip(&of.rungs)
            .flat_map(|(dial, rung)| dial.keys.iter().zip(&rung.values));
        pairs
            .map(|(key, value)| Setting {
                key: key.clone(),
                value: value.clone(),
            })
            .collect()
    };
    for (known, ms) in known {
        let found = combinations.iter_mut().find(|it| settings(it) == *known);
        found.into_iter().for_each(|it| it.ms = *ms);
    }
    let by_error = |a: &&Combination<'_>, b: &&Combination<'_>| a.error.total_cmp(&b.error).then(a.ms.total_cmp(&b.ms));
    let by_time = |a: &&Combination<'_>, b: &&Combination<'_>| a.ms.total_cmp(&b.ms).then(a.error.total_cmp(&b.error));
    let within = combinations.iter().filter(|it| it.ms <= budget_ms).min_by(by_error);
    let taken = within.or_else(|| combinations.iter().min_by(by_time))?;
    let better = combinations.iter().filter(|it| it.error < taken.error).min_by(by_time);
    Some(Choice {
        settings: settings(taken),
        ms: taken.ms,
        error: taken.error,
        better: better.map(|better| (settings(better), better.ms)),
    })
}

fn list(settings: &[Setting]) -> String {
    let pairs = settings
        .iter()
        .map(|setting| format!("{} = {}", setting.key, setting.value));
    pairs.collect::<Vec<_>>().join(", ")
}

fn short(ms: f64) -> String {
    let digits = if ms.abs() < 10.0 { 2 } else { 0 };
    format!("{ms:.digits$}")
}
