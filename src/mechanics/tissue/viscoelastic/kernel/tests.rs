use super::*;

/// Computes weights by quadrature: u = lag - v^(1/k) removes the singularity; Simpson's rule on many points.
fn by_quadrature(k: f64, lag: f64, step: f64) -> [f64; 2] {
    const N: usize = 20_000;
    let near = lag - step;
    let (low, high) = (near.powf(k), lag.powf(k));
    let mut sums = [0.0; 2];
    for index in 0..=N {
        let v = low + (high - low) * index as f64 / N as f64;
        let u = v.powf(1.0 / k);
        let weight = if index == 0 || index == N {
            1.0
        } else {
            2.0 + 2.0 * (index % 2) as f64
        };
        sums[0] += weight * (u - near) / step;
        sums[1] += weight * (lag - u) / step;
    }
    sums.map(|sum| sum * (high - low) / (3.0 * N as f64) * inverse_gamma(1.0 + k))
}

#[test]
fn moments_are_those_of_quadrature() {
    for k in [0.1, 0.5, 0.9, 1.0] {
        for (lag, step) in [(1.0, 1.0), (2.0, 1.0), (3.0, 0.9), (4.5, 0.9), (1e3, 1.0), (7e-5, 1e-6)] {
            let [start, end] = by_quadrature(k, lag, step);
            let linear = Moments::new(Basis::Linear, k).weights(lag - step, step);
            let constant = Moments::new(Basis::Constant, k).weights(lag - step, step);
            // The quadrature itself is inaccurate where its integrand has a kink, at the newest interval.
            let bound = 1e-6 * (start + end);
            assert!(
                (linear.start - start).abs() < bound,
                "{k} {lag} {step}: {linear:?} {start}"
            );
            assert!((linear.end - end).abs() < bound, "{k} {lag} {step}: {linear:?} {end}");
            assert!((constant.end - start - end).abs() < bound && constant.start == 0.0);
        }
    }
}

#[test]
fn series_meets_powers() {
    for k in [1e-3, 0.1, 0.5, 0.999, 1.0] {
        // Powers lose 1/x^2 of their digits here, those of small orders more.
        for x in [0.2, 0.25, 0.3] {
            let (by_series, by_formula) = (series(k, x), closed(k, x, 1.0 - x, (-x).ln_1p()));
            for (by_series, by_formula) in by_series.iter().zip(by_formula) {
                assert!(
                    (by_series / by_formula - 1.0).abs() < 1e-13,
                    "{k} {x}: {by_series} {by_formula}"
                );
            }
        }
    }
}

#[test]
fn halves_make_up_the_whole_at_any_lag() {
    for k in [1e-3, 0.1, 0.5, 0.999, 1.0] {
        let (linear, constant) = (Moments::new(Basis::Linear, k), Moments::new(Basis::Constant, k));
        for exponent in 0..15 {
            let lag = 10f64.powi(exponent);
            let (ends, whole) = (linear.weights(lag - 1.0, 1.0), constant.weights(lag - 1.0, 1.0).end);
            assert!(ends.start > 0.0 && ends.end > 0.0);
            assert!(((ends.start + ends.end) / whole - 1.0).abs() < 1e-14, "{k} {lag}");
            // Far away the kernel is flat: both ends have equal weight.
            if exponent > 8 {
                let flat = 0.5 * k * inverse_gamma(1.0 + k) * lag.powf(k - 1.0);
                assert!((ends.start / flat - 1.0).abs() < 1e-8 && (ends.end / flat - 1.0).abs() < 1e-8);
            }
        }
    }
}

#[test]
fn limits_of_the_order() {
    let spring = Moments::new(Basis::Linear, 0.0);
    assert_eq!(spring.weights(0.0, 0.3), Ends { start: 0.0, end: 1.0 });
    assert_eq!(spring.weights(0.4, 0.3), Ends { start: 0.0, end: 0.0 });
    let dashpot = Moments::new(Basis::Linear, 1.0).weights(4.75, 0.25);
    assert!((dashpot.start - 0.125).abs() < 1e-16 && (dashpot.end - 0.125).abs() < 1e-16);
    assert_eq!(of_jump(-1.0, 3.0), 0.0);
    assert!((of_jump(1.0, 3.0) - 3.0).abs() < 1e-15 && of_jump(0.0, 3.0) == 1.0);
}

#[test]
fn a_short_lag_before_a_long_step_counts() {
    // All but 1e-12 of the step: the weights are those of the newest step minus the part in the short lag.
    for k in [1e-3, 0.1, 0.5, 0.999] {
        let (near, step) = (1e-9, 1e3);
        let (linear, constant) = (Moments::new(Basis::Linear, k), Moments::new(Basis::Constant, k));
        let expected = inverse_gamma(1.0 + k) * (f64::powf(near + step, k) - near.powf(k));
        assert!((constant.weights(near, step).end / expected - 1.0).abs() < 1e-13, "{k}");
        let ends = linear.weights(near, step);
        assert!(((ends.start + ends.end) / expected - 1.0).abs() < 1e-12, "{k}");
        let newest = linear.weights(0.0, step);
        assert!((ends.start / newest.start - 1.0).abs() < 1e-10, "{k}");
    }
}
