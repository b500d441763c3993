use super::*;

const ORDERS: [f64; 7] = [1e-6, 1e-3, 0.1, 0.5, 0.9, 0.999, 1.0 - 1e-9];

fn worst(order: f64, span: Span) -> (f64, usize) {
    let Quadrature { rates, weights } = Quadrature::new(order, span).unwrap();
    let points = 4000;
    let decades = (span.longest_s / span.shortest_s).ln();
    let errors = (0..=points).map(|index| {
        let t = span.shortest_s * (decades * index as f64 / points as f64).exp();
        let sum: f64 = rates
            .iter()
            .zip(&weights)
            .map(|(rate, weight)| weight * (-rate * t).exp())
            .sum();
        let exact = t.powf(order - 1.0) / tgamma(order);
        (sum / exact - 1.0).abs()
    });
    (errors.fold(0.0, f64::max), rates.len())
}

#[test]
fn the_kernel_is_met_within_the_bound() {
    for (shortest_s, longest_s) in [(1.0, 1.0), (1e-6, 1e6), (1e-6, 1e9), (1e3, 2e3), (1e-15, 1e15)] {
        for tolerance in [1e-2, 1e-6, 1e-9, 1e-12] {
            let span = Span {
                shortest_s,
                longest_s,
                tolerance,
            };
            for order in ORDERS {
                let (error, count) = worst(order, span);
                assert!(error <= tolerance, "{order} {span:?}: {error:e} with {count}");
            }
        }
    }
}

#[test]
fn the_bound_is_not_met_by_waste() {
    // The spacing is no finer than the bound requires: the error comes near it.
    let span = Span {
        shortest_s: 1e-6,
        longest_s: 1e6,
        tolerance: 1e-6,
    };
    let (error, count) = worst(0.5, span);
    assert!(error > 0.1 * span.tolerance && count < 80, "{error:e} with {count}");
}

#[test]
fn ends_of_the_order_are_exact() {
    let dashpot = Quadrature::new(1.0, Span::default()).unwrap();
    assert_eq!((dashpot.rates, dashpot.weights), (vec![0.0], vec![1.0]));
    assert!(Quadrature::new(0.0, Span::default()).unwrap().rates.is_empty());
}

#[test]
fn spans_are_checked() {
    let wrong = [
        (0.0, 1.0, 1e-6),
        (f64::NAN, 1.0, 1e-6),
        (2.0, 1.0, 1e-6),
        (1.0, f64::INFINITY, 1e-6),
        (1e-30, 1e30, 1e-6),
        (1.0, 2.0, 0.1),
        (1.0, 2.0, 1e-14),
        (1.0, 2.0, f64::NAN),
    ];
    for (shortest_s, longest_s, tolerance) in wrong {
        let span = Span {
            shortest_s,
            longest_s,
            tolerance,
        };
        assert!(
            matches!(Quadrature::new(0.5, span), Err(HistoryError::Span(_))),
            "{span:?}"
        );
    }
}
