//! Search for the minimum of a function of a few numbers without its derivatives.

use std::cmp::Ordering;

/// A point and the function's value there.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Evaluation {
    /// Arguments.
    pub point: Vec<f64>,
    /// Value there.
    pub cost: f64,
}

/// Searches by the method of Nelder and Mead (1965) with its usual coefficients 1, 2, 1/2 and 1/2, from a simplex with
/// a corner at `start` and one at a step along each axis. Ends when the standard deviation of the values at the corners
/// is below `tolerance`, after `max_iterations`, or at negative infinity. A trial value that cannot be compared (NaN)
/// makes the search fail: it returns `start` with an infinite cost.
///
/// # Errors
/// Errors of `cost`.
pub(crate) fn nelder_mead<E>(
    start: &[f64],
    steps: &[f64],
    tolerance: f64,
    max_iterations: u64,
    mut cost: impl FnMut(&[f64]) -> Result<f64, E>,
) -> Result<Evaluation, E> {
    let mut failed = None;
    let mut value = |point: &[f64]| cost(point).map_err(|error| failed = Some(error)).ok();
    let minimum = search(start, steps, tolerance, max_iterations, &mut value);
    match failed {
        Some(error) => Err(error),
        None => Ok(minimum.unwrap_or_else(|| Evaluation {
            point: start.to_vec(),
            cost: f64::INFINITY,
        })),
    }
}

/// Returns nothing where the function has no value or one that cannot be compared.
fn search(
    start: &[f64],
    steps: &[f64],
    tolerance: f64,
    max_iterations: u64,
    value: &mut dyn FnMut(&[f64]) -> Option<f64>,
) -> Option<Evaluation> {
    let mut corner = |point: Vec<f64>| value(&point).map(|cost| Evaluation { point, cost });
    let mut simplex = vec![corner(start.to_vec())?];
    for (axis, step) in steps.iter().enumerate() {
        let mut point = start.to_vec();
        point[axis] += step;
        simplex.push(corner(point)?);
    }
    let worst_index = simplex.len() - 1;
    let mut best = Evaluation {
        point: start.to_vec(),
        cost: f64::INFINITY,
    };
    for iteration in 0.. {
        // Equal corners keep their order.
        simplex.sort_by(|a, b| a.cost.partial_cmp(&b.cost).unwrap_or(Ordering::Equal));
        if simplex[0].cost < best.cost {
            best.clone_from(&simplex[0]);
        }
        let spread = deviation(&simplex);
        if worst_index == 0 || iteration >= max_iterations || spread < tolerance || best.cost == f64::NEG_INFINITY {
            break;
        }
        let centre = centroid(&simplex[..worst_index]);
        let [least, second, worst] = [0, worst_index - 1, worst_index].map(|corner| simplex[corner].cost);
        let reflected = corner(moved(&centre, [&simplex[worst_index].point, &centre], 1.0))?;
        let better = if reflected.cost < least {
            let expanded = corner(moved(&centre, [&centre, &reflected.point], 2.0))?;
            Some(if expanded.cost < reflected.cost {
                expanded
            } else {
                reflected
            })
        } else if reflected.cost < second && reflected.cost >= least {
            Some(reflected)
        } else if reflected.cost >= second {
            // Towards the better of the worst corner and its reflection.
            let outside = reflected.cost < worst;
            let end = if outside { &reflected } else { &simplex[worst_index] };
            let contracted = corner(moved(&centre, [&centre, &end.point], 0.5))?;
            let accepted = contracted.cost < end.cost || outside && contracted.cost == end.cost;
            accepted.then_some(contracted)
        } else {
            return None;
        };
        match better {
            Some(better) => simplex[worst_index] = better,
            None => {
                let (best, vertices) = simplex.split_first_mut()?;
                for vertex in vertices {
                    *vertex = corner(moved(&best.point, [&best.point, &vertex.point], 0.5))?;
                }
            }
        }
    }
    Some(best)
}

/// Standard deviation of the values at the corners.
fn deviation(simplex: &[Evaluation]) -> f64 {
    let count = simplex.len() as f64;
    let mean = simplex.iter().map(|corner| corner.cost).sum::<f64>() / count;
    let squares: f64 = simplex.iter().map(|corner| (corner.cost - mean).powi(2)).sum();
    (1.0 / (count - 1.0) * squares).sqrt()
}

