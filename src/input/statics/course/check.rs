//! Validation of the history of a problem.

use super::super::file::ProblemFile;
use super::{HistorySpec, MOST_STEPS, Model};
use crate::base::document::InvalidFile;
use crate::input::InputError;

impl ProblemFile {
    /// Checks the tables for the model, and their values.
    pub(in super::super) fn check_course(&self) -> Result<(), InputError> {
        let linear = self.model == Model::Linear;
        let tables = [
            ("solver", self.solver.is_some(), linear),
            ("history", self.history.is_some(), linear),
            ("viscosity", self.viscosity.is_some(), self.model != Model::Viscoelastic),
        ];
        for (table, given, out_of_place) in tables {
            if given && out_of_place {
                let found = format!("[{table}] beside `model = \"{}\"`", self.model.name());
                let expected = if table == "viscosity" {
                    "`model = \"viscoelastic\"`"
                } else {
                    "`model = \"nonlinear\"` or `\"viscoelastic\"`"
                };
                return Err(self.wrong_keys(table, found, expected));
            }
        }
        if self.model == Model::Viscoelastic && self.history.is_none() {
            let expected = "a [history] with `time_s`, `factor` and `step_s`";
            return Err(self.wrong_keys("model", "viscoelastic tissue without a history", expected));
        }
        self.in_ranges("solver", self.solver.as_ref())?;
        self.in_ranges("viscosity", self.viscosity.as_ref())?;
        let course = self.course();
        self.check_times(&course)?;
        self.factors("history.factor", &course.factor, &course)?;
        let own = |table: &str, at: usize| format!("{table}[{at}].factor");
        for (at, factor) in self.fix.iter().map(|fix| &fix.factor).enumerate() {
            self.own_factors(own("fix", at), factor.as_deref(), &course)?;
        }
        for (at, factor) in self.load.iter().map(|load| &load.factor).enumerate() {
            self.own_factors(own("load", at), factor.as_deref(), &course)?;
        }
        Ok(())
    }

    /// Returns the history, or the default one.
    pub(in super::super) fn course(&self) -> HistorySpec {
        self.history.clone().unwrap_or_default()
    }

    fn own_factors(&self, key: String, factors: Option<&[f64]>, course: &HistorySpec) -> Result<(), InputError> {
        match factors {
            None => Ok(()),
            Some(_) if self.history.is_none() => {
                Err(self.wrong_keys(key, "`factor` without a [history]", "a [history] with its `time_s`"))
            }
            Some(factors) => self.factors(&key, factors, course),
        }
    }

    fn factors(&self, key: &str, factors: &[f64], course: &HistorySpec) -> Result<(), InputError> {
        if factors.len() != course.time_s.len() {
            let found = format!("{} factors", factors.len());
            let expected = format!("one for each of the {} times", course.time_s.len());
            return Err(self.wrong_keys(key, found, expected));
        }
        self.list(key, factors, |_, factor| factor.is_finite(), "a finite number")
    }

    fn check_times(&self, course: &HistorySpec) -> Result<(), InputError> {
        let times = &course.time_s;
        if times.len() < 2 {
            let found = format!("{} times", times.len());
            return Err(self.wrong_keys("history.time_s", found, "two or more"));
        }
        let right = |at: usize, time: f64| match at {
            0 => time == 0.0,
            _ => time.is_finite() && time > times[at - 1],
        };
        self.list("history.time_s", times, right, "0 first, then ascending finite times")?;
        let step = course.step_s;
        let expected = "a time above 0, for 100000 steps at most";
        let steps: f64 = times.windows(2).map(|pair| ((pair[1] - pair[0]) / step).ceil()).sum();
        if !(step > 0.0 && step.is_finite() && steps <= MOST_STEPS as f64) {
            return Err(self.fault("history.step_s", InvalidFile::number(step, expected)));
        }
        Ok(())
    }

    fn list(
        &self,
        key: &str,
        numbers: &[f64],
        right: impl Fn(usize, f64) -> bool,
        expected: &'static str,
    ) -> Result<(), InputError> {
        match numbers.iter().enumerate().find(|(at, number)| !right(*at, **number)) {
            Some((at, &found)) => Err(self.fault(format!("{key}[{at}]"), InvalidFile::number(found, expected))),
            None => Ok(()),
        }
    }
}
