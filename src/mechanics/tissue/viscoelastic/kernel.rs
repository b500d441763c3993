//! Kernel t^(k-1) / Gamma(k) and its moments over an interval.

use libm::tgamma;

/// Returns `1 / Gamma(x)` for `x` of 0 or more; 0 at 0.
pub(super) fn inverse_gamma(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { 1.0 / tgamma(x) }
}

/// Returns `t^nu / Gamma(1 + nu)` for `nu` of -1 or more and `t` above 0: the integral of order nu (or the derivative
/// of order -nu) of a unit jump at the start.
pub(super) fn of_jump(nu: f64, t: f64) -> f64 {
    inverse_gamma(1.0 + nu) * t.powf(nu)
}

/// Approximation of a function between two times.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Basis {
    /// Constant, with the value at the end.
    Constant,
    /// Constant, with the mean of both values.
    Mean,
    /// Linear between both values.
    Linear,
}

/// Weights of the values at both ends of an interval in the integral of order k, `k` above 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ends {
    /// Weight of the value at the start of the interval.
    pub start: f64,
    /// Weight of the value at the end of the interval.
    pub end: f64,
}

/// Moments of the kernel of one order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moments {
    basis: Basis,
    order: f64,
    /// `1 / Gamma(1 + k)`.
    scale: f64,
}

/// Ratio of interval to lag below which series are used, as differences of powers cancel.
const SERIES: f64 = 0.25;

impl Moments {
    pub(super) fn new(basis: Basis, order: f64) -> Self {
        let scale = inverse_gamma(1.0 + order);
        Moments { basis, order, scale }
    }

    /// Returns the weights of an interval of length `step` that ended `near` ago (0: the newest one). Its start is not
    /// a parameter, as subtracting the length from it would lose a short `near` before a long step.
    pub(super) fn weights(&self, near: f64, step: f64) -> Ends {
        let k = self.order;
        if k == 0.0 {
            // Only the newest value counts.
            let end = if near == 0.0 { 1.0 } else { 0.0 };
            return Ends { start: 0.0, end };
        }
        let lag = near + step;
        let power = self.scale * lag.powf(k);
        let x = step / lag;
        let near_share = near / lag;
        let log = if x < SERIES { (-x).ln_1p() } else { near_share.ln() };
        let zeroth = -power * (k * log).exp_m1();
        match self.basis {
            Basis::Constant => Ends {
                start: 0.0,
                end: zeroth,
            },
            Basis::Mean => Ends {
                start: 0.5 * zeroth,
                end: 0.5 * zeroth,
            },
            Basis::Linear => {
                let [start, end] = if x < SERIES {
                    series(k, x)
                } else {
                    closed(k, x, near_share, log)
                };
                Ends {
                    start: power * start,
                    end: power * end,
                }
            }
        }
    }
}

/// Computes the weights of both ends by a Taylor series in `x` with positive terms, for a lag of 1 and without the
/// scale: `k x (1-k)_m x^m / m!` times 1 / ((m+1)(m+2)) and 1 / (m+2).
fn series(k: f64, x: f64) -> [f64; 2] {
    let (mut start, mut end) = (0.0, 0.0);
    let mut term = k * x;
    let mut m = 0.0;
    loop {
        let part = term / (m + 2.0);
        start += part / (m + 1.0);
        end += part;
        if part <= f64::EPSILON * 0.25 * end {
            return [start, end];
        }
        term *= x * (m + 1.0 - k) / (m + 1.0);
        m += 1.0;
    }
}

/// Computes the weights of both ends from powers, for a lag of 1 and without the scale; `rest` is 1 - x and `log` its
/// logarithm.
fn closed(k: f64, x: f64, near_share: f64, log: f64) -> [f64; 2] {
    let zeroth = -(k * log).exp_m1();
    let first_moment = k / (k + 1.0) * -((k + 1.0) * log).exp_m1();
    [(first_moment - near_share * zeroth) / x, (zeroth - first_moment) / x]
}

#[cfg(test)]
mod tests;
