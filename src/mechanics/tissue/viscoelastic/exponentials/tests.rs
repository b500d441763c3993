use super::*;

#[test]
fn a_step_is_integrated_exactly() {
    // Simpson's rule applied to the integral itself.
    let by_simpson = |z: f64, function: &dyn Fn(f64) -> f64| {
        let n = 2000;
        let term = |index: usize| {
            let q = index as f64 / n as f64;
            let weight = if index == 0 || index == n {
                1.0
            } else {
                2.0 + 2.0 * (index % 2) as f64
            };
            weight * (-z * (1.0 - q)).exp() * function(q)
        };
        (0..=n).map(term).sum::<f64>() / (3.0 * n as f64)
    };
    for z in [0.0, 1e-12, 1e-3, 0.1, 0.4999, 0.5001, 1.0, 3.0, 20.0] {
        let [start, end] = ends(z, (-z).exp());
        let (start_integral, end_integral) = (by_simpson(z, &|q| 1.0 - q), by_simpson(z, &|q| q));
        // Error of Simpson's rule: h^4 z^4 / 180.
        let bound = 1e-14 + (z / 2000.0).powi(4) / 100.0;
        assert!(
            (start - start_integral).abs() < bound && (end - end_integral).abs() < bound,
            "{z}"
        );
        assert!((mean(z) - start - end).abs() < 1e-15);
    }
    assert_eq!(ends(1e10, 0.0), [(1e-10) / 1e10, (1.0 - 1e-10) / 1e10]);
}

#[test]
fn times_outside_the_span_are_refused() {
    let span = Span {
        shortest_s: 0.1,
        longest_s: 1.0,
        tolerance: 1e-6,
    };
    let mut history = Exponentials::new(Basis::Linear, 0.3, span, &[1.0]).unwrap();
    let short = history.predict(0.05, &mut [0.0]).unwrap_err();
    assert!(matches!(short, HistoryError::Short { found, .. } if found == 0.05));
    for _ in 0..10 {
        history.commit(0.1, &[1.0]).unwrap();
    }
    let long = history.commit(0.1, &[1.0]).unwrap_err();
    assert!(matches!(long, HistoryError::Long { .. }));
    assert!((history.time_s() - 1.0).abs() < 1e-15);
}
