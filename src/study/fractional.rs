//! Fractional integrals in closed form, which histories are measured against.

use std::f64::consts::{FRAC_PI_2, PI};

use libm::tgamma;

/// The integral of order `k` (0 to 1) of `t^p`, `p` from 0 on.
pub(super) fn of_power(k: f64, p: f64, t: f64) -> f64 {
    tgamma(1.0 + p) / tgamma(1.0 + p + k) * t.powf(p + k)
}

/// The integral of order `k` (0 to 1) of `sin(w t)`: the steady wave `w^-k sin(w t - k pi / 2)`, and what is left of the start,
/// `sin(k pi) / pi` times the integral of `e^(-r t) r^-k w / (r^2 + w^2)` over r from 0 on. With r = w e^v the trapezoidal rule converges
/// exponentially.
pub(super) fn of_sine(k: f64, w: f64, t: f64) -> f64 {
    const STEP: f64 = 0.02;
    let steady = (w * t - k * FRAC_PI_2).sin();
    // The integrand falls as e^((1-k) v) to the left and e^(-(1+k) v) to the right.
    let left = (40.0 / (1.0 - k).max(1e-6) / STEP).min(1e7) as i64;
    let right = (40.0 / STEP) as i64;
    let sum: f64 = if k == 0.0 || k == 1.0 {
        0.0
    } else {
        let term = |at: i64| {
            let v = STEP * at as f64;
            ((1.0 - k) * v - w * t * v.exp()).exp() / ((2.0 * v).exp() + 1.0)
        };
        (-left..=right).map(term).sum()
    };
    // At k = 1 all of the measure has moved to r = 0: the integral is (1 - cos(w t)) / w.
    let start = if k == 1.0 {
        1.0
    } else {
        (k * PI).sin() / PI * STEP * sum
    };
    w.powf(-k) * (steady + start)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_are_those_of_the_power_series() {
        for k in [0.0, 1e-3, 0.1, 0.5, 0.9, 0.999, 1.0] {
            for (w, t) in [(1.0, 0.3_f64), (2.0, 1.0), (3.0, 2.0), (0.01, 100.0)] {
                let term = |m: i32| {
                    let n = 2.0 * f64::from(m) + 1.0;
                    f64::powi(-1.0, m) * f64::powf(w, n) * f64::powf(t, n + k) / tgamma(n + 1.0 + k)
                };
                let series: f64 = (0..30).map(term).sum();
                let found = of_sine(k, w, t);
                assert!(
                    (found - series).abs() < 1e-11 * f64::powf(t, k),
                    "{k} {w} {t}: {found} {series}"
                );
            }
        }
        assert!((of_power(1.0, 2.0, 3.0) - 9.0).abs() < 1e-13 && of_power(0.0, 2.0, 3.0) == 9.0);
    }
}
