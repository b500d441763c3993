//! Response of a material point to a history that is linear between given times.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::body::{Line, Memory};
use super::{Control, Point, Structure, balance, check};
use crate::tissue::viscoelastic::{HistoryError, Rule, Span};
use insonify_base::range::OutOfRange;

/// Quadrature of the history.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Product rectangle: integrand constant over a step, order 1.
    Rectangle,
    /// Time-scaled trapezoid of Ma and Hori 2004: integrand constant over a step, the mean of its ends, order 1 + k.
    TimeScaledTrapezoid,
    /// Product trapezoid: integrand linear over a step, order 2.
    Trapezoid,
    /// Gruenwald-Letnikov difference quotient, order 1: the times must be equally spaced.
    GruenwaldLetnikov,
    /// Trapezoid with the kernel as a sum of exponentials within 1e-10: long histories at little cost.
    #[default]
    Exponentials,
}

const TOLERANCE: f64 = 1e-10;
/// Largest relative difference of intervals treated as equal, as for times in decimals.
const EQUAL: f64 = 1e-9;

/// History of stress or strain. Before the first time all is at rest; then the value may jump to the first one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Loading {
    /// Prescribed quantity.
    pub control: Control,
    /// Times, s, ascending. The first is the start.
    pub time_s: Vec<f64>,
    /// Stress (kPa) or strain at these times, linear between them.
    pub value: Vec<f64>,
}

/// Response of a material point.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    /// Shear strain at each time of the history.
    pub strain: Vec<f64>,
    /// Shear stress, kPa; `None` where it is infinite: at a jump of strain, in a body that begins with a spring-pot.
    pub stress_kpa: Vec<Option<f64>>,
    /// Number of steps between two times of the history.
    pub substeps: usize,
    /// Change of the response when steps were last halved, relative to its largest value: an estimate of its error.
    /// `None` if they were not halved.
    pub change: Option<f64>,
    /// Largest number of iterations in one step.
    pub iterations: usize,
}

impl Loading {
    /// Checks all times and values.
    ///
    /// # Errors
    /// [`HistoryError`] for the first that is invalid.
    pub fn check(&self) -> Result<(), HistoryError> {
        let (times, values) = (self.time_s.len(), self.value.len());
        if times != values || times == 0 {
            return Err(HistoryError::Lengths { times, values });
        }
        let wrong = |key: &str, index: usize, found: f64, expected| {
            HistoryError::Number(OutOfRange::new(format!("{key}[{index}]"), found, expected))
        };
        if let Some(index) = self.value.iter().position(|x| !x.is_finite()) {
            return Err(wrong("value", index, self.value[index], "a finite number"));
        }
        for (index, time) in self.time_s.iter().enumerate() {
            if !time.is_finite() {
                return Err(wrong("time_s", index, *time, "a finite number of seconds"));
            }
            if index > 0 && *time <= self.time_s[index - 1] {
                return Err(wrong("time_s", index, *time, "a time after the one before it"));
            }
        }
        let length = self.time_s[times - 1] - self.time_s[0];
        check("time_s", length, length.is_finite(), "times that are not so far apart")
    }

    /// Checks that the times are equally spaced.
    fn check_equal(&self) -> Result<(), HistoryError> {
        let times = &self.time_s;
        let Some(first_s) = times.get(1).map(|second| second - times[0]) else {
            return Ok(());
        };
        let odd = times
            .windows(2)
            .position(|pair| (pair[1] - pair[0] - first_s).abs() > EQUAL * first_s);
        odd.map_or(Ok(()), |index| {
            let expected = "times equally far apart, which the rule of Gruenwald and Letnikov needs";
            Err(OutOfRange::new(format!("time_s[{}]", index + 1), times[index + 1], expected).into())
        })
    }
}

/// Division of the time between two points of a history: number of steps, and exponent of the power law that makes them
/// fine after the first point, 1 for equal steps.
#[derive(Clone, Copy, Debug)]
struct Division {
    substeps: usize,
    grading: i32,
}

/// Exponent of graded steps, whose ends grow as the cube of their number. After a jump the response of a spring-pot
/// begins as t^k: a second-order rule keeps its order at later times on steps graded by 2 / (1 + k) or more, and 3
/// leaves room for points that lie decades apart.
const GRADING: i32 = 3;

