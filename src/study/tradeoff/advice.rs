//! Recommendations from a table: the cheapest variant whose error a user would not notice; and its best rows, the
//! Pareto front.
//!
//! This module is independent of what a study compares. Rows that differ only in conditions form one variant: it counts
//! with its worst cost and error (among variants of equal cost the one with the smallest error is taken), and only if
//! it was measured under all conditions that occur.

use serde::Serialize;

use super::real_time::Deadline;
use super::{Row, Table};
use insonify_base::number::significant;
use insonify_base::pareto;

/// Tolerance for positions in an image, mm, with its reason.
pub(crate) const SHIFT_MM: (f64, &str) = (0.1, "a third of a pixel at 150 mm in 512 rows");
/// Tolerance for forces on a hand, N, with its reason.
pub(crate) const FORCE_N: (f64, &str) = (0.1, "less than a hand notices beside 1 to 2 N");

/// Tolerance for grey levels, with its reason.
pub(crate) const GREY_LEVELS: (f64, &str) = (5.0, "the eye sees less than that only side by side");

/// Factor within which costs or errors count as equal.
pub(super) const SAME: f64 = 1.05;

/// Goal of a user who chooses from a table.
#[derive(Clone, Debug, Default, PartialEq)]
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
    pub every: Option<(Deadline, &'static str)>,
}

