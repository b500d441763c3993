//! Steps of any length, many of them, and sudden reversals.

use insonify::mechanics::tissue::viscoelastic::{History, Operator, Rule, Span};
use libm::tgamma;

const ORDERS: [f64; 6] = [0.0, 1e-3, 0.1, 0.5, 0.999, 1.0];
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
fn steps_that_change_by_1e9_are_exact_for_linear_functions() {
    // Up from 1 us to 1,000 s and down again, and jumps between the two.
    let swell = (0..=90)
        .chain((0..90).rev())
        .map(|at| 10f64.powf(0.1 * f64::from(at) - 6.0));
    let jumps = (0..60).map(|at| if at % 2 == 0 { 1e-6 } else { 1e3 });
    let steps: Vec<f64> = swell.chain(jumps).collect();
    for k in ORDERS {
        for (rule, bound) in [(Rule::Trapezoid, 1e-12), (Rule::Exponentials(SPAN), 1e-9)] {
            let mut history = rule.start(Operator::Integral(k), &[3.0]).unwrap();
            let mut t = 0.0;
            for (at, &step) in steps.iter().enumerate() {
                t += step;
                let found = next(history.as_mut(), step, 3.0 + 2.0 * t);
                let exact = 3.0 * t.powf(k) / tgamma(1.0 + k) + 2.0 * t.powf(1.0 + k) / tgamma(2.0 + k);
                assert!(
                    (found / exact - 1.0).abs() < bound,
                    "{k} {rule:?} step {at}: {found} {exact}"
                );
                history.commit(step, &[3.0 + 2.0 * t]).unwrap();
            }
        }
    }
}

#[test]
fn a_hundred_thousand_steps_neither_grow_nor_drift() {
    const STEPS: i32 = 100_000;
    for k in ORDERS {
        let mut fast = Rule::Exponentials(SPAN).start(Operator::Integral(k), &[1.0]).unwrap();
        let mut full = Rule::Trapezoid.start(Operator::Integral(k), &[1.0]).unwrap();
        for at in 1..=STEPS {
            let t = 1e-3 * f64::from(at);
            // Reversed at every step, around 1.
            let value = if at % 2 == 0 { 1.5 } else { 0.5 };
            if at % 20_000 == 0 {
                let (found, other) = (next(fast.as_mut(), 1e-3, value), next(full.as_mut(), 1e-3, value));
                assert!((found / other - 1.0).abs() < 2e-9, "{k} at {t}: {found} {other}");
                // The mean decides, but for the newest reversals.
                let mean = t.powf(k) / tgamma(1.0 + k);
                assert!(
                    (found - mean).abs() <= 0.5 * 1e-3f64.powf(k) * 1.01,
                    "{k} at {t}: {found} {mean}"
                );
            }
            fast.commit(1e-3, &[value]).unwrap();
            full.commit(1e-3, &[value]).unwrap();
        }
    }
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
