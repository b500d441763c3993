//! Recommendations from a table: the cheapest variant whose error a user would not notice.
//!
//! This module is independent of what a study compares. Rows that differ only in conditions form one variant: it counts with its worst cost
//! and error (among variants of equal cost the one with the smallest error is taken), and only if it was measured under all conditions that
//! occur.

use serde::{Deserialize, Serialize};

use super::real_time::Beat;
use super::{Row, Table};
use crate::report::number::significant;

/// Tolerance for positions in an image, mm, with its reason.
pub const SHIFT_MM: (f64, &str) = (0.1, "a third of a pixel at 150 mm in 512 rows");
/// Tolerance for forces on a hand, N, with its reason.
pub const FORCE_N: (f64, &str) = (0.1, "less than a hand notices beside 1 to 2 N");

/// Tolerance for grey levels, with its reason.
pub const GREY_LEVELS: (f64, &str) = (5.0, "the eye sees less than that only side by side");

/// Factor within which costs or errors count as equal.
pub(super) const SAME: f64 = 1.05;

/// Goal of a user who chooses from a table.
#[derive(Clone, Debug, PartialEq)]
pub struct Goal {
    /// Key of the axis to minimise.
    pub cost: &'static str,
    /// Key of the error axis.
    pub error: &'static str,
    /// Tolerance, in the unit of the error axis.
    pub within: f64,
    /// Reason for the tolerance.
    pub reason: &'static str,
    /// Short name of the choice; if empty, the title of the table is used.
    pub choosing: &'static str,
    /// Keys of axes shown beside those two, such as the spread of the cost, or memory.
    pub beside: Vec<&'static str>,
    /// Keys of given factors, such as the size of a mesh: each combination of their choices gets separate advice.
    pub each: Vec<&'static str>,
    /// Keys of condition factors: a variant must be suitable under all of their choices.
    pub over: Vec<&'static str>,
    /// Factor, choice and reason of a baseline that is only shown for comparison and never recommended.
    pub baseline: Option<(&'static str, &'static str, &'static str)>,
    /// Recurring task, and key of the axis with its time, ms; `None` for a task done once.
    pub every: Option<(Beat, &'static str)>,
}

/// Recommendation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Advice {
    /// Name of the choice.
    pub choosing: String,
    /// Fixed choices that the recommendation applies to; empty if there are none.
    pub given: String,
    /// Recommended variant; `None` if no variant meets the goal.
    pub take: Option<Variant>,
    /// Units of cost and error; empty where there is none.
    pub units: [String; 2],
    /// Recommendation in words.
    pub words: String,
}

impl Goal {
    /// Creates a goal: the cheapest variant within a tolerance given with its reason, such as [`SHIFT_MM`].
    pub fn new(cost: &'static str, error: &'static str, (within, reason): (f64, &'static str)) -> Self {
        Goal {
            cost,
            error,
            within,
            reason,
            choosing: "",
            beside: Vec::new(),
            each: Vec::new(),
            over: Vec::new(),
            baseline: None,
            every: None,
        }
    }

    /// Sets the short name of the choice.
    pub fn choosing(mut self, what: &'static str) -> Self {
        self.choosing = what;
        self
    }

    /// Sets the axes shown beside cost and error.
    pub fn beside(mut self, axes: &[&'static str]) -> Self {
        self.beside = axes.to_vec();
        self
    }

    /// Sets the factors with separate advice for each of their choices.
    pub fn each(mut self, factors: &[&'static str]) -> Self {
        self.each = factors.to_vec();
        self
    }

    /// Marks a choice of a factor as a baseline, which is not recommended for the given reason.
    pub fn baseline(mut self, factor: &'static str, choice: &'static str, reason: &'static str) -> Self {
        self.baseline = Some((factor, choice, reason));
        self
    }

    /// Declares a task done in every frame or step, with its time on this axis, ms.
    pub fn in_every(mut self, beat: Beat, time: &'static str) -> Self {
        self.every = Some((beat, time));
        self
    }

    /// Sets the factors under all of whose choices a variant must be suitable.
    pub fn over(mut self, factors: &[&'static str]) -> Self {
        self.over = factors.to_vec();
        self
    }
}

impl Advice {
    /// Returns the recommendation in words, preceded by the fixed choices.
    pub fn sentence(&self) -> String {
        match self.given.is_empty() {
            true => self.words.clone(),
            false => format!("{}: {}", self.given, self.words),
        }
    }
}

/// Variant, aggregated over all conditions.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Variant {
    /// Choices that identify the variant.
    pub name: String,
    /// Largest cost over the conditions.
    pub cost: f64,
    /// Largest error over the conditions.
    pub error: f64,
    /// Whether the variant is the gold standard.
    pub gold: bool,
}

impl Table {
    /// Returns recommendations according to the goal of the table; empty without a goal.
    pub fn advice(&self) -> Vec<Advice> {
        let Some(goal) = &self.goal else { return Vec::new() };
        let groups = self.groups(goal);
        groups.iter().map(|rows| self.advise(goal, rows)).collect()
    }

    /// Groups the rows by the given choices.
    pub(super) fn groups(&self, goal: &Goal) -> Vec<Vec<&Row>> {
        let mut groups: Vec<(Vec<&str>, Vec<&Row>)> = Vec::new();
        for row in &self.rows {
            let own = self.choices(row, &goal.each);
            match groups.iter_mut().find(|(given, _)| *given == own) {
                Some((_, rows)) => rows.push(row),
                None => groups.push((own, vec![row])),
            }
        }
        groups.into_iter().map(|(_, rows)| rows).collect()
    }

    /// Returns the name of the choice.
    pub(super) fn choosing(&self, goal: &Goal) -> String {
        match goal.choosing.is_empty() {
            true => self.title.clone(),
            false => goal.choosing.to_owned(),
        }
    }

    /// Describes the given choices that the rows share.
    pub(super) fn given(&self, goal: &Goal, rows: &[&Row]) -> String {
        let first = rows.first();
        first.map_or(String::new(), |row| self.name(row, |key| goal.each.contains(&key)))
    }

    /// Returns the unit of an axis; empty if there is none.
    pub(super) fn unit(&self, key: &str) -> &'static str {
        self.axis(key).map_or("", |at| self.axes[at].unit())
    }

    fn advise(&self, goal: &Goal, rows: &[&Row]) -> Advice {
        let (ways, wrong) = self.ways(goal, rows);
        let (cost_unit, error_unit) = (self.unit(goal.cost), self.unit(goal.error));
        let cost = |way: &Variant| format!("{} {cost_unit}", significant(way.cost)).trim_end().to_owned();
        let error = |error: f64| format!("{} {error_unit}", significant(error)).trim_end().to_owned();
        let limit = format!("{} {error_unit} ({})", goal.within, goal.reason);
        let fits = |way: &&Variant| way.error <= goal.within;
        let order = |a: &&Variant, b: &&Variant| a.error.total_cmp(&b.error).then(a.cost.total_cmp(&b.cost));
        let least = ways
            .iter()
            .filter(fits)
            .map(|way| way.cost)
            .fold(f64::INFINITY, f64::min);
        // Among equal costs the error decides, not the noise of the clock.
        let alike = |way: &&Variant| way.cost <= SAME * least;
        let take = ways.iter().filter(fits).filter(alike).min_by(order);
        let cheaper = ways
            .iter()
            .filter(|way| take.is_some_and(|take| SAME * way.cost < take.cost) && way.error > goal.within);
        let nearest =
            |ways: &mut dyn Iterator<Item = &Variant>| ways.min_by(|a, b| a.error.total_cmp(&b.error)).cloned();
        let mut words = match take {
            Some(take) if take.gold => format!(
                "Recommended: {} (the gold standard): {}. Nothing cheaper has an error within {limit}.",
                take.name,
                cost(take)
            ),
            Some(take) => format!(
                "Recommended: {}: {}, error {}; the cheapest within {limit}.",
                take.name,
                cost(take),
                error(take.error)
            ),
            None => match nearest(&mut ways.iter()) {
                Some(near) => format!(
                    "No option has an error within {limit}. The closest is {}: {}, error {}.",
                    near.name,
                    cost(&near),
                    error(near.error)
                ),
                None => "Nothing could be compared.".to_owned(),
            },
        };
        if let Some(next) = nearest(&mut { cheaper }) {
            words += &format!(" Cheaper: {}: {}, error {}.", next.name, cost(&next), error(next.error));
        }
        let gold = ways.iter().find(|way| way.gold);
        if let Some(gold) = gold.filter(|_| take.is_some_and(|take| !take.gold)) {
            words += &format!(" The gold standard takes {}.", cost(gold));
        }
        if let Some((_, choice, reason)) = goal.baseline {
            words += &format!(" {choice} is a baseline and never recommended: {reason}.");
        }
        match wrong {
            0 => {}
            1 => words += " One row is marked WRONG and left out.",
            _ => words += &format!(" {wrong} rows are marked WRONG and left out."),
        }
        Advice {
            choosing: self.choosing(goal),
            given: self.given(goal, rows),
            take: take.cloned(),
            units: [cost_unit, error_unit].map(str::to_owned),
            words,
        }
    }

    /// Aggregates rows into variants; returns them with the number of flagged rows.
    pub(super) fn ways(&self, goal: &Goal, rows: &[&Row]) -> (Vec<Variant>, usize) {
        let fixed = |key: &&str| goal.each.contains(key) || goal.over.contains(key);
        let all = self.conditions(goal, rows);
        let name = |row: &Row| self.name(row, |key| !fixed(&key));
        let mut names: Vec<String> = Vec::new();
        let advised = |row: &Row| {
            let baseline = goal
                .baseline
                .and_then(|(key, choice, _)| Some((self.factor(key)?, choice)));
            baseline.is_none_or(|(at, choice)| row.choices[at] != choice)
        };
        for row in rows.iter().filter(|row| advised(row)) {
            let name = name(row);
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let way = |wanted: String| {
            let own: Vec<&Row> = rows.iter().copied().filter(|row| name(row) == wanted).collect();
            let most = |key: &str, gold: Option<f64>| {
                let at = self.axis(key)?;
                let values = own.iter().map(|row| match row.gold {
                    true => gold.or(row.values[at]),
                    false => row.values[at],
                });
                values.reduce(|a, b| Some(a?.max(b?))).flatten()
            };
            let complete = self.conditions(goal, &own) == all && own.iter().all(|row| row.flag.is_none());
            complete.then_some(())?;
            Some(Variant {
                cost: most(goal.cost, None)?,
                error: most(goal.error, Some(0.0))?,
                gold: own.iter().all(|row| row.gold),
                name: wanted,
            })
        };
        let wrong = rows.iter().filter(|row| row.flag.is_some()).count();
        (names.into_iter().filter_map(way).collect(), wrong)
    }

    /// Returns the distinct combinations of conditions.
    fn conditions<'a>(&self, goal: &Goal, rows: &[&'a Row]) -> Vec<Vec<&'a str>> {
        let mut found: Vec<Vec<&str>> = rows.iter().map(|row| self.choices(row, &goal.over)).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Returns the choices of a row for some factors.
    pub(super) fn choices<'a>(&self, row: &'a Row, keys: &[&str]) -> Vec<&'a str> {
        let found = keys.iter().filter_map(|key| self.factor(key));
        found.map(|at| row.choices[at].as_str()).collect()
    }

    /// Describes choices of a row, each by [`Factor::name`].
    fn name(&self, row: &Row, wanted: impl Fn(&'static str) -> bool) -> String {
        let pairs = self.factors.iter().zip(&row.choices);
        let words = pairs.filter(|(factor, _)| wanted(factor.key));
        let words = words.map(|(factor, choice)| factor.name(choice));
        words.collect::<Vec<_>>().join("; ")
    }
}

#[cfg(test)]
mod tests;
