use super::super::kernel::of_jump;
use super::*;

const SPAN: Span = Span {
    shortest_s: 1e-6,
    longest_s: 1e4,
    tolerance: 1e-10,
};
const RULES: [Rule; 5] = [
    Rule::Rectangle,
    Rule::Trapezoid,
    Rule::GruenwaldLetnikov,
    Rule::Exponentials(SPAN),
    Rule::TimeScaledTrapezoid,
];
const ORDERS: [f64; 6] = [0.0, 1e-3, 0.1, 0.5, 0.999, 1.0];
const OPERATORS: [fn(f64) -> Operator; 2] = [Operator::Integral, Operator::Derivative];

/// Returns the results for a function with values `of(t)` after each of some steps.
fn follow(history: &mut dyn History, steps: &[f64], function: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut t = 0.0;
    let mut results = Vec::new();
    for &step in steps {
        t += step;
        let mut past = [0.0];
        let weight = history.predict(step, &mut past).unwrap();
        results.push(weight * function(t) + past[0]);
        history.commit(step, &[function(t)]).unwrap();
    }
    results
}

#[test]
fn a_jump_at_the_start_is_exact_under_every_rule() {
    let even = [0.25; 40];
    let uneven: Vec<f64> = (0..40).map(|index| 10f64.powi(index % 9 - 6)).collect();
    for rule in RULES {
        for order in ORDERS {
            for operator in OPERATORS {
                let (operator, steps) = match rule {
                    Rule::GruenwaldLetnikov => (operator(order), &even[..]),
                    _ => (operator(order), &uneven[..]),
                };
                let mut history = rule.start(operator, &[2.0]).unwrap();
                let results = follow(history.as_mut(), steps, |_| 2.0);
                let exponent = if matches!(operator, Operator::Integral(_)) {
                    order
                } else {
                    -order
                };
                let mut t = 0.0;
                for (result, step) in results.iter().zip(steps) {
                    t += step;
                    let exact = 2.0 * of_jump(exponent, t);
                    // A value accurate to rounding has a derivative accurate to rounding times the weight of a step.
                    let bound = 1e-9 * exact + 32.0 * f64::EPSILON * step.powf(exponent);
                    assert!(
                        (result - exact).abs() <= bound,
                        "{rule:?} {operator:?} at {t}: {result} {exact}"
                    );
                }
            }
        }
    }
}

#[test]
fn ends_of_the_order_are_the_function_its_integral_and_its_derivative() {
    let steps = [0.5; 16];
    let function = |t: f64| 1.0 + 3.0 * t;
    for rule in RULES {
        for (operator, exact) in [
            (
                Operator::Integral(0.0),
                &(|t: f64| 1.0 + 3.0 * t) as &dyn Fn(f64) -> f64,
            ),
            (Operator::Derivative(0.0), &|t| 1.0 + 3.0 * t),
            (Operator::Derivative(1.0), &|_| 3.0),
            (Operator::Integral(1.0), &|t| t + 1.5 * t * t),
        ] {
            let mut history = rule.start(operator, &[1.0]).unwrap();
            for (index, result) in follow(history.as_mut(), &steps, function).iter().enumerate() {
                let t = 0.5 * (index + 1) as f64;
                // The first-order rules use the value at the end of a step for all of it.
                let is_first_order = matches!(rule, Rule::Rectangle | Rule::GruenwaldLetnikov);
                let late = if is_first_order && operator == Operator::Integral(1.0) {
                    0.5 * 1.5 * t
                } else {
                    0.0
                };
                assert!(
                    (result - exact(t) - late).abs() < 1e-11,
                    "{rule:?} {operator:?}: {result}"
                );
            }
        }
    }
}

#[test]
fn components_are_kept_apart_and_predictions_change_nothing() {
    for rule in RULES {
        for operator in OPERATORS.map(|operator| operator(0.3)) {
            let mut three = rule.start(operator, &[1.0, 0.0, -2.0]).unwrap();
            let mut third = rule.start(operator, &[-2.0]).unwrap();
            for index in 0..70 {
                // A step of another length in between discards the cached weights.
                if !matches!(rule, Rule::GruenwaldLetnikov) {
                    three.predict(0.7, &mut [0.0; 3]).unwrap();
                }
                let (mut three_sums, mut third_sum) = ([9.0; 3], [9.0]);
                let weight = three.predict(0.1, &mut three_sums).unwrap();
                assert_eq!(weight, third.predict(0.1, &mut third_sum).unwrap());
                assert!(
                    (three_sums[2] - third_sum[0]).abs() < 1e-12 * third_sum[0].abs().max(1.0),
                    "{rule:?} {operator:?}"
                );
                assert_eq!(three_sums[1], 0.0);
                let value = (index as f64).sin();
                three.commit(0.1, &[1.0, 0.0, value]).unwrap();
                third.commit(0.1, &[value]).unwrap();
            }
            assert!((three.time_s() - 7.0).abs() < 1e-12 && three.components() == 3);
            // A copy continues identically.
            let mut copy = three.clone();
            let (mut three_sums, mut copy_sums) = ([0.0; 3], [0.0; 3]);
            three.predict(0.1, &mut three_sums).unwrap();
            copy.predict(0.1, &mut copy_sums).unwrap();
            assert_eq!(three_sums, copy_sums);
        }
    }
}

