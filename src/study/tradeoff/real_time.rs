//! Recommendations at a required pace: among the variants that are fast enough, the one with the smallest error.

use serde::Serialize;

use super::advice::{Goal, SAME, Variant};

use super::{Row, Table};
use insonify_base::number::significant;
use insonify_base::pareto::{Choice, choose};

/// Share of the tolerance below which errors count as zero.
pub(super) const NEGLIGIBLE_SHARE: f64 = 0.1;

/// Recurring task with a deadline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Deadline {
    /// Frame of an image.
    Frame,
    /// Step of the mechanics, for haptic feedback.
    Step,
}

/// Required rates of frames and steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Rates {
    /// Frames per second.
    pub frames: f64,
    /// Steps per second.
    pub steps: f64,
}

impl Default for Rates {
    /// Returns a frame rate for displays and a step rate for haptic loops.
    fn default() -> Self {
        Rates {
            frames: 60.0,
            steps: 1000.0,
        }
    }
}

impl Rates {
    /// Returns the time available, ms.
    pub fn ms(&self, beat: Deadline) -> f64 {
        match beat {
            Deadline::Frame => 1e3 / self.frames,
            Deadline::Step => 1e3 / self.steps,
        }
    }
}

/// Recommendation at a required pace.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RealTimeChoice {
    /// Task with the deadline.
    pub beat: Deadline,
    /// Name of the choice.
    pub choosing: String,
    /// Fixed choices that the recommendation applies to; empty if there are none.
    pub given: String,
    /// Recommended variant, with the time that counts towards the pace as its cost, ms.
    pub take: Variant,
    /// Whether the variant is fast enough; if not, it is the fastest.
    pub met: bool,
    /// Unit of the error.
    pub unit: String,
    /// Fastest variant with a smaller error, which is too slow; `None` if there is none.
    pub better: Option<Variant>,
}

impl RealTimeChoice {
    /// Returns the name of the choice, with the fixed choices.
    pub fn what(&self) -> String {
        if self.given.is_empty() {
            self.choosing.clone()
        } else {
            format!("{} ({})", self.choosing, self.given)
        }
    }

    /// Returns the recommended variant, and states if it is too slow.
    pub(crate) fn recommended(&self) -> String {
        if self.met {
            self.take.name.clone()
        } else {
            format!("{}: the fastest, but too slow", self.take.name)
        }
    }

    /// Returns the error of a variant with its unit.
    pub fn off(&self, variant: &Variant) -> String {
        if variant.gold {
            "none (the gold standard)".to_owned()
        } else {
            format!("{} {}", significant(variant.error), self.unit)
                .trim_end()
                .to_owned()
        }
    }

    /// Returns the recommendation on one line, for a terminal.
    pub fn sentence(&self) -> String {
        let [variant, ms] = [self.recommended(), significant(self.take.cost)];
        format!("{}: {variant}: {ms} ms, error {}", self.what(), self.off(&self.take))
    }

    /// Describes the better but slower variant with its cost.
    pub fn beyond(&self) -> String {
        let better = self.better.as_ref();
        better.map_or(String::new(), |variant| {
            format!(
                "{}: {} ms, error {}",
                variant.name,
                significant(variant.cost),
                self.off(variant)
            )
        })
    }
}

impl Table {
    /// Returns recommendations at a pace for each of the given choices; empty if the goal of the table has no pace.
    pub fn in_time(&self, pace: &Rates) -> Vec<RealTimeChoice> {
        let Some((goal, (beat, time))) = self.goal.as_ref().and_then(|goal| Some((goal, goal.every?))) else {
            return Vec::new();
        };
        let goal = Goal {
            cost: time,
            ..goal.clone()
        };
        let groups = self.groups(&goal);
        let choices = groups
            .iter()
            .filter_map(|rows| self.fastest(&goal, rows, beat, pace.ms(beat)));
        choices.collect()
    }

    fn fastest(&self, goal: &Goal, rows: &[&Row], beat: Deadline, limit_ms: f64) -> Option<RealTimeChoice> {
        let (variants, _) = self.variants(goal, rows);
        let error = |variant: &Variant| variant.error.max(NEGLIGIBLE_SHARE * goal.within);
        let Choice { taken, met, better } =
            choose(&variants, limit_ms, SAME, |variant| [variant.cost, error(variant)])?;
        Some(RealTimeChoice {
            beat,
            choosing: self.choosing(goal),
            given: self.given(goal, rows),
            take: taken.clone(),
            met,
            unit: self.unit(goal.error).to_owned(),
            better: better.cloned(),
        })
    }
}

#[cfg(test)]
mod tests;
