//! Problem-file tables of models with a history: model, solver, and time course of loads.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::file::ProblemFile;
use insonify_base::document::{InputError, InvalidFile, word};
use insonify_base::range::{ByKind, Kind, parameters};
use insonify_mechanics::tissue::nonlinear::creep::Memory;
use insonify_mechanics::tissue::nonlinear::{Scheme, Slope, SolverOptions};
use insonify_mechanics::tissue::viscoelastic::point::Method;
use insonify_mechanics::tissue::viscoelastic::{Rule, Span};

/// Maximum number of steps of a history.
pub const MAX_STEPS: usize = 100_000;

/// Tissue model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Linear elastic: one solution for all loads.
    #[default]
    Linear,
    /// Stiffening above a knee strain: `knee_strain` and `stiffening` of a material, with loads in increments.
    Nonlinear,
    /// Stiffening as in `nonlinear`, with viscosity of fractional order.
    Viscoelastic,
}

impl Kind for Model {
    fn stated_as(self) -> String {
        format!("`model = {}`", word(&self))
    }
}

parameters! {
    /// Solver of a nonlinear problem.
    #[derive(Copy)]
    pub struct SolverSpec {
        /// Solution scheme. Default `newton`.
        scheme: SchemeName;
        /// Convergence tolerance: largest residual force over the largest force. Euler steps have none.
        tolerance: f64 = 1e-9, above 0..1;
        /// Maximum number of iterations of a step.
        iterations: u32 = 60, in 1..=1000;
    }
}

/// Solution scheme.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SchemeName {
    /// One solve per step with Kobayashi et al.'s scalar tangent, without iterations: the error falls with
    /// `step_s`.
    Euler,
    /// Modified Newton: the factorisation is reused while it converges.
    ModifiedNewton,
    /// Newton: the consistent tangent is factorised in each iteration.
    #[default]
    Newton,
}

parameters! {
    /// The viscosity of tissue.
    #[derive(Copy)]
    pub struct ViscositySpec {
        /// Order k of the derivative: 0 is elastic, 1 viscous, 0.1 porcine liver. Moduli are in kPa s^k.
        order: f64 = 0.1, in 0..=1;
        /// Memory variable. Default `load-integral`.
        #[serde(alias = "law")]
        memory: Memory;
        /// Quadrature of the history. Default `exponentials`.
        rule: Method;
    }
}

/// Time course of loads and prescribed displacements.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HistorySpec {
    /// Times, s: the first 0, ascending.
    pub time_s: Vec<f64>,
    /// Factors on every load and displacement at these times, linear between. A `[[load]]` or `[[fix]]` may have its
    /// own.
    pub factor: Vec<f64>,
    /// Longest time step, s (above 0).
    pub step_s: f64,
}

/// Without a history, loads grow from zero in ten steps.
impl Default for HistorySpec {
    fn default() -> Self {
        HistorySpec {
            time_s: vec![0.0, 1.0],
            factor: vec![0.0, 1.0],
            step_s: 0.1,
        }
    }
}

/// A moment of a history: its time, and its position between the given times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Time, s from the start of the history.
    pub time_s: f64,
    /// Index of the given time that begins its interval, from 0.
    pub after: usize,
    /// Position in the interval, from 0 at its start to 1 at its end.
    pub share: f64,
}

impl Moment {
    /// Factor at this moment.
    pub fn factor(&self, factors: &[f64]) -> f64 {
        let (low, high) = (factors[self.after], factors[self.after + 1]);
        low + self.share * (high - low)
    }
}

