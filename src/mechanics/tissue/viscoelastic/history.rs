//! Interface of histories, and their rules.

use std::fmt::Debug;

use insonify_base::blame::Blame;
use insonify_base::range::OutOfRange;

/// Fractional integral or derivative of a vector-valued function of time, known step by step from a start at time 0.
///
/// The function is 0 before the start, where it may jump to the initial value. The result at the end of a step is
/// `weight * value + history`, component by component.
pub trait History: Debug + Send + Sync {
    /// Number of components.
    fn components(&self) -> usize;

    /// Time of the last committed value since the start, s.
    fn time_s(&self) -> f64;

    /// Prepares a step of `step_s` seconds: returns the weight of the value at its end, and writes the contribution of
    /// earlier values to `history` (one number per component). Nothing is committed: another step may be tried next.
    ///
    /// # Errors
    /// [`HistoryError`] for a step that is not above 0 or not supported by the rule, and for a slice of the wrong
    /// length.
    fn predict(&mut self, step_s: f64, history: &mut [f64]) -> Result<f64, HistoryError>;

    /// Commits a step of `step_s` seconds, at whose end the function has this value.
    ///
    /// # Errors
    /// [`HistoryError`] as of [`predict`](History::predict), and for a value that is not finite. The history is then
    /// unchanged.
    fn commit(&mut self, step_s: f64, value: &[f64]) -> Result<(), HistoryError>;

    /// Returns the complete state as numbers; later results depend on nothing else. Only an integral under
    /// [`Rule::Exponentials`] can be saved; other histories return no numbers.
    fn remembered(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Restores the state of another history of the same rule, operator and number of components: the same steps then
    /// give the same bits.
    ///
    /// # Errors
    /// [`HistoryError::Remembered`] for numbers that do not fit such a history, and wherever a history cannot be saved.
    /// The history is then unchanged.
    fn recall(&mut self, remembered: &[f64]) -> Result<(), HistoryError> {
        Err(HistoryError::Remembered {
            found: remembered.len(),
        })
    }

    /// Size of the history, bytes.
    fn bytes(&self) -> usize;

    /// Returns a boxed copy.
    fn boxed(&self) -> Box<dyn History>;
}

impl Clone for Box<dyn History> {
    fn clone(&self) -> Self {
        self.as_ref().boxed()
    }
}

/// Operator applied to the function. The order k lies in 0 to 1, both included.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operator {
    /// Fractional integral `I^k`: for order 0 the function itself, for 1 the ordinary integral.
    Integral(f64),
    /// Riemann-Liouville derivative `D^k`, in which a jump at the start contributes `t^-k / Gamma(1-k)` of itself: for
    /// order 0 the function itself, for 1 the ordinary derivative after the start.
    Derivative(f64),
}

impl Operator {
    /// Order k.
    pub const fn order(self) -> f64 {
        let (Operator::Integral(order) | Operator::Derivative(order)) = self;
        order
    }
}

/// Summation rule of a history. The order of convergence is for smooth functions as the longest step h goes to 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// Product rectangle: constant over a step, with the value at its end. Order 1. Costs O(n) per step. The derivative
    /// is the inverse of the integral.
    Rectangle,
    /// Time-scaled trapezoid: constant over a step, with the mean of the values at both ends, so that the integral is
    /// the ordinary trapezoidal sum over steps of `((t_n - t_(j-1))^k - (t_n - t_j)^k) / Gamma(1 + k)`: the sampling
    /// time scaling of C. Ma and Y. Hori, "The time-scaled trapezoidal integration rule for discrete fractional order
    /// controllers", Nonlinear Dynamics 38 (2004) 171-180, which Kobayashi et al. 2010 apply to loads (section 3.2.1).
    /// Order 1 + k for the integral; the derivative is that of [`Trapezoid`](Rule::Trapezoid). Costs O(n) per step. As
    /// its new value counts by half, an unknown integrand that is solved for step by step, as the reaction at a
    /// prescribed displacement is, alternates about the solution without decay.
    TimeScaledTrapezoid,
    /// Product trapezoid: linear over a step. Order 2 for the integral, 2 - k for the derivative (L1 rule); exact for
    /// piecewise linear functions. Costs O(n) per step.
    Trapezoid,
    /// Gruenwald-Letnikov difference quotient, for equal steps only. Order 1. Costs O(n) per step.
    GruenwaldLetnikov,
    /// Product trapezoid with the kernel as a sum of decaying exponentials within a relative bound: O(1) per step in
    /// time and memory.
    Exponentials(Span),
}

