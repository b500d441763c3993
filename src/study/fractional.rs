//! Closed-form fractional integrals, the reference for strain histories.

use std::f64::consts::{FRAC_PI_2, PI};

use libm::tgamma;

/// Returns the fractional integral of order `k` (0 to 1) of `t^p`, for `p` of 0 or more.
pub(super) fn of_power(k: f64, p: f64, t: f64) -> f64 {
    tgamma(1.0 + p) / tgamma(1.0 + p + k) * t.powf(p + k)
}

/// Returns the fractional integral of order `k` (0 to 1) of `sin(w t)`.
pub(super) fn of_sine(k: f64, w: f64, t: f64) -> f64 {
    if w * t <= 1.0 {
        return sine_series(k, w, t);
    }
    // The steady-state wave plus the starting transient.
    let steady = (w * t - k * FRAC_PI_2).sin();
    w.powf(-k) * (steady + start_of_sine(k, w * t))
}

/// Sums the power series, for small `w t`, where the wave and the transient almost cancel.
fn sine_series(k: f64, w: f64, t: f64) -> f64 {
    let term = |m: i32| {
        let n = 2.0 * f64::from(m) + 1.0;
        f64::powi(-1.0, m) * (w * t).powf(n) / tgamma(n + 1.0 + k)
    };
    t.powf(k) * (0..30).map(term).sum::<f64>()
}

/// Returns `sin(k pi) / pi` times the integral of `e^(-r x) r^-k / (r^2 + 1)` over r from 0 to infinity. With r = e^v
/// the trapezoidal rule converges exponentially.
fn start_of_sine(k: f64, x: f64) -> f64 {
    // Trapezoids of 0.02 in v over -40 to 40, beyond which the integrand is a geometric series or nothing.
    const STEP: f64 = 0.02;
    const ENDS: i32 = 2000;
    if k == 0.0 {
        return 0.0;
    }
    if k == 1.0 {
        // The measure is concentrated at r = 0.
        return 1.0;
    }
    let term = |step: i32| {
        let v = STEP * f64::from(step);
        ((1.0 - k) * v - x * v.exp()).exp() / ((2.0 * v).exp() + 1.0)
    };
    // To the left of e^-40 only e^((1-k) v) remains: a geometric series.
    let slow = (1.0 - k) * STEP;
    let tail = (-slow * f64::from(ENDS + 1)).exp() / -(-slow).exp_m1();
    (k * PI).sin() / PI * STEP * ((-ENDS..=ENDS).map(term).sum::<f64>() + tail)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_two_ways_to_a_sine_meet() {
        for k in [0.0, 1e-3, 0.1, 0.5, 0.9, 0.999, 1.0] {
            // The series loses a factor e^x to rounding.
            for (w, t) in [(4.0, 0.3), (2.0, 1.0), (3.0, 2.0), (0.05, 100.0)] {
                let (series, sine) = (sine_series(k, w, t), of_sine(k, w, t));
                assert!(
                    (sine - series).abs() < 1e-11 * f64::powf(t, k),
                    "{k} {w} {t}: {sine} {series}"
                );
            }
        }
        assert!((of_sine(1.0, 2.0, 0.3) - (1.0 - f64::cos(0.6)) / 2.0).abs() < 1e-15);
        assert!((of_power(1.0, 2.0, 3.0) - 9.0).abs() < 1e-13 && of_power(0.0, 2.0, 3.0) == 9.0);
    }
}