impl Division {
    /// Returns the share of the time between two points at the end of `substep`.
    fn share(self, substep: usize) -> f64 {
        (substep as f64 / self.substeps as f64).powi(self.grading)
    }
}

impl Point {
    /// Computes the response, with steps between the given times halved until that changes it by less than 1e-7 of its
    /// largest value, or until the rule's cost allows no more (see [`Response::change`]).
    ///
    /// # Errors
    /// [`HistoryError`] for an invalid material or history, or an overflow.
    pub fn respond(&self, loading: &Loading, method: Method) -> Result<Response, HistoryError> {
        self.check()?;
        loading.check()?;
        refined(self, loading, method)
    }

    /// Computes the response with `substeps` steps between two times, graded unless the rule needs equal ones.
    ///
    /// # Errors
    /// [`HistoryError`] for an invalid material, history or number of steps, or an overflow.
    pub fn respond_in(&self, loading: &Loading, method: Method, substeps: usize) -> Result<Response, HistoryError> {
        self.check()?;
        loading.check()?;
        check("substeps", substeps as f64, substeps > 0, "at least one step")?;
        let equal = substeps == 1 || method == Method::GruenwaldLetnikov;
        let division = Division {
            substeps,
            grading: if equal { 1 } else { GRADING },
        };
        if method == Method::GruenwaldLetnikov {
            loading.check_equal()?;
        }
        let rule = rule(loading, method, division);
        self.follow(loading, &rule, division)
    }

    fn follow(&self, loading: &Loading, rule: &Rule, division: Division) -> Result<Response, HistoryError> {
        let Loading { control, time_s, value } = loading;
        let mut response = Response {
            strain: Vec::with_capacity(value.len()),
            stress_kpa: Vec::with_capacity(value.len()),
            substeps: division.substeps,
            change: None,
            iterations: 0,
        };
        let line = self.body.at_start();
        let start = self.balance(&line, *control, value[0], &mut response.iterations);
        // A spring-pot cannot jump: its stress is infinite then. Any other infinity is an overflow.
        let jumps = line.slope > 0.0;
        if !start.reduced_strain.is_finite() || jumps && !start.reduced_stress.is_finite() {
            return Err(HistoryError::Overflow { time_s: time_s[0] });
        }
        response.push(&start, time_s[0])?;
        let mut memory = Memory::start(&self.body, rule, *control, start.reduced_strain, start.reduced_stress)?;
        for index in 1..time_s.len() {
            let length = time_s[index] - time_s[index - 1];
            let rise = value[index] - value[index - 1];
            let mut before = 0.0;
            for substep in 1..=division.substeps {
                let share = division.share(substep);
                let step_s = (share - before) * length;
                before = share;
                let value_now = if substep == division.substeps {
                    value[index]
                } else {
                    value[index - 1] + share * rise
                };
                let line = memory.predict(step_s)?;
                let state = self.balance(&line, *control, value_now, &mut response.iterations);
                if !(state.stress.is_finite() && state.strain.is_finite()) {
                    return Err(HistoryError::Overflow { time_s: time_s[index] });
                }
                memory.commit(step_s, state.reduced_strain, state.reduced_stress)?;
                if substep == division.substeps {
                    response.push(&state, time_s[index])?;
                }
            }
        }
        Ok(response)
    }

    /// Returns strain and stress for a prescribed one of them, with those of the linear body on a line.
    fn balance(&self, line: &Line, control: Control, prescribed: f64, max_iterations: &mut usize) -> State {
        let strain = match control {
            Control::Strain => prescribed,
            Control::Stress => {
                let balanced = balance::strain(&self.knee, self.structure, line, prescribed);
                *max_iterations = balanced.iterations.max(*max_iterations);
                balanced.strain
            }
        };
        // The linear body receives a strain or stress that already accounts for the knee.
        let factor = self.knee.factor(strain);
        let (over_strain, over_stress) = match self.structure {
            Structure::Rate => (1.0, factor),
            Structure::LoadIntegral => (factor, 1.0),
        };
        let reduced_strain = over_strain * strain;
        let reduced_stress = match control {
            Control::Strain => line.stress(reduced_strain),
            Control::Stress => prescribed / over_stress,
        };
        let stress = match control {
            Control::Strain => over_stress * reduced_stress,
            Control::Stress => prescribed,
        };
        State {
            strain,
            stress,
            reduced_strain,
            reduced_stress,
        }
    }
}

