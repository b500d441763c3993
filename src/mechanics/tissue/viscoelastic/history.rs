//! What a history can be asked, and the rules that answer.

use std::fmt::Debug;

/// A fractional integral or derivative of a vector-valued function of time, known step by step from a start at time 0.
///
/// Before the start the function is 0; at the start it may jump to the initial value. Its value at the end of a step enters as
/// `weight * value + history`, component by component.
pub trait History: Debug + Send + Sync {
    /// Number of components.
    fn components(&self) -> usize;

    /// Seconds since the start, of the last value committed.
    fn time_s(&self) -> f64;

    /// What a step of `step_s` seconds would end with: the weight of the value at its end is returned, what the values so far
    /// contribute is put into `history` (one number a component). Nothing is committed: another step may be tried next.
    ///
    /// # Errors
    /// [`HistoryError`] for a step that is not above 0 or that the rule does not take, and for a slice of another length.
    fn predict(&mut self, step_s: f64, history: &mut [f64]) -> Result<f64, HistoryError>;

    /// Goes on by `step_s` seconds, at whose end the function has this value.
    ///
    /// # Errors
    /// As [`predict`](History::predict), and for a value that is not finite. The history is then as before.
    fn commit(&mut self, step_s: f64, value: &[f64]) -> Result<(), HistoryError>;

    /// Starts anew, with another initial value.
    ///
    /// # Errors
    /// [`HistoryError`] for a slice of another length or a value that is not finite. The history is then as before.
    fn restart(&mut self, initial: &[f64]) -> Result<(), HistoryError>;

    /// All that is remembered, as numbers: what comes after depends on nothing else.
    fn remembered(&self) -> Vec<f64>;

    /// Goes on from what another history of the same rule, operator and number of components remembered: the same steps then have
    /// the same bits.
    ///
    /// # Errors
    /// [`HistoryError::Remembered`] for numbers that are not of such a history. The history is then as before.
    fn recall(&mut self, remembered: &[f64]) -> Result<(), HistoryError>;

    /// Memory that the past takes, bytes.
    fn bytes(&self) -> usize;

    /// A copy.
    fn boxed(&self) -> Box<dyn History>;
}

impl Clone for Box<dyn History> {
    fn clone(&self) -> Self {
        self.as_ref().boxed()
    }
}

/// What is made of the function. The order k lies in 0 to 1, both included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operator {
    /// `I^k`: 0 the function itself, 1 the ordinary integral.
    Integral(f64),
    /// `D^k` of Riemann and Liouville, so that a jump at the start counts: `t^-k / Gamma(1-k)` of it. 0 the function itself, 1 the
    /// ordinary derivative after the start.
    Derivative(f64),
}

impl Operator {
    /// The order k.
    pub const fn order(self) -> f64 {
        let (Operator::Integral(order) | Operator::Derivative(order)) = self;
        order
    }
}

/// How a history is summed up. The order of convergence is for smooth functions and the longest step h going to 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// Product rectangle: constant over a step, with the value at its end. Order 1. Costs O(n) a step. The integral is the
    /// ordinary one over a deformed scale of time, as Kobayashi et al. 2010 (section 3.2.1) have it; the derivative is its inverse.
    Rectangle,
    /// Product trapezoid: linear over a step. Order 2 for the integral, 2 - k for the derivative (known as L1); exact for
    /// piecewise linear functions. Costs O(n) a step.
    Trapezoid,
    /// Gruenwald and Letnikov's difference quotient, for equal steps only. Order 1. Costs O(n) a step.
    GruenwaldLetnikov,
    /// As the trapezoid, with the kernel as a sum of decaying exponentials within a relative bound: O(1) a step in time and memory.
    Exponentials(Span),
}

/// Where a sum of exponentials stands for the kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// The shortest step that will come, s.
    pub shortest_s: f64,
    /// The longest time that a history will take, s.
    pub longest_s: f64,
    /// Bound of the kernel's relative error between the two, 1e-13 to 1e-2. The result then errs by less than this times the
    /// integral of the function's magnitude.
    pub tolerance: f64,
}

