//! Moments and correlations of samples.

/// Returns the mean.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the standard deviation of a sample.
pub fn std(values: &[f64]) -> f64 {
    let middle = mean(values);
    (values.iter().map(|x| (x - middle).powi(2)).sum::<f64>() / (values.len() as f64 - 1.0)).sqrt()
}

/// Returns the skewness: the mean cube of the deviations from the mean, in standard deviations.
pub fn skewness(values: &[f64]) -> f64 {
    let (middle, spread) = (mean(values), std(values));
    values.iter().map(|x| ((x - middle) / spread).powi(3)).sum::<f64>() / values.len() as f64
}

/// Returns the correlation coefficient.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (ma, mb) = (mean(a), mean(b));
    let product: f64 = a.iter().zip(b).map(|(x, y)| (x - ma) * (y - mb)).sum();
    let squares = |v: &[f64], m: f64| v.iter().map(|x| (x - m).powi(2)).sum::<f64>();
    product / (squares(a, ma) * squares(b, mb)).sqrt()
}

/// Returns the slope of the least-squares line through points.
pub fn slope(x: &[f64], y: &[f64]) -> f64 {
    let (mx, my) = (mean(x), mean(y));
    let above: f64 = x.iter().zip(y).map(|(a, b)| (a - mx) * (b - my)).sum();
    above / x.iter().map(|a| (a - mx).powi(2)).sum::<f64>()
}

/// Returns the full width at half maximum of a correlation, sampled at multiples of `step` from 1 at distance 0; `None` if it stays above
/// one half.
pub fn full_width(correlations: &[f64], step: f64) -> Option<f64> {
    let after = correlations.iter().position(|&c| c < 0.5)?;
    let (high, low) = (*correlations.get(after.checked_sub(1)?)?, correlations[after]);
    Some(2.0 * step * (after as f64 - 1.0 + (high - 0.5) / (high - low)))
}
