//! Approximation of the kernel by a sum of exponentials, with a theoretical error bound.
//!
//! With `a = 1 - k` and `c = 1 / (Gamma(k) Gamma(a))`,
//!
//! ```text
//! t^(k-1) / Gamma(k) = c * integral over all x of e^(a x) exp(-t e^x) dx
//! ```
//!
//! and the trapezoidal rule in x converges exponentially (G. Beylkin and L. Monzon, "Approximation by exponential sums
//! revisited", 2010). Rates below 1 / (2 longest) form an infinite geometric sequence; a Gauss rule for that measure
//! replaces them by [`TAIL`].
//!
//! Relative to the kernel, the error is at most the sum of
//!
//! - that of the rule: twice the sum of `|Gamma(a + 2 pi i m / spacing)| / Gamma(a)`, by Poisson's formula.
//!   Log-convexity of `|Gamma|` along the real axis gives `|Gamma(a + iy)| <= sqrt(pi / sinh(pi y)) y^(a - 1/2)`;
//! - that of omitting rates above the fastest, Z / shortest: `Z^(a-1) e^-Z / Gamma(a)`;
//! - that of the Gauss rule: `4 (z/4)^(2n) / (2n)!` of its share, with `z` of up to 1/2 its fastest rate times the
//!   longest time: under 1e-14.

use std::f64::consts::PI;

use libm::tgamma;
use nalgebra::{SMatrix, SymmetricEigen};

use super::super::history::{HistoryError, Span};

/// Exponentials and their weights.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Quadrature {
    /// Rates, 1/s.
    pub rates: Vec<f64>,
    pub weights: Vec<f64>,
}

/// Points of the Gauss rule for slow rates.
const TAIL: usize = 5;
/// Share of the tolerance for each of the two errors that depend on it.
const SHARE: f64 = 0.45;

impl Quadrature {
    /// Computes the exponentials for the kernel of an order from 0 to 1.
    ///
    /// # Errors
    /// [`HistoryError::Span`] for an invalid span.
    pub(super) fn new(order: f64, span: Span) -> Result<Self, HistoryError> {
        let Span {
            shortest_s,
            longest_s,
            tolerance,
        } = span;
        let right = shortest_s > 0.0 && longest_s >= shortest_s && longest_s / shortest_s < 1e40;
        if !(right && longest_s.is_finite() && (1e-13..=1e-2).contains(&tolerance)) {
            return Err(HistoryError::Span(span));
        }
        if order == 0.0 {
            // Only the newest value counts.
            let (rates, weights) = (Vec::new(), Vec::new());
            return Ok(Quadrature { rates, weights });
        }
        if order == 1.0 {
            let (rates, weights) = (vec![0.0], vec![1.0]);
            return Ok(Quadrature { rates, weights });
        }
        let a = 1.0 - order;
        let spacing = spacing(a, SHARE * tolerance);
        let scale = spacing / (tgamma(order) * tgamma(a));
        let fastest = cut(a, SHARE * tolerance) / shortest_s;
        let mut rates = Vec::new();
        let mut rate = fastest;
        while rate * longest_s > 0.5 {
            rates.push(rate);
            rate = fastest * (-spacing * rates.len() as f64).exp();
        }
        let mut weights: Vec<f64> = rates.iter().map(|rate| scale * rate.powf(a)).collect();
        // Sum of the weights of the slow rates, a geometric series.
        let slow_weight = scale * rate.powf(a) / -(-a * spacing).exp_m1();
        for [node, weight] in gauss(a, spacing) {
            rates.push(rate * node);
            weights.push(slow_weight * weight);
        }
        Ok(Quadrature { rates, weights })
    }
}

/// Returns the widest spacing of ln(rate) whose error stays below a bound.
fn spacing(a: f64, bound: f64) -> f64 {
    let error = |y: f64| {
        // The terms decrease faster than a geometric series of ratio e^(-pi y / 2).
        let first_term = 2.0 * (PI / (PI * y).sinh()).sqrt() * y.powf(a - 0.5) / tgamma(a);
        first_term / (1.0 - (-0.5 * PI * y).exp())
    };
    let (mut low, mut high) = (0.5, 100.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if error(middle) > bound {
            low = middle
        } else {
            high = middle
        }
    }
    2.0 * PI / high
}

/// Returns the product of fastest rate and shortest step above which exponentials can be omitted.
fn cut(a: f64, bound: f64) -> f64 {
    let error = |z: f64| z.powf(a - 1.0) * (-z).exp() / tgamma(a);
    let (mut low, mut high) = (1.0, 100.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if error(middle) > bound {
            low = middle
        } else {
            high = middle
        }
    }
    high
}

/// Returns nodes and weights of the Gauss rule for the measure with `q^(a i)` at `q^i`, i = 0, 1, ..., and `q =
/// e^-spacing`, of sum 1: the zeros of little q-Jacobi polynomials, whose recurrence has a closed form (R. Koekoek, P.
/// Lesky and R. Swarttouw, "Hypergeometric Orthogonal Polynomials and Their q-Analogues", section 14.12, there with b =
/// 1).
fn gauss(a: f64, spacing: f64) -> [[f64; 2]; TAIL] {
    // 1 - q^x without cancellation.
    let gap = |x: f64| -(-spacing * x).exp_m1();
    let power = |x: f64| (-spacing * x).exp();
    let rise = |n: f64| power(n) * (gap(a + n) / gap(a + 2.0 * n)) * (gap(a + n) / gap(a + 2.0 * n + 1.0));
    let fall = |n: f64| {
        if n == 0.0 {
            return 0.0;
        }
        power(n + a - 1.0) * (gap(n) / gap(a + 2.0 * n - 1.0)) * (gap(n) / gap(a + 2.0 * n))
    };
    let mut jacobi = SMatrix::<f64, TAIL, TAIL>::zeros();
    for row in 0..TAIL {
        let n = row as f64;
        jacobi[(row, row)] = rise(n) + fall(n);
        if row > 0 {
            let next = (rise(n - 1.0) * fall(n)).sqrt();
            jacobi[(row, row - 1)] = next;
            jacobi[(row - 1, row)] = next;
        }
    }
    let eigen = SymmetricEigen::new(jacobi);
    // Rounding may put a node below 0 when a is tiny.
    std::array::from_fn(|column| {
        [
            eigen.eigenvalues[column].max(0.0),
            eigen.eigenvectors[(0, column)].powi(2),
        ]
    })
}

#[cfg(test)]
mod tests;