impl HistorySpec {
    /// Initial moment, and the end of each step.
    pub(crate) fn moments(&self) -> Vec<Moment> {
        let mut moments = vec![Moment {
            time_s: self.time_s[0],
            after: 0,
            share: 0.0,
        }];
        for (after, pair) in self.time_s.windows(2).enumerate() {
            let length = pair[1] - pair[0];
            let steps = self.steps(length);
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                let time_s = if step == steps {
                    pair[1]
                } else {
                    pair[0] + share * length
                };
                moments.push(Moment { time_s, after, share });
            }
        }
        moments
    }

    fn steps(&self, length: f64) -> usize {
        // A length that is a whole number of steps up to rounding takes that number.
        ((length / self.step_s * (1.0 - 1e-12)).ceil() as usize).max(1)
    }
}

impl SolverSpec {
    /// Settings in the form that the solver takes.
    pub(crate) fn options(&self) -> SolverOptions {
        SolverOptions {
            scheme: self.scheme.into(),
            tolerance: self.tolerance,
            iterations: self.iterations as usize,
        }
    }
}

impl From<SchemeName> for Scheme {
    fn from(name: SchemeName) -> Scheme {
        match name {
            SchemeName::Euler => Scheme::Euler {
                slope: Slope::Scalar,
                corrected: false,
            },
            SchemeName::ModifiedNewton => Scheme::MODIFIED,
            SchemeName::Newton => Scheme::Newton,
        }
    }
}

impl ViscositySpec {
    /// Quadrature rule for steps between these moments.
    pub(crate) fn rule(&self, moments: &[Moment]) -> Rule {
        match self.rule {
            Method::Rectangle => Rule::Rectangle,
            Method::TimeScaledTrapezoid => Rule::TimeScaledTrapezoid,
            Method::Trapezoid => Rule::Trapezoid,
            Method::GruenwaldLetnikov => Rule::GruenwaldLetnikov,
            Method::Exponentials => {
                let steps = moments.windows(2).map(|pair| pair[1].time_s - pair[0].time_s);
                Rule::Exponentials(Span {
                    // Slack for rounding of the times.
                    shortest_s: 0.999 * steps.fold(f64::INFINITY, f64::min),
                    longest_s: 1.001 * moments[moments.len() - 1].time_s,
                    ..Span::default()
                })
            }
        }
    }
}

impl ProblemFile {
    /// Checks the tables for the model, and their values.
    pub(crate) fn check_course(&self) -> Result<(), InputError> {
        if let Some((table, expected)) = self.misplaced(self.model) {
            let found = format!("`{table}` with {}", self.model.stated_as());
            return Err(self.wrong_keys(table, found, expected));
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
        let factor_key = |table: &str, index: usize| format!("{table}[{index}].factor");
        for (index, factor) in self.fix.iter().map(|fix| &fix.factor).enumerate() {
            self.table_factors(factor_key("fix", index), factor.as_deref(), &course)?;
        }
        for (index, factor) in self.load.iter().map(|load| &load.factor).enumerate() {
            self.table_factors(factor_key("load", index), factor.as_deref(), &course)?;
        }
        Ok(())
    }

    /// Returns the history, or the default one.
    pub(crate) fn course(&self) -> HistorySpec {
        self.history.clone().unwrap_or_default()
    }

    fn table_factors(&self, key: String, factors: Option<&[f64]>, course: &HistorySpec) -> Result<(), InputError> {
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
        let is_valid = |index: usize, time: f64| match index {
            0 => time == 0.0,
            _ => time.is_finite() && time > times[index - 1],
        };
        self.list(
            "history.time_s",
            times,
            is_valid,
            "0 first, then ascending finite times",
        )?;
        let step = course.step_s;
        let expected = "a time above 0, for 100000 steps at most";
        let steps: f64 = times.windows(2).map(|pair| ((pair[1] - pair[0]) / step).ceil()).sum();
        if !(step > 0.0 && step.is_finite() && steps <= MAX_STEPS as f64) {
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
        match numbers
            .iter()
            .enumerate()
            .find(|(index, number)| !right(*index, **number))
        {
            Some((index, &found)) => Err(self.fault(format!("{key}[{index}]"), InvalidFile::number(found, expected))),
            None => Ok(()),
        }
    }
}