fn centroid(corners: &[Evaluation]) -> Vec<f64> {
    let share = 1.0 / corners.len() as f64;
    let mut sum = corners[0].point.clone();
    for corner in &corners[1..] {
        sum.iter_mut().zip(&corner.point).for_each(|(sum, value)| *sum += value);
    }
    sum.into_iter().map(|sum| sum * share).collect()
}

/// The point a multiple `by` of the way `from` to `to` away from a point.
fn moved(point: &[f64], [from, to]: [&[f64]; 2], by: f64) -> Vec<f64> {
    let axes = point.iter().zip(from).zip(to);
    axes.map(|((point, from), to)| point + (to - from) * by).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quadratic_form_and_the_valley_of_rosenbrock_lead_to_their_minima() {
        let quadratic = |point: &[f64]| {
            let [x, y, z] = [point[0] - 1.0, point[1] + 2.0, point[2] - 3.0];
            Ok::<f64, ()>(x * x + 10.0 * y * y + 0.1 * z * z + x * y + 7.0)
        };
        let minimum = nelder_mead(&[0.0; 3], &[0.5; 3], 1e-14, 1000, quadratic).unwrap();
        for (argument, expected) in minimum.point.iter().zip([1.0, -2.0, 3.0]) {
            assert!((argument - expected).abs() < 1e-5, "{argument} {expected}");
        }
        assert!((minimum.cost - 7.0).abs() < 1e-9);
        let valley =
            |point: &[f64]| Ok::<f64, ()>((1.0 - point[0]).powi(2) + 100.0 * (point[1] - point[0] * point[0]).powi(2));
        let minimum = nelder_mead(&[-1.2, 1.0], &[0.5; 2], 1e-14, 1000, valley).unwrap();
        assert!(
            minimum.point.iter().all(|coordinate| (coordinate - 1.0).abs() < 1e-5),
            "{minimum:?}"
        );
        assert_eq!(
            minimum,
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
        let fails = |_: &[f64]| Err("first");
        assert_eq!(nelder_mead(&[0.0], &[1.0], 1e-9, 100, fails), Err("first"));
    }

    #[test]
    fn points_are_those_of_the_method() {
        let points = |cost: fn(f64) -> f64, max_iterations: u64| {
            let mut points = Vec::new();
            let run = |point: &[f64]| {
                points.push(point[0]);
                Ok::<f64, ()>(cost(point[0]))
            };
            let minimum = nelder_mead(&[0.0], &[1.0], 0.0, max_iterations, run).unwrap();
            (points, minimum.point[0])
        };
        // Reflected and expanded.
        assert_eq!(points(|x| -x, 1), (vec![0.0, 1.0, 2.0, 3.0], 3.0));
        assert_eq!(points(|x| (x - 2.0).abs(), 1), (vec![0.0, 1.0, 2.0, 3.0], 2.0));
        // Contracted inside, and outside.
        assert_eq!(points(|x| (x - 0.4).abs(), 1), (vec![0.0, 1.0, -1.0, 0.5], 0.5));
        assert_eq!(points(|x| (x + 0.2).abs(), 1), (vec![0.0, 1.0, -1.0, -0.5], 0.0));
        // Contracted without success, and shrunk.
        assert_eq!(
            points(|x| if x == 0.0 { 0.0 } else { 1.0 }, 1),
            (vec![0.0, 1.0, -1.0, 0.5, 0.5], 0.0)
        );
        assert_eq!(points(|x| x, 0), (vec![0.0, 1.0], 0.0));
    }

    #[test]
    fn equal_values_and_values_that_are_not_finite_end_the_search() {
        let run = |cost: fn(f64) -> f64, tolerance| {
            let mut calls = 0;
            let cost = |point: &[f64]| {
                calls += 1;
                Ok::<f64, ()>(cost(point[0]))
            };
            let minimum = nelder_mead(&[0.0], &[1.0], tolerance, 50, cost).unwrap();
            (calls, minimum.point[0], minimum.cost)
        };
        assert_eq!(run(|_| 3.0, 1e-9), (2, 0.0, 3.0));
        // The tolerance is not reached by equality.
        assert!(run(|_| 3.0, 0.0).0 > 50);
        assert_eq!(run(|x| if x < 1.0 { 1.0 } else { f64::NEG_INFINITY }, 1e-9).1, 1.0);
        assert_eq!(run(|_| f64::INFINITY, 1e-9).1, 0.0);
        assert_eq!(
            run(|x| if x < 2.0 { -x } else { f64::NAN }, 1e-9),
            (3, 0.0, f64::INFINITY)
        );
    }
}
