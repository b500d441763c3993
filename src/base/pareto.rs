//! Choice among variants by cost and error.

/// Returns the Pareto front from left to right: the points that no other beats in both coordinates, smaller being
/// better.
pub fn front(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let finite = |point: &&[f64; 2]| point.iter().all(|x| x.is_finite());
    let mut sorted: Vec<[f64; 2]> = points.iter().filter(finite).copied().collect();
    sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut least = f64::INFINITY;
    sorted.retain(|point| {
        let best = point[1] < least;
        least = least.min(point[1]);
        best
    });
    sorted
}

/// Variant with the least error within a cost.
#[derive(Clone, Copy, Debug)]
pub struct Choice<'a, T> {
    /// Chosen variant.
    pub taken: &'a T,
    /// Whether its cost is within the limit; if not, it is the cheapest.
    pub met: bool,
    /// Cheapest variant with a smaller error.
    pub better: Option<&'a T>,
}

/// Chooses, by the cost and error that `weigh` returns, the least error within a limit of cost, and the cheaper of two
/// with equal errors; if none is within the limit, the cheapest. Errors within the factor `same` of one another count
/// as equal for `better`.
pub fn choose<T>(candidates: &[T], limit: f64, same: f64, weigh: impl Fn(&T) -> [f64; 2]) -> Option<Choice<'_, T>> {
    let [by_cost, by_error] = [0, 1].map(|first: usize| {
        let weigh = &weigh;
        move |a: &&T, b: &&T| {
            let (a, b) = (weigh(a), weigh(b));
            a[first]
                .total_cmp(&b[first])
                .then(a[1 - first].total_cmp(&b[1 - first]))
        }
    });
    let within = candidates
        .iter()
        .filter(|candidate| weigh(candidate)[0] <= limit)
        .min_by(by_error);
    let taken = within.or_else(|| candidates.iter().min_by(by_cost))?;
    let smaller = |candidate: &&T| same * weigh(candidate)[1] < weigh(taken)[1];
    Some(Choice {
        taken,
        met: within.is_some(),
        better: candidates.iter().filter(smaller).min_by(by_cost),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_front_is_what_nothing_beats() {
        let points = [[1.0, 1e-3], [10.0, 1e-7], [100.0, 1e-12], [20.0, 1e-2]];
        assert_eq!(front(&points), [[1.0, 1e-3], [10.0, 1e-7], [100.0, 1e-12]]);
        assert_eq!(
            front(&[[1.0, 2.0], [1.0, 1.0], [2.0, 1.0], [f64::NAN, 0.0]]),
            [[1.0, 1.0]]
        );
        assert!(front(&[]).is_empty());
    }

    #[test]
    fn the_least_error_within_the_limit_is_chosen_or_the_cheapest() {
        let candidates = [[3.0, 0.1], [1.0, 0.5], [2.0, 0.5], [2.5, 0.3]];
        let of = |limit| {
            choose(&candidates, limit, 1.0, |candidate| *candidate).map(|it| (*it.taken, it.met, it.better.copied()))
        };
        assert_eq!(of(2.0), Some(([1.0, 0.5], true, Some([2.5, 0.3]))));
        assert_eq!(of(9.0), Some(([3.0, 0.1], true, None)));
        assert_eq!(of(0.5), Some(([1.0, 0.5], false, Some([2.5, 0.3]))));
        assert!(choose(&[], 1.0, 1.0, |candidate: &[f64; 2]| *candidate).is_none());
    }
}