/// Range in which a sum of exponentials approximates the kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    /// Shortest step to be taken, s.
    pub shortest_s: f64,
    /// Longest time of a history, s.
    pub longest_s: f64,
    /// Bound of the kernel's relative error in this range, 1e-13 to 1e-2. The error of the result is below this times
    /// the integral of the function's magnitude.
    pub tolerance: f64,
}

impl Default for Span {
    /// Returns 1e-6 s to 1e6 s within 1e-9: about a hundred exponentials.
    fn default() -> Self {
        Span {
            shortest_s: 1e-6,
            longest_s: 1e6,
            tolerance: 1e-9,
        }
    }
}

/// Error of a history, or of the response of a point.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HistoryError {
    /// The order is not a number from 0 to 1.
    #[error("the order is {found}; expected a number from 0 (a spring) to 1 (a dashpot)")]
    Order {
        /// Order found.
        found: f64,
    },
    /// A step is not a finite time above 0.
    #[error("a step of {found} s; expected a finite time above 0")]
    Step {
        /// Step found, s.
        found: f64,
    },
    /// A component is NaN or infinite.
    #[error("component {component} is {found}; expected a finite number")]
    Value {
        /// Index of the component, from 0.
        component: usize,
        /// Value found.
        found: f64,
    },
    /// The number of components differs from that at the start.
    #[error("{found} components; the history has {expected}")]
    Components {
        /// Number of components found.
        found: usize,
        /// Number of components of the history.
        expected: usize,
    },
    /// The numbers are not the state of a history of this rule and size.
    #[error("{found} numbers, or numbers that are not finite; not what a history of this rule and size remembers")]
    Remembered {
        /// Count of numbers found.
        found: usize,
    },
    /// A rule for equal steps received an unequal one, s.
    #[error(
        "a step of {found} s after steps of {expected} s; the rule of Gruenwald and Letnikov takes equal steps only"
    )]
    Uneven {
        /// Step found, s.
        found: f64,
        /// Length of the steps before it, s.
        expected: f64,
    },
    /// A step is shorter than the sum of exponentials supports, s.
    #[error("a step of {found} s; this sum of exponentials was made for steps from {shortest} s")]
    Short {
        /// Step found, s.
        found: f64,
        /// Shortest step supported, s.
        shortest: f64,
    },
    /// A history is longer than the sum of exponentials supports, s.
    #[error("a history of {found} s; this sum of exponentials was made for up to {longest} s")]
    Long {
        /// Length found, s.
        found: f64,
        /// Longest history supported, s.
        longest: f64,
    },
    /// The range of a sum of exponentials is invalid.
    #[error(
        "a span of {} s to {} s within {}; expected times above 0, ascending and less than 1e40 apart, within 1e-13 to 1e-2",
        .0.shortest_s, .0.longest_s, .0.tolerance
    )]
    Span(Span),
    /// A number of a point's material or loading is out of range.
    #[error("found {}; expected {}", .0.found, .0.expected)]
    Number(#[from] OutOfRange),
    /// Times and values differ in number, or there are none.
    #[error("found {values} values at {times} times; expected a value for each, and at least one")]
    Lengths {
        /// Number of times.
        times: usize,
        /// Number of values.
        values: usize,
    },
    /// Stress or strain overflows.
    #[error("the response at {time_s} s is no finite number; expected smaller moduli, strains or stresses")]
    Overflow {
        /// Time of the response, s.
        time_s: f64,
    },
}

impl Blame for HistoryError {}

impl HistoryError {
    /// Checks that a step is finite and above 0.
    pub(super) fn check_step(step_s: f64) -> Result<(), HistoryError> {
        let right = step_s > 0.0 && step_s.is_finite();
        right.then_some(()).ok_or(HistoryError::Step { found: step_s })
    }

    /// Checks the number of components.
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
