//! Strain that crosses the knee back and forth, and what is refused.

use insonify_mechanics::tissue::nonlinear::{NonlinearError, Scheme, Solver, SolverOptions, Supports};
use std::sync::Arc;

use super::case::{block, difference, held, largest, law, options, pressed, pulled, target};

/// At most 30 iterations an increment is the criterion of the hard cases; the options of these tests allow no more.
#[test]
fn crossing_the_knee_does_not_cycle() {
    for poisson in [0.3, 0.499] {
        for scheme in [Scheme::Newton, Scheme::MODIFIED] {
            let (body, rollers, unit) = pulled(2, 4.0, law(poisson));
            let (mut solver, prescribed) = held(&body, &rollers, options(scheme));
            // The knee is at a strain of 0.1 / (1 + nu): 0.77 and 0.67 kPa.
            for (step, stress) in [0.6, 0.9, 0.2, 4.0, 0.7, -0.8, 0.8, -5.0, 0.65, 0.78]
                .iter()
                .cycle()
                .take(40)
                .enumerate()
            {
                let loads: Vec<f64> = unit.iter().map(|f| f * stress).collect();
                let progress = solver.step(&target(&loads, &prescribed));
                let progress = progress.unwrap_or_else(|error| panic!("{error} at step {step}, {scheme:?}"));
                assert!(progress.iterations <= 30 && progress.residual() <= 1e-12);
            }
            solver.step(&target(&vec![0.0; unit.len()], &prescribed)).unwrap();
            assert!(largest(solver.displacement()) < 1e-9);
        }
    }
}

/// A corner pressed in far beyond the knee, in one increment and in many: the law has no memory.
#[test]
fn the_way_does_not_matter() {
    let body = block([4, 4, 4], 2.0, 0.2, law(0.499));
    let driven = pressed(&body, 8.0, [-2.4, 0.0]);
    let (mut at_once, last) = held(&body, &driven, options(Scheme::Newton));
    let loads = vec![0.0; 3 * body.nodes().len()];
    at_once.step(&target(&loads, &last)).unwrap();
    for scheme in [Scheme::Newton, Scheme::MODIFIED] {
        let (mut slowly, _) = held(
            &body,
            &driven,
            SolverOptions {
                iterations: 60,
                ..options(scheme)
            },
        );
        for step in 1..=12 {
            let part: Vec<f64> = last.iter().map(|u| u * f64::from(step) / 12.0).collect();
            slowly.step(&target(&loads, &part)).unwrap();
        }
        let off = difference(at_once.displacement(), slowly.displacement());
        assert!(off < 1e-8, "{off:e} with {scheme:?}");
    }
    assert!(largest(&body.relative_strains(at_once.displacement())) > 0.3);
}

#[test]
fn what_cannot_be_solved_is_told() {
    let (body, rollers, unit) = pulled(2, 4.0, law(0.3));
    let few = SolverOptions {
        iterations: 2,
        ..options(Scheme::Newton)
    };
    let (mut solver, prescribed) = held(&body, &rollers, few);
    let loads: Vec<f64> = unit.iter().map(|f| 20.0 * f).collect();
    let error = solver.step(&target(&loads, &prescribed)).unwrap_err();
    let NonlinearError::NotConverged {
        iterations: 2,
        residual,
        tolerance: 1e-12,
    } = error
    else {
        panic!("{error}");
    };
    assert!(residual > 1e-12);
    // As before.
    assert_eq!(largest(solver.displacement()), 0.0);
    let error = solver.step(&target(&loads[1..], &prescribed)).unwrap_err();
    assert!(matches!(error, NonlinearError::Length { .. }), "{error}");
    let mut wrong = loads.clone();
    wrong[4] = f64::NAN;
    let error = solver.step(&target(&wrong, &prescribed)).unwrap_err();
    assert!(matches!(error, NonlinearError::NotFinite { at: 4, .. }), "{error}");
    let free = Solver::new(Arc::clone(&body), Supports::new(body.nodes().len(), []), few);
    assert!(matches!(free, Err(NonlinearError::Factor(_))), "rigid motions are free");
}
