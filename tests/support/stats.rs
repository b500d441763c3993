//! Statistics of fields and fits of orders.

pub(crate) use insonify_base::statistics::{correlation, mean, slope, std};

/// Root mean square.
pub(crate) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
}

/// Largest distance between the distribution of a sample and `cumulative` (Kolmogorov and Smirnov), times the root of
/// its size; above 1.628 in one of a hundred samples.
pub(crate) fn kolmogorov_smirnov(mut sample: Vec<f64>, cumulative: impl Fn(f64) -> f64) -> f64 {
    sample.sort_by(f64::total_cmp);
    let n = sample.len() as f64;
    let distance = sample
        .iter()
        .enumerate()
        .map(|(at, &x)| {
            let expected = cumulative(x);
            (expected - at as f64 / n)
                .abs()
                .max(((at + 1) as f64 / n - expected).abs())
        })
        .fold(0.0, f64::max);
    distance * n.sqrt()
}

/// Slope of ln(error) over ln(step) by least squares: the order of convergence.
pub(crate) fn order(steps: &[f64], errors: &[f64]) -> f64 {
    let x: Vec<f64> = steps.iter().map(|step| step.ln()).collect();
    let y: Vec<f64> = errors.iter().map(|error| error.ln()).collect();
    slope(&x, &y)
}

/// Full width at half maximum of a correlation that falls below one half.
pub(crate) fn full_width(correlations: &[f64], step: f64) -> f64 {
    insonify_base::statistics::full_width(correlations, step).expect("a correlation that falls below one half")
}

/// Where a correlation peaks between whole lags: the vertex of a parabola through the logarithms of the largest value
/// and its neighbours, which is exact for a Gaussian peak. `correlations[i]` is that at lag `first + i`.
pub(crate) fn peak(correlations: &[f64], first: i64) -> f64 {
    let best = (1..correlations.len() - 1)
        .max_by(|&a, &b| correlations[a].total_cmp(&correlations[b]))
        .expect("three lags at least");
    let [before, at, after] = [best - 1, best, best + 1].map(|lag| correlations[lag].max(1e-9).ln());
    (first + best as i64) as f64 + 0.5 * (before - after) / (before - 2.0 * at + after)
}