impl Default for Span {
    /// 1e-6 s to 1e6 s within 1e-9: about a hundred exponentials.
    fn default() -> Self {
        Span {
            shortest_s: 1e-6,
            longest_s: 1e6,
            tolerance: 1e-9,
        }
    }
}

/// Why a history cannot be kept or go on.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum HistoryError {
    /// An order outside 0 to 1.
    #[error("the order is {found}; expected a number from 0 (a spring) to 1 (a dashpot)")]
    Order {
        /// The order.
        found: f64,
    },
    /// A step that is none.
    #[error("a step of {found} s; expected a finite time above 0")]
    Step {
        /// Its length, s.
        found: f64,
    },
    /// A value that is not finite.
    #[error("component {component} is {found}; expected a finite number")]
    Value {
        /// Which, from 0.
        component: usize,
        /// As given.
        found: f64,
    },
    /// Another number of components than at the start.
    #[error("{found} components; the history has {expected}")]
    Components {
        /// How many were given.
        found: usize,
        /// How many there are.
        expected: usize,
    },
    /// Numbers that no history of this rule and size remembers.
    #[error("{found} numbers, or numbers that are not finite; not what a history of this rule and size remembers")]
    Remembered {
        /// How many there are.
        found: usize,
    },
    /// A rule for equal steps met another.
    #[error(
        "a step of {found} s after steps of {expected} s; the rule of Gruenwald and Letnikov takes equal steps only"
    )]
    Uneven {
        /// The step, s.
        found: f64,
        /// Those before, s.
        expected: f64,
    },
    /// A step shorter than a sum of exponentials was made for.
    #[error("a step of {found} s; this sum of exponentials was made for steps from {shortest} s")]
    Short {
        /// The step, s.
        found: f64,
        /// The shortest, s.
        shortest: f64,
    },
    /// A history longer than a sum of exponentials was made for.
    #[error("a history of {found} s; this sum of exponentials was made for up to {longest} s")]
    Long {
        /// The time at the end of the step, s.
        found: f64,
        /// The longest, s.
        longest: f64,
    },
    /// A span that is none.
    #[error(
        "a span of {} s to {} s within {}; expected times above 0, ascending and less than 1e40 apart, within 1e-13 to 1e-2",
        .0.shortest_s, .0.longest_s, .0.tolerance
    )]
    Span(Span),
}

impl HistoryError {
    /// Checks a step.
    pub(super) fn check_step(step_s: f64) -> Result<(), HistoryError> {
        let right = step_s > 0.0 && step_s.is_finite();
        right.then_some(()).ok_or(HistoryError::Step { found: step_s })
    }

    /// Splits what is remembered into its first `parts` numbers and the rest; all are finite, and the rest has `rest` of them.
    pub(super) fn split_remembered(
        remembered: &[f64],
        parts: usize,
        rest: impl FnOnce(&[f64]) -> Option<usize>,
    ) -> Result<(&[f64], &[f64]), HistoryError> {
        let found = remembered.len();
        let finite = remembered.iter().all(|x| x.is_finite());
        let split = remembered.split_at_checked(parts).filter(|_| finite);
        split
            .filter(|(first, others)| rest(first) == Some(others.len()))
            .ok_or(HistoryError::Remembered { found })
    }

    /// Checks a number of components.
    pub(super) fn check_components(found: usize, expected: usize) -> Result<(), HistoryError> {
        let right = found == expected;
        right.then_some(()).ok_or(HistoryError::Components { found, expected })
    }

    /// Checks that a value is finite.
    pub(super) fn check_value(value: &[f64]) -> Result<(), HistoryError> {
        match value.iter().position(|x| !x.is_finite()) {
            Some(component) => Err(HistoryError::Value {
                component,
                found: value[component],
            }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
