//! A pulse long ago.

use insonify_mechanics::tissue::viscoelastic::{History, Operator, Rule, Span};
use libm::tgamma;

const SPAN: Span = Span {
    shortest_s: 1e-6,
    longest_s: 1e8,
    tolerance: 1e-9,
};

fn next(history: &mut dyn History, step: f64, value: f64) -> f64 {
    let mut past = [0.0];
    history.predict(step, &mut past).unwrap() * value + past[0]
}

#[test]
fn what_ends_is_forgotten_at_the_rate_of_the_kernel() {
    // A pulse of 1 s, seen 1e5 s later through steps of 10 s: t^(k-1) / Gamma(k).
    for k in [1e-3, 0.1, 0.5, 0.999] {
        for rule in [Rule::Exponentials(SPAN), Rule::Trapezoid, Rule::Rectangle] {
            let mut history = rule.start(Operator::Integral(k), &[1.0]).unwrap();
            history.commit(1.0, &[1.0]).unwrap();
            history.commit(1e-6, &[0.0]).unwrap();
            for _ in 0..10_000 {
                history.commit(10.0, &[0.0]).unwrap();
            }
            let found = next(history.as_mut(), 10.0, 0.0);
            let t: f64 = 1e5 + 11.0;
            // The whole second, between t - 1 and t.
            let exact = t.powf(k) * -(k * (-1.0 / t).ln_1p()).exp_m1() / tgamma(1.0 + k);
            assert!((found / exact - 1.0).abs() < 2e-6, "{k} {rule:?}: {found:e} {exact:e}");
        }
    }
}
