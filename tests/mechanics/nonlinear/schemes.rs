//! Convergence of the schemes.

use insonify_mechanics::tissue::nonlinear::{Scheme, Slope, SolverOptions, Stiffening};

use super::case::{Held, at, block, difference, held, law, newton_orders, options, pressed, pulled, target};
use insonify_mechanics::tissue::material::Material;

/// The number of correct digits doubles: in the last iterations before rounding the order is 2.
#[test]
fn newton_is_quadratic() {
    for poisson in [0.3, 0.45] {
        let (orders, left) = newton_orders(law(poisson));
        assert!(
            !orders.is_empty() && orders.iter().all(|order| *order > 1.6),
            "{orders:?} of {left:?}"
        );
        let best = orders.last().unwrap();
        assert!(*best > 1.8, "{orders:?} of {left:?}");
    }
}

/// With the factor of the unstrained body an iteration leaves |1 - E_t / E0| of the error of a bar. Its tangent above
/// the knee, at a strain that a load is chosen for, makes this 0.36; below the rate at which the factor would be
/// renewed.
#[test]
fn modified_newton_is_linear_at_its_rate() {
    let law = law(0.0);
    let (body, rollers, unit) = pulled(2, 4.0, law);
    let (mut solver, prescribed) = held(&body, &rollers, options(Scheme::Modified { memory: 0 }));
    let strain = 0.15;
    let stress = 10.0 * law.secant(strain) * strain;
    let rate = law.tangent(strain) - 1.0;
    assert!((rate - 0.35).abs() < 0.01, "{rate}");
    let loads: Vec<f64> = unit.iter().map(|f| f * stress).collect();
    let progress = solver.step(&target(&loads, &prescribed)).unwrap();
    assert_eq!(progress.factorisations, 0);
    let tail: Vec<f64> = progress
        .residuals
        .windows(2)
        .filter(|r| r[0] < 1e-4 && r[1] > 1e-11)
        .map(|r| r[1] / r[0])
        .collect();
    assert!(
        tail.len() > 5 && tail.iter().all(|ratio| (ratio / rate - 1.0).abs() < 0.02),
        "{tail:?}, expected {rate}"
    );
}

/// An increment is predicted from the error of the one before: equal increments past the knee take about half the
/// iterations of the plain method, and going back one, elastic as the body is, takes next to none.
#[test]
fn increments_alike_take_few_iterations() {
    let body = block([4, 4, 4], 2.0, 0.2, law(0.45));
    let driven = pressed(&body, 8.0, [-1.6, 0.0]);
    let loads = vec![0.0; 3 * body.nodes().len()];
    let walk = |scheme, shares: &[f64]| -> Vec<usize> {
        let loose = SolverOptions {
            tolerance: 1e-6,
            ..options(scheme)
        };
        let (mut solver, last) = held(&body, &driven, loose);
        let mut go = |share: &f64| {
            let part: Vec<f64> = last.iter().map(|u| u * share).collect();
            solver.step(&target(&loads, &part)).unwrap().iterations
        };
        shares.iter().map(&mut go).collect()
    };
    let shares: Vec<f64> = (1..=20).map(|at| f64::from(at) / 20.0).collect();
    let total = |scheme| walk(scheme, &shares)[10..].iter().sum::<usize>();
    let (plain, learning) = (total(Scheme::Modified { memory: 0 }), total(Scheme::MODIFIED));
    assert!(3 * learning <= 2 * plain, "{learning} of {plain}");
    let there_and_back = [&shares[..], &[0.95, 1.0, 0.95, 1.0]].concat();
    let back = &walk(Scheme::MODIFIED, &there_and_back)[21..];
    assert!(back.iter().all(|iterations| *iterations <= 2), "{back:?}");
}

/// In proportional straining Euler's method with Kobayashi et al.'s tangent has order one in the length of the
/// increments; elsewhere it needs the consistent tangent or the balance put right. With both it is a Newton iteration
/// an increment, whose error is the square of the increment.
#[test]
fn euler_has_its_order() {
    let soft = |rate| Stiffening::new(Material::new(10.0, 0.3).unwrap(), 0.05, rate).unwrap();
    // Proportional: a bar.
    let (body, rollers, unit) = pulled(2, 4.0, soft(10.0));
    let loads: Vec<f64> = unit.iter().map(|f| f * 4.0).collect();
    let paper = Scheme::Euler {
        slope: Slope::Scalar,
        corrected: false,
    };
    orders(&body, &rollers, &loads, &[(paper, 1.0)]);
    // Not so: a block pressed at a corner while it is sheared.
    let body = block([3, 3, 3], 2.0, 0.2, soft(10.0));
    let mut fixed: Held = Vec::new();
    for node in at(&body, 2, 0.0) {
        fixed.extend((0..3).map(|axis| (node, axis, 0.0)));
    }
    let mut loads = vec![0.0; 3 * body.nodes().len()];
    for node in at(&body, 2, 6.0) {
        loads[3 * node as usize] = 1.5e-3;
        loads[3 * node as usize + 2] = if body.nodes()[node as usize][0] < 3.0 {
            -4e-3
        } else {
            1e-3
        };
    }
    let schemes = [
        (Slope::Consistent, false, 1.0),
        (Slope::Scalar, true, 1.0),
        (Slope::Consistent, true, 2.0),
    ];
    let schemes = schemes.map(|(slope, corrected, order)| (Scheme::Euler { slope, corrected }, order));
    orders(&body, &fixed, &loads, &schemes);
    // Kobayashi et al.'s tangent alone stays away, whatever the increments: what it comes to as they vanish, by
    // extrapolation.
    let [coarse, fine] = [256, 512].map(|steps| error(&body, &fixed, &loads, paper, steps));
    let drift = 2.0 * fine - coarse;
    assert!(
        drift > 0.1 * fine && drift > 1e-4 && drift < 0.1,
        "{drift:e} from {coarse:e} and {fine:e}"
    );
}

fn orders(
    body: &std::sync::Arc<insonify_mechanics::tissue::nonlinear::Solid>,
    fixed: &Held,
    loads: &[f64],
    schemes: &[(Scheme, f64)],
) {
    for &(scheme, expected) in schemes {
        let errors: Vec<f64> = [64, 128, 256]
            .iter()
            .map(|&steps| error(body, fixed, loads, scheme, steps))
            .collect();
        let order = (errors[1] / errors[2]).log2();
        assert!(
            (order - expected).abs() < 0.2,
            "{scheme:?}: order {order} of {errors:?}"
        );
    }
}

/// The error at the end, relative to full Newton's solution.
fn error(
    body: &std::sync::Arc<insonify_mechanics::tissue::nonlinear::Solid>,
    fixed: &Held,
    loads: &[f64],
    scheme: Scheme,
    steps: u32,
) -> f64 {
    let (mut exact, prescribed) = held(body, fixed, options(Scheme::Newton));
    exact.step(&target(loads, &prescribed)).unwrap();
    let (mut euler, _) = held(
        body,
        fixed,
        SolverOptions {
            scheme,
            ..options(scheme)
        },
    );
    for step in 1..=steps {
        let part: Vec<f64> = loads.iter().map(|f| f * f64::from(step) / f64::from(steps)).collect();
        euler.step(&target(&part, &prescribed)).unwrap();
    }
    difference(euler.displacement(), exact.displacement()) / super::case::largest(exact.displacement())
}
