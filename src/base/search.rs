//! Search for the minimum of a function of a few numbers without its derivatives.

use std::cell::RefCell;

use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;

/// Minimum found.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Arguments.
    pub at: Vec<f64>,
    /// Value there.
    pub cost: f64,
}

struct Problem<F, E> {
    cost: RefCell<F>,
    failed: RefCell<Option<E>>,
}

impl<F: FnMut(&[f64]) -> Result<f64, E>, E> CostFunction for &Problem<F, E> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, at: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        (self.cost.borrow_mut())(at).map_err(|error| {
            self.failed.replace(Some(error));
            argmin::core::Error::msg("the function failed")
        })
    }
}

/// Searches by the method of Nelder and Mead (1965) with its usual coefficients 1, 2, 1/2 and 1/2, from a simplex with a corner at `start` and one at
/// a step along each axis. Ends when the standard deviation of the values at the corners is below `tolerance`, or after `most` iterations.
///
/// # Errors
/// Errors of `cost`.
pub fn nelder_mead<E>(
    start: &[f64],
    steps: &[f64],
    tolerance: f64,
    most: u64,
    cost: impl FnMut(&[f64]) -> Result<f64, E>,
) -> Result<Found, E> {
    let mut simplex = vec![start.to_vec(); start.len() + 1];
    for (axis, step) in steps.iter().enumerate() {
        simplex[axis + 1][axis] += step;
    }
    let problem = Problem {
        cost: RefCell::new(cost),
        failed: RefCell::new(None),
    };
    let solver = NelderMead::new(simplex);
    let solver = solver
        .with_sd_tolerance(tolerance.max(0.0))
        .unwrap_or_else(|_| NelderMead::new(vec![start.to_vec()]));
    let run = Executor::new(&problem, solver)
        .configure(|state| state.max_iters(most))
        .timer(false)
        .run();
    let best = run.ok().and_then(|run| {
        let cost = run.state.best_cost;
        run.state.best_param.map(|at| Found { at, cost })
    });
    if let Some(error) = problem.failed.take() {
        return Err(error);
    }
    Ok(best.unwrap_or_else(|| Found {
        at: start.to_vec(),
        cost: f64::INFINITY,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadratic_form_and_the_valley_of_rosenbrock_lead_to_their_minima() {
        let quadratic = |at: &[f64]| {
            let [x, y, z] = [at[0] - 1.0, at[1] + 2.0, at[2] - 3.0];
            Ok::<f64, ()>(x * x + 10.0 * y * y + 0.1 * z * z + x * y + 7.0)
        };
        let found = nelder_mead(&[0.0; 3], &[0.5; 3], 1e-14, 1000, quadratic).unwrap();
        for (found, expected) in found.at.iter().zip([1.0, -2.0, 3.0]) {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
        assert!((found.cost - 7.0).abs() < 1e-9);
        let valley = |at: &[f64]| Ok::<f64, ()>((1.0 - at[0]).powi(2) + 100.0 * (at[1] - at[0] * at[0]).powi(2));
        let found = nelder_mead(&[-1.2, 1.0], &[0.5; 2], 1e-14, 1000, valley).unwrap();
        assert!(found.at.iter().all(|at| (at - 1.0).abs() < 1e-5), "{found:?}");
        assert_eq!(
            found,
            nelder_mead(&[-1.2, 1.0], &[0.5; 2], 1e-14, 1000, valley).unwrap()
        );
    }

    #[test]
    fn errors_of_the_function_end_the_search() {
        let mut calls = 0;
        let fails = |_: &[f64]| {
            calls += 1;
            if calls < 5 { Ok(f64::from(calls)) } else { Err("fifth") }
        };
        assert_eq!(nelder_mead(&[0.0], &[1.0], 1e-9, 100, fails), Err("fifth"));
    }
}
