//! The function of Mittag-Leffler on the negative axis, from its spectrum: no step and no history in it.

use std::f64::consts::PI;

use libm::{erfc, tgamma};

/// `E_k(-x)` for k in (0, 1] and x from 0 on. With r^k = e^v in its spectrum (F. Mainardi, "Fractional Calculus and
/// Waves in Linear Viscoelasticity", 2010, appendix E), the trapezoidal rule converges exponentially.
pub(super) fn mittag_leffler(k: f64, x: f64) -> f64 {
    if k == 1.0 {
        return (-x).exp();
    }
    if x == 0.0 {
        return 1.0;
    }
    const STEP: f64 = 0.004;
    let (sin, cos) = (k * PI).sin_cos();
    let term = |at: i32| {
        let v = STEP * f64::from(at);
        let spectrum = 1.0 / (v.exp() + 2.0 * cos + (-v).exp());
        spectrum * (-(x * v.exp()).powf(1.0 / k)).exp()
    };
    sin / (k * PI) * STEP * (-10_000..=10_000).map(term).sum::<f64>()
}

#[test]
fn it_meets_its_series_its_closed_form_and_its_tail() {
    for k in [0.1, 0.3, 0.5, 0.9, 0.99] {
        for x in [0.01, 0.1, 0.3] {
            let series: f64 = (0..60).map(|j| f64::powi(-x, j) / tgamma(1.0 + k * f64::from(j))).sum();
            let found = mittag_leffler(k, x);
            assert!((found - series).abs() < 1e-12, "{k} {x}: {found} {series}");
        }
        let far = mittag_leffler(k, 1e6);
        assert!((far * 1e6 * tgamma(1.0 - k) - 1.0).abs() < 1e-5, "{k}: {far}");
    }
    for x in [0.1, 1.0, 3.0, 10.0] {
        let closed = f64::exp(x * x) * erfc(x);
        assert!((mittag_leffler(0.5, x) / closed - 1.0).abs() < 1e-12);
    }
}
