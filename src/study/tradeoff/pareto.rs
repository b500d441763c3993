//! Best rows of a table: the Pareto front of the two axes of its goal.

use super::{Goal, Row, Table};
use crate::report::pareto;

impl Table {
    /// Returns whether each row is among the best: no other row under the same given choices and conditions is as good in cost and error
    /// and better in one of them. The gold standard takes part with zero error; flagged rows are excluded. Without a goal no row is best.
    pub fn best(&self) -> Vec<bool> {
        let Some(goal) = &self.goal else {
            return vec![false; self.rows.len()];
        };
        let points: Vec<Option<[f64; 2]>> = self.rows.iter().map(|row| self.weighed(goal, row)).collect();
        let alike: Vec<Vec<&str>> = self.rows.iter().map(|row| self.kind(goal, row)).collect();
        let is_best = |at: usize| {
            let rivals = alike.iter().zip(&points).filter(|(kind, _)| **kind == alike[at]);
            let front = pareto::front(&rivals.filter_map(|(_, point)| *point).collect::<Vec<_>>());
            points[at].is_some_and(|point| front.contains(&point))
        };
        (0..self.rows.len()).map(is_best).collect()
    }

    /// Describes the meaning of the mark of the best rows; empty if no row is marked.
    pub(super) fn meaning_of_best(&self) -> String {
        let Some(goal) = self.goal.as_ref().filter(|_| self.best().contains(&true)) else {
            return String::new();
        };
        let heading = |key: &str| self.axis(key).map_or("", |at| self.axes[at].heading);
        let fixed = goal.each.iter().chain(&goal.over);
        let fixed = fixed.filter_map(|key| Some(self.factors[self.factor(key)?].label));
        let same = match fixed.collect::<Vec<_>>().join(", ") {
            none if none.is_empty() => String::new(),
            some => format!(" with the same {some}"),
        };
        let [cost, error] = [goal.cost, goal.error].map(heading);
        format!("best: no other row{same} has both less \"{cost}\" and less \"{error}\"")
    }

    /// Returns the Pareto fronts of the best rows among those shown, one for each set of competing rows, from left to right.
    pub(super) fn fronts(&self, x: &str, y: &str, shown: impl Fn(&Row) -> bool) -> Vec<Vec<[f64; 2]>> {
        let Some(goal) = self.goal.as_ref().filter(|goal| [goal.cost, goal.error] == [x, y]) else {
            return Vec::new();
        };
        let mut fronts: Vec<(Vec<&str>, Vec<[f64; 2]>)> = Vec::new();
        let best = self
            .rows
            .iter()
            .zip(self.best())
            .filter(|(row, best)| *best && shown(row));
        for (row, _) in best {
            // A gold standard without a measured error cannot be plotted.
            let (Some(across), Some(up)) = (self.value(row, x), self.value(row, y)) else {
                continue;
            };
            let kind = self.kind(goal, row);
            match fronts.iter_mut().find(|(other, _)| *other == kind) {
                Some((_, points)) => points.push([across, up]),
                None => fronts.push((kind, vec![[across, up]])),
            }
        }
        let sorted = fronts.into_iter().map(|(_, mut points)| {
            points.sort_by(|a, b| a[0].total_cmp(&b[0]));
            points
        });
        sorted.collect()
    }

    /// Returns cost and error of a row; `None` if either is unknown or the row is flagged.
    fn weighed(&self, goal: &Goal, row: &Row) -> Option<[f64; 2]> {
        let error = self.value(row, goal.error).or(row.gold.then_some(0.0));
        Some([self.value(row, goal.cost)?, error?]).filter(|_| row.flag.is_none())
    }

    /// Returns the choices that competing rows share.
    fn kind<'a>(&self, goal: &Goal, row: &'a Row) -> Vec<&'a str> {
        self.choices(row, &[&goal.each[..], &goal.over].concat())
    }
}
