//! What to take where frames or steps must keep a pace: of the ways that are fast enough, the one that errs least.

use serde::{Deserialize, Serialize};

use super::advice::{Goal, SAME, Way};
use super::render::number;
use super::{Row, Table};

/// Share of the tolerance below which errors count as zero.
pub(super) const NOTHING: f64 = 0.1;

/// What must be done again and again, in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Beat {
    /// A frame of an image.
    Frame,
    /// A step of the mechanics, which a hand feels.
    Step,
}

/// How often frames and steps are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pace {
    /// Frames a second.
    pub frames: f64,
    /// Steps a second.
    pub steps: f64,
}

impl Default for Pace {
    /// Frames as a screen shows them, steps as a haptic loop wants them.
    fn default() -> Self {
        Pace {
            frames: 60.0,
            steps: 1000.0,
        }
    }
}

impl Pace {
    /// The time that there is, ms.
    pub fn ms(&self, beat: Beat) -> f64 {
        match beat {
            Beat::Frame => 1e3 / self.frames,
            Beat::Step => 1e3 / self.steps,
        }
    }
}

/// What to take where time is given.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InTime {
    /// What must be in time.
    pub beat: Beat,
    /// What is chosen.
    pub choosing: String,
    /// Under which given choices; empty where there are none.
    pub given: String,
    /// What to take: its cost is the time that must keep to the pace, ms.
    pub take: Way,
    /// Whether it is fast enough; if not, it is the fastest.
    pub met: bool,
    /// Unit of the error.
    pub unit: String,
    /// The fastest of those that err less, where any do: it takes too long.
    pub better: Option<Way>,
}

impl InTime {
    /// What is chosen, under what.
    pub fn what(&self) -> String {
        match self.given.is_empty() {
            true => self.choosing.clone(),
            false => format!("{} ({})", self.choosing, self.given),
        }
    }

    /// The way to take, and whether it is too slow.
    pub fn way(&self) -> String {
        match self.met {
            true => self.take.name.clone(),
            false => format!("{}: the fastest, but too slow", self.take.name),
        }
    }

    /// Error of an option, with the unit.
    pub fn off(&self, way: &Way) -> String {
        match way.gold {
            true => "none (the gold standard)".to_owned(),
            false => format!("{} {}", number(way.error), self.unit).trim_end().to_owned(),
        }
    }

    /// All of it but what is better, for a terminal.
    pub fn sentence(&self) -> String {
        let [way, ms] = [self.way(), number(self.take.cost)];
        format!("{}: {way}: {ms} ms, error {}", self.what(), self.off(&self.take))
    }

    /// What errs less, and costs what.
    pub fn beyond(&self) -> String {
        let better = self.better.as_ref();
        better.map_or(String::new(), |way| {
            format!("{}: {} ms, error {}", way.name, number(way.cost), self.off(way))
        })
    }
}

impl Table {
    /// What to take at a pace, for each of the choices that are given; nothing where the goal of the table knows no pace.
    pub fn in_time(&self, pace: &Pace) -> Vec<InTime> {
        let Some((goal, (beat, time))) = self.goal.as_ref().and_then(|goal| Some((goal, goal.every?))) else {
            return Vec::new();
        };
        let goal = Goal {
            cost: time,
            ..goal.clone()
        };
        let groups = self.groups(&goal);
        let found = groups
            .iter()
            .filter_map(|rows| self.fastest(&goal, rows, beat, pace.ms(beat)));
        found.collect()
    }

    fn fastest(&self, goal: &Goal, rows: &[&Row], beat: Beat, limit_ms: f64) -> Option<InTime> {
        let (ways, _) = self.ways(goal, rows);
        let error = |way: &Way| way.error.max(NOTHING * goal.within);
        let by_error = |a: &&Way, b: &&Way| error(a).total_cmp(&error(b)).then(a.cost.total_cmp(&b.cost));
        let by_time = |a: &&Way, b: &&Way| a.cost.total_cmp(&b.cost);
        let within = ways.iter().filter(|way| way.cost <= limit_ms).min_by(by_error);
        let take = within.or_else(|| ways.iter().min_by(by_time))?;
        let better = ways
            .iter()
            .filter(|way| SAME * error(way) < error(take))
            .min_by(by_time);
        Some(InTime {
            beat,
            choosing: self.choosing(goal),
            given: self.given(goal, rows),
            take: take.clone(),
            met: within.is_some(),
            unit: self.unit(goal.error).to_owned(),
            better: better.cloned(),
        })
    }
}

#[cfg(test)]
mod tests;
