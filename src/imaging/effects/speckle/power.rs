//! Mean power of weighted sums of scatterers, which are correlated by the linear interpolation of their lattice.

use std::sync::LazyLock;

/// Correlation of the interpolated lattice at a distance in lattice steps along one of its axes, averaged over all
/// positions.
///
/// With weights `1 - f` and `f` scaled to unit power everywhere it is a little wider than the cubic B-spline that the
/// unscaled ones would give. Tabulated, with an error below 1e-4.
pub(crate) fn lattice_correlation(steps: f64) -> f64 {
    const PER_STEP: usize = 128;
    static TABLE: LazyLock<Vec<f64>> = LazyLock::new(|| {
        (0..=2 * PER_STEP)
            .map(|step| averaged_correlation(step as f64 / PER_STEP as f64))
            .chain([0.0])
            .collect()
    });
    let position = steps.abs() * PER_STEP as f64;
    let (before, share) = (position as usize, position.fract());
    match TABLE.get(before..before + 2) {
        Some(values) => values[0] + share * (values[1] - values[0]),
        None => 0.0,
    }
}

fn averaged_correlation(steps: f64) -> f64 {
    const PLACES: usize = 512;
    // The two lattice points around a position, and their weights.
    let weights = |position: f64| {
        let share = position.fract();
        let norm = share.hypot(1.0 - share);
        (position.floor(), [(1.0 - share) / norm, share / norm])
    };
    let correlation_at = |position: usize| {
        let position = (position as f64 + 0.5) / PLACES as f64;
        let ((first, a), (other, b)) = (weights(position), weights(position + steps));
        match (other - first) as usize {
            0 => a[0] * b[0] + a[1] * b[1],
            1 => a[1] * b[0],
            _ => 0.0,
        }
    };
    (0..PLACES).map(correlation_at).sum::<f64>() / PLACES as f64
}

/// Correlations at up to `count` whole distances in steps, as far as there are any.
pub(super) fn correlations(count: usize, correlation: impl Fn(f64) -> f64) -> Vec<f64> {
    let by_distance = (0..count).map(|steps| correlation(steps as f64));
    by_distance.take_while(|correlation| *correlation > 0.0).collect()
}

/// Mean power of a weighted sum of values of unit power with given [`correlations`].
pub(super) fn power(weights: &[f64], correlations: &[f64]) -> f64 {
    let row = |i: usize| -> f64 {
        let others = (i + 1).saturating_sub(correlations.len())..(i + correlations.len()).min(weights.len());
        others.map(|j| weights[j] * correlations[i.abs_diff(j)]).sum()
    };
    weights.iter().enumerate().map(|(i, w)| w * row(i)).sum()
}

/// Factor that restores the mean power of a kernel of unit power at index `index` of `count`, truncated at both
/// ends.
pub(super) fn restored(weights: &[f64], index: usize, count: usize, correlations: &[f64]) -> f64 {
    let reach = weights.len() / 2;
    let first = reach.saturating_sub(index);
    let last = (count - index + reach).min(weights.len());
    if last - first == weights.len() {
        return 1.0;
    }
    1.0 / power(&weights[first..last], correlations).sqrt()
}

pub(super) fn unit_power(weights: Vec<f64>, correlation: impl Fn(f64) -> f64) -> Vec<f64> {
    let scale = 1.0 / power(&weights, &correlations(weights.len(), correlation)).sqrt();
    weights.into_iter().map(|weight| weight * scale).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_is_the_sum_over_all_pairs() {
        let weights: Vec<f64> = (0..23).map(|i| (f64::from(i) * 1.7).sin().abs()).collect();
        for step in [0.01, 0.3, 0.7, 1.9, 2.5] {
            let of = |steps: f64| lattice_correlation(steps * step);
            let pair = |i: usize, j: usize| weights[i] * weights[j] * of(i.abs_diff(j) as f64);
            let all: f64 = (0..23).map(|i| (0..23).map(|j| pair(i, j)).sum::<f64>()).sum();
            let banded = power(&weights, &correlations(weights.len(), of));
            assert!((banded / all - 1.0).abs() < 1e-12, "{step}: {banded} {all}");
        }
    }
}