/// Strain and stress, and the reduced values that the linear body receives.
#[derive(Clone, Copy, Debug)]
struct State {
    strain: f64,
    stress: f64,
    reduced_strain: f64,
    reduced_stress: f64,
}

impl Response {
    fn push(&mut self, state: &State, time_s: f64) -> Result<(), HistoryError> {
        let is_first = self.strain.is_empty();
        if state.stress.is_nan() || !state.strain.is_finite() || !(is_first || state.stress.is_finite()) {
            return Err(HistoryError::Overflow { time_s });
        }
        self.strain.push(state.strain);
        self.stress_kpa
            .push(Some(state.stress).filter(|stress| stress.is_finite()));
        Ok(())
    }
}

/// Returns the rule for a history with this division.
fn rule(loading: &Loading, method: Method, division: Division) -> Rule {
    let times = &loading.time_s;
    match method {
        Method::Rectangle => Rule::Rectangle,
        Method::TimeScaledTrapezoid => Rule::TimeScaledTrapezoid,
        Method::Trapezoid => Rule::Trapezoid,
        Method::GruenwaldLetnikov => Rule::GruenwaldLetnikov,
        Method::Exponentials => {
            let shortest = times
                .windows(2)
                .map(|pair| pair[1] - pair[0])
                .fold(f64::INFINITY, f64::min);
            let longest_s = times[times.len() - 1] - times[0];
            // A single time leaves nothing to sum.
            let (shortest, longest_s) = if longest_s > 0.0 {
                (shortest, longest_s)
            } else {
                (1.0, 1.0)
            };
            Rule::Exponentials(Span {
                shortest_s: shortest * division.share(1),
                longest_s,
                tolerance: TOLERANCE,
            })
        }
    }
}

/// Change relative to the largest value below which refinement ends.
const SETTLED: f64 = 1e-7;
/// Initial number of steps between two points.
const FIRST: usize = 8;

/// Returns the largest total number of steps, which takes about a second.
fn most(method: Method) -> usize {
    match method {
        // Every step weighs all values before it, with weights that differ from those of the previous step.
        Method::Rectangle | Method::TimeScaledTrapezoid | Method::Trapezoid => 1 << 12,
        Method::GruenwaldLetnikov => 1 << 15,
        Method::Exponentials => 1 << 17,
    }
}

fn refined(point: &Point, loading: &Loading, method: Method) -> Result<Response, HistoryError> {
    let intervals = loading.time_s.len() - 1;
    let fits = |substeps: usize| intervals.saturating_mul(substeps) <= most(method);
    let mut substeps = FIRST;
    while substeps > 1 && !fits(substeps) {
        substeps /= 2;
    }
    let mut response = point.respond_in(loading, method, substeps)?;
    if intervals == 0 {
        response.change = Some(0.0);
        return Ok(response);
    }
    while fits(2 * substeps) {
        substeps *= 2;
        let mut finer = point.respond_in(loading, method, substeps)?;
        let change = change(&response, &finer);
        finer.change = Some(change);
        response = finer;
        if change <= SETTLED {
            break;
        }
    }
    Ok(response)
}

/// Returns the largest difference of two responses relative to the largest value.
fn change(one: &Response, other: &Response) -> f64 {
    let share = |pairs: &mut dyn Iterator<Item = (f64, f64)>| {
        let (mut difference, mut largest) = (0.0f64, 0.0f64);
        for (a, b) in pairs {
            difference = difference.max((a - b).abs());
            largest = largest.max(b.abs());
        }
        if difference == 0.0 { 0.0 } else { difference / largest }
    };
    let strains = one.strain.iter().copied().zip(other.strain.iter().copied());
    let stresses = one.stress_kpa.iter().zip(&other.stress_kpa);
    let stresses = stresses.filter_map(|(a, b)| Some(((*a)?, (*b)?)));
    share(&mut { strains }).max(share(&mut { stresses }))
}
