//! Strain of a stiffening body under a given stress: one equation with one unknown.

use super::body::Line;
use super::{Knee, Structure};

/// Strain, and the number of Newton iterations that found it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub strain: f64,
    pub iterations: usize,
}

/// Largest number of Newton iterations; where they may not converge, bisection does by then.
const MAX: usize = 120;

/// Returns the strain at which the body bears the stress.
///
/// Under `rate` it solves `(strain - offset) s(strain) = slope stress`, under `load-integral` `strain s(strain) = slope
/// stress + offset`. Both are `(x - c) s(x) = r`, whose root lies between c and c + r, as s is 1 or more.
///
/// Where the strain is driven back against its past (c and r of opposite signs, c beyond the knee) there may be three
/// roots: the result is then the one next to c that Newton's method reaches from there.
pub(super) fn strain(knee: &Knee, structure: Structure, line: &Line, stress: f64) -> Found {
    match structure {
        Structure::Rate => root(knee, line.offset, line.slope * stress),
        Structure::LoadIntegral => root(knee, 0.0, line.strain(stress)),
    }
}

fn root(knee: &Knee, c: f64, r: f64) -> Found {
    if r < 0.0 {
        let Found { strain, iterations } = root(knee, -c, -r);
        let strain = -strain;
        return Found { strain, iterations };
    }
    let whole = c + r;
    let found = |strain, iterations| Found { strain, iterations };
    if knee.stiffening == 0.0 || r == 0.0 || whole.abs() <= knee.strain {
        // Below the knee all of r is strain.
        return found(whole, 0);
    }
    // Above the knee s is at least a times the square of the strain above it, so x exceeds both knee and c by at most
    // the cube root of r / a.
    let start = knee.strain.max(c);
    let high = whole.min((start + (r / knee.stiffening).cbrt()).max(c));
    if c >= -knee.strain {
        descend(knee, c, r, high)
    } else {
        search(knee, c, r, high)
    }
}

/// Returns Newton's step from `x`, and whether the root is to the left.
fn newton(knee: &Knee, c: f64, r: f64, x: f64) -> (f64, bool) {
    let factor = knee.factor(x);
    let value = (x - c) * factor - r;
    (value / (factor + (x - c) * knee.slope(x)), value > 0.0)
}

/// Returns the uncertainty of the root due to rounding.
fn grain(x: f64, c: f64) -> f64 {
    4.0 * f64::EPSILON * x.abs().max(c.abs())
}

/// Newton's method where the function is convex and increasing: from the right it descends monotonically to the root.
fn descend(knee: &Knee, c: f64, r: f64, mut x: f64) -> Found {
    for iterations in 1..=MAX {
        let (step, left) = newton(knee, c, r, x);
        if !left || step <= grain(x, c) {
            let strain = x - step;
            return Found { strain, iterations };
        }
        x -= step;
    }
    let (strain, iterations) = (x, MAX);
    Found { strain, iterations }
}

/// Newton's method from c, with bisection where it leaves the bracketing interval or does not halve its step.
fn search(knee: &Knee, c: f64, r: f64, mut high: f64) -> Found {
    let mut low = c;
    let mut x = c;
    let mut last_step = high - low;
    for iterations in 1..=MAX {
        let (step, left) = newton(knee, c, r, x);
        if left {
            high = x
        } else {
            low = x
        }
        // Rounding may place a root at an end of the interval slightly beyond it.
        let slack = grain(x, c);
        let mut next = x - step;
        if step.abs() <= slack {
            let strain = next;
            return Found { strain, iterations };
        }
        // Also taken for NaN, where the slope is 0.
        if !(next >= low - slack && next <= high + slack && step.abs() <= 0.5 * last_step) {
            next = low + 0.5 * (high - low);
        }
        last_step = (next - x).abs();
        x = next;
    }
    let (strain, iterations) = (x, MAX);
    Found { strain, iterations }
}

#[cfg(test)]
mod tests;