#[test]
fn what_is_wrong_is_refused_and_changes_nothing() {
    for rule in RULES {
        for order in [-0.1, 1.1, f64::NAN, f64::INFINITY] {
            let refusal = rule.start(Operator::Integral(order), &[0.0]).unwrap_err();
            assert!(matches!(refusal, HistoryError::Order { .. }));
        }
        assert!(matches!(
            rule.start(Operator::Derivative(0.5), &[0.0, f64::NAN]).unwrap_err(),
            HistoryError::Value { component: 1, .. }
        ));
        for operator in OPERATORS {
            let mut history = rule.start(operator(0.5), &[1.0]).unwrap();
            history.commit(0.1, &[2.0]).unwrap();
            let mut before = [0.0];
            history.predict(0.1, &mut before).unwrap();
            for step in [0.0, -1.0, f64::NAN, f64::INFINITY] {
                assert!(matches!(
                    history.predict(step, &mut [0.0]),
                    Err(HistoryError::Step { .. })
                ));
                assert!(matches!(history.commit(step, &[0.0]), Err(HistoryError::Step { .. })));
            }
            assert!(matches!(
                history.commit(0.1, &[f64::INFINITY]),
                Err(HistoryError::Value { .. })
            ));
            assert!(matches!(
                history.commit(0.1, &[0.0; 2]),
                Err(HistoryError::Components { .. })
            ));
            assert!(matches!(
                history.predict(0.1, &mut []),
                Err(HistoryError::Components { .. })
            ));
            let mut after = [0.0];
            history.predict(0.1, &mut after).unwrap();
            assert_eq!(before, after);
        }
    }
    let mut gruenwald = Rule::GruenwaldLetnikov.start(Operator::Integral(0.5), &[1.0]).unwrap();
    gruenwald.commit(0.1, &[1.0]).unwrap();
    let uneven = gruenwald.predict(0.11, &mut [0.0]).unwrap_err();
    assert!(uneven.to_string().contains("equal steps"), "{uneven}");
    gruenwald.commit(0.1 + 1e-12, &[1.0]).unwrap();
}

#[test]
fn exponentials_take_the_same_memory_however_long() {
    let mut history = RULES[3].start(Operator::Integral(0.5), &[0.0; 4]).unwrap();
    let mut full = Rule::Trapezoid.start(Operator::Integral(0.5), &[0.0; 4]).unwrap();
    history.commit(0.1, &[1.0; 4]).unwrap();
    let bytes = history.bytes();
    for _ in 0..1000 {
        history.commit(0.1, &[1.0; 4]).unwrap();
        full.commit(0.1, &[1.0; 4]).unwrap();
    }
    assert_eq!(history.bytes(), bytes);
    assert!(full.bytes() > 1000 * 4 * 8);
}

/// A history that restores the state of another continues with the same bits; numbers that are not a state change
/// nothing. Other rules refuse any state.
#[test]
fn what_is_remembered_is_recalled() {
    let value = |t: f64| [(3.0 * t).sin(), 1.0 + t];
    let steps: [f64; 12] = std::array::from_fn(|index| 0.5 + 0.1 * (index % 3) as f64);
    let operator = Operator::Integral(0.3);
    let start = |initial: &[f64]| Rule::Exponentials(SPAN).start(operator, initial).unwrap();
    let mut history = start(&[0.5, -1.0]);
    let mut t = 0.0;
    for step in &steps[..7] {
        t += step;
        history.commit(*step, &value(t)).unwrap();
    }
    let remembered = history.remembered();
    let mut recalled = start(&[7.0, 8.0]);
    recalled.commit(0.5, &[1.0, 2.0]).unwrap();
    let before = recalled.remembered();
    let mut broken = remembered.clone();
    broken.push(1.0);
    assert!(matches!(recalled.recall(&broken), Err(HistoryError::Remembered { .. })));
    broken.truncate(remembered.len());
    broken[1] = f64::NAN;
    assert!(matches!(recalled.recall(&broken), Err(HistoryError::Remembered { .. })));
    assert_eq!(recalled.remembered(), before);
    recalled.recall(&remembered).unwrap();
    assert_eq!(recalled.time_s(), history.time_s());
    for step in &steps[7..] {
        t += step;
        let [mut a, mut b] = [[0.0; 2]; 2];
        let weights = [
            history.predict(*step, &mut a).unwrap(),
            recalled.predict(*step, &mut b).unwrap(),
        ];
        assert!(weights[0] == weights[1] && a == b, "{a:?} {b:?}");
        history.commit(*step, &value(t)).unwrap();
        recalled.commit(*step, &value(t)).unwrap();
    }
    let mut trapezoid = Rule::Trapezoid.start(operator, &[0.5, -1.0]).unwrap();
    let remembered = trapezoid.remembered();
    assert_eq!(
        trapezoid.recall(&remembered),
        Err(HistoryError::Remembered { found: 0 })
    );
}