/// Recommendation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advice {
    /// Choice, in words.
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
    /// Creates a goal: the cheapest variant within a tolerance given with its reason, such as `SHIFT_MM`.
    pub fn new(cost: &'static str, error: &'static str, (limit, reason): (f64, &'static str)) -> Self {
        Goal {
            cost,
            error,
            within: limit,
            reason,
            ..Goal::default()
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
    pub(crate) fn baseline(mut self, factor: &'static str, choice: &'static str, reason: &'static str) -> Self {
        self.baseline = Some((factor, choice, reason));
        self
    }

    /// Declares a task done in every frame or step, with its time on this axis, ms.
    pub(crate) fn in_every(mut self, beat: Deadline, time: &'static str) -> Self {
        self.every = Some((beat, time));
        self
    }

    /// Sets the factors under all of whose choices a variant must be suitable.
    pub fn over(mut self, factors: &[&'static str]) -> Self {
        self.over = factors.to_vec();
        self
    }

    /// Returns the factors whose choices competing rows share.
    fn fixed(&self) -> Vec<&'static str> {
        [&self.each[..], &self.over].concat()
    }
}

impl Advice {
    /// Returns the recommendation in words, preceded by the fixed choices.
    pub fn sentence(&self) -> String {
        if self.given.is_empty() {
            self.words.clone()
        } else {
            format!("{}: {}", self.given, self.words)
        }
    }
}

/// Variant, aggregated over all conditions.
#[derive(Clone, Debug, PartialEq, Serialize)]
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

    /// Groups rows by their choices of some factors.
    fn grouped<'a>(&'a self, rows: impl Iterator<Item = &'a Row>, keys: &[&str]) -> Vec<Vec<&'a Row>> {
        let mut groups: Vec<(Vec<&str>, Vec<&Row>)> = Vec::new();
        for row in rows {
            let choices = self.choices(row, keys);
            match groups.iter_mut().find(|(group_choices, _)| *group_choices == choices) {
                Some((_, rows)) => rows.push(row),
                None => groups.push((choices, vec![row])),
            }
        }
        groups.into_iter().map(|(_, rows)| rows).collect()
    }

    /// Groups the rows by the given choices.
    pub(super) fn groups(&self, goal: &Goal) -> Vec<Vec<&Row>> {
        self.grouped(self.rows.iter(), &goal.each)
    }

    /// Returns whether each row is among the best: no other row under the same given choices and conditions is as good
    /// in cost and error and better in one of them. The gold standard takes part with zero error; flagged rows are
    /// excluded. Without a goal no row is best.
    pub fn best(&self) -> Vec<bool> {
        let Some(goal) = &self.goal else {
            return vec![false; self.rows.len()];
        };
        let weighed = |row: &Row| {
            let error = self.value(row, goal.error).or(row.gold.then_some(0.0));
            Some([self.value(row, goal.cost)?, error?]).filter(|_| row.flag.is_none())
        };
        let fixed = goal.fixed();
        let is_best = |row: &Row| {
            let conditions = self.choices(row, &fixed);
            let rivals = self
                .rows
                .iter()
                .filter(|rival| self.choices(rival, &fixed) == conditions);
            let front = pareto::front(&rivals.filter_map(weighed).collect::<Vec<_>>());
            weighed(row).is_some_and(|point| front.contains(&point))
        };
        self.rows.iter().map(is_best).collect()
    }

    /// Describes the meaning of the mark of the best rows; empty if no row is marked.
    pub(super) fn meaning_of_best(&self) -> String {
        let Some(goal) = self.goal.as_ref().filter(|_| self.best().contains(&true)) else {
            return String::new();
        };
        let heading = |key: &str| self.axis(key).map_or("", |index| self.axes[index].heading);
        let fixed_keys = goal.fixed();
        let fixed_choices = fixed_keys
            .iter()
            .filter_map(|key| Some(self.factors[self.factor(key)?].label));
        let same = match fixed_choices.collect::<Vec<_>>().join(", ") {
            none if none.is_empty() => none,
            some => format!(" with the same {some}"),
        };
        let [cost, error] = [goal.cost, goal.error].map(heading);
        format!("best: no other row{same} has both less \"{cost}\" and less \"{error}\"")
    }

    /// Returns the Pareto fronts of the best rows among those shown, one for each set of competing rows, from left to
    /// right.
    pub(super) fn fronts(&self, x: &str, y: &str, is_shown: impl Fn(&Row) -> bool) -> Vec<Vec<[f64; 2]>> {
        let Some(goal) = self.goal.as_ref().filter(|goal| [goal.cost, goal.error] == [x, y]) else {
            return Vec::new();
        };
        // A gold standard without a measured error cannot be plotted.
        let point = |row: &Row| Some([self.value(row, x)?, self.value(row, y)?]);
        let best = self.rows.iter().zip(self.best());
        let best = best.filter(|(row, best)| *best && is_shown(row) && point(row).is_some());
        let fronts = self
            .grouped(best.map(|(row, _)| row), &goal.fixed())
            .into_iter()
            .map(|rows| {
                let mut points: Vec<[f64; 2]> = rows.into_iter().filter_map(point).collect();
                points.sort_by(|a, b| a[0].total_cmp(&b[0]));
                points
            });
        fronts.collect()
    }

    /// Returns the name of the choice.
    pub(super) fn choosing(&self, goal: &Goal) -> String {
        match goal.choosing {
            "" => self.title.clone(),
            choosing => choosing.to_owned(),
        }
    }

    /// Describes the given choices that the rows share.
    pub(super) fn given(&self, goal: &Goal, rows: &[&Row]) -> String {
        let first_row = rows.first();
        first_row.map_or(String::new(), |row| self.name(row, |key| goal.each.contains(&key)))
    }

    /// Returns the unit of an axis; empty if there is none.
    pub(super) fn unit(&self, key: &str) -> &'static str {
        self.axis(key).map_or("", |index| self.axes[index].unit())
    }

    fn advise(&self, goal: &Goal, rows: &[&Row]) -> Advice {
        let (variants, wrong) = self.variants(goal, rows);
        let (cost_unit, error_unit) = (self.unit(goal.cost), self.unit(goal.error));
        let cost = |variant: &Variant| {
            format!("{} {cost_unit}", significant(variant.cost))
                .trim_end()
                .to_owned()
        };
        let described = |variant: &Variant| {
            let error = format!("{} {error_unit}", significant(variant.error));
            format!("{}: {}, error {}", variant.name, cost(variant), error.trim_end())
        };
        let limit = format!("{} {error_unit} ({})", goal.within, goal.reason);
        let by_error = |a: &&Variant, b: &&Variant| a.error.total_cmp(&b.error);
        let fitting = || variants.iter().filter(|variant| variant.error <= goal.within);
        let least = fitting().map(|variant| variant.cost).fold(f64::INFINITY, f64::min);
        // Among equal costs the error decides, not the noise of the clock.
        let alike = fitting().filter(|variant| variant.cost <= SAME * least);
        let take = alike.min_by(|a, b| by_error(a, b).then(a.cost.total_cmp(&b.cost)));
        let mut words = match (take, variants.iter().min_by(by_error)) {
            (Some(take), _) if take.gold => format!(
                "Recommended: {} (the gold standard): {}. Nothing cheaper has an error within {limit}.",
                take.name,
                cost(take)
            ),
            (Some(take), _) => format!("Recommended: {}; the cheapest within {limit}.", described(take)),
            (None, Some(near)) => format!(
                "No option has an error within {limit}. The closest is {}.",
                described(near)
            ),
            (None, None) => "Nothing could be compared.".to_owned(),
        };
        if let Some(take) = take {
            let cheaper = variants
                .iter()
                .filter(|variant| SAME * variant.cost < take.cost && variant.error > goal.within);
            if let Some(next) = cheaper.min_by(by_error) {
                words += &format!(" Cheaper: {}.", described(next));
            }
            if let Some(gold) = variants.iter().find(|variant| variant.gold).filter(|_| !take.gold) {
                words += &format!(" The gold standard takes {}.", cost(gold));
            }
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
    pub(super) fn variants(&self, goal: &Goal, rows: &[&Row]) -> (Vec<Variant>, usize) {
        let conditions = self.conditions(goal, rows);
        let name = |row: &Row| self.name(row, |key| !goal.fixed().contains(&key));
        let advised = |row: &Row| {
            let baseline = goal.baseline;
            baseline.is_none_or(|(key, choice, _)| self.factor(key).is_none_or(|index| row.choices[index] != choice))
        };
        let mut names: Vec<String> = Vec::new();
        for name in rows.iter().filter(|row| advised(row)).map(|row| name(row)) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let variant = |wanted: String| {
            let alike: Vec<&Row> = rows.iter().copied().filter(|row| name(row) == wanted).collect();
            let largest = |key: &str, gold: Option<f64>| {
                let index = self.axis(key)?;
                let values = alike.iter().map(|row| {
                    if row.gold {
                        gold.or(row.values[index])
                    } else {
                        row.values[index]
                    }
                });
                values.reduce(|a, b| Some(a?.max(b?))).flatten()
            };
            // A variant that lacks a condition, or fails in one, would look better than it is.
            let complete = self.conditions(goal, &alike) == conditions && alike.iter().all(|row| row.flag.is_none());
            complete.then_some(())?;
            Some(Variant {
                cost: largest(goal.cost, None)?,
                error: largest(goal.error, Some(0.0))?,
                gold: alike.iter().all(|row| row.gold),
                name: wanted,
            })
        };
        let wrong = rows.iter().filter(|row| row.flag.is_some()).count();
        (names.into_iter().filter_map(variant).collect(), wrong)
    }

    /// Returns the distinct combinations of conditions.
    fn conditions<'a>(&self, goal: &Goal, rows: &[&'a Row]) -> Vec<Vec<&'a str>> {
        let mut combinations: Vec<Vec<&str>> = rows.iter().map(|row| self.choices(row, &goal.over)).collect();
        combinations.sort_unstable();
        combinations.dedup();
        combinations
    }

    /// Returns the choices of a row for some factors.
    pub(super) fn choices<'a>(&self, row: &'a Row, keys: &[&str]) -> Vec<&'a str> {
        let positions = keys.iter().filter_map(|key| self.factor(key));
        positions.map(|index| row.choices[index].as_str()).collect()
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
