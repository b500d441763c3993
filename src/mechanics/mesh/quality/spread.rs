//! Distribution of values: range, median and histogram.

use serde::Serialize;

/// Bin edges in steps of ten degrees.
pub(super) const ANGLES: [f64; 19] = [
    0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0, 130.0, 140.0, 150.0, 160.0, 170.0,
    180.0,
];
/// Bin edges from regular to hardly usable.
pub(super) const CONDITIONS: [f64; 9] = [1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 100.0, f64::INFINITY];
/// Bin edges in orders of magnitude; negative values lie in the first bin.
pub(super) const DECADES: [f64; 9] = [
    f64::NEG_INFINITY,
    0.0,
    1e-3,
    1e-2,
    1e-1,
    1.0,
    10.0,
    100.0,
    f64::INFINITY,
];

/// Minimum, median, maximum and histogram of a set of values. NaN are excluded.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Minimum; NaN where there is no value.
    pub min: f64,
    /// Median: the middle value, or the mean of the two in the middle; NaN where there is none.
    pub median: f64,
    /// Maximum; NaN where there is no value.
    pub max: f64,
    /// Number of values from `low` to below `high`; the last bin includes `high`.
    pub histogram: Vec<Bin>,
}

/// A range of values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bin {
    /// Lower edge.
    pub low: f64,
    /// Upper edge, which is the lower edge of the next bin.
    pub high: f64,
    /// Number of values in the bin.
    #[serde(rename = "elements")]
    pub count: usize,
}

impl Spread {
    /// Computes the distribution of these values over bins with ascending edges; values beyond the edges count in the
    /// outermost bins.
    pub(super) fn of(values: impl Iterator<Item = f64>, edges: &[f64]) -> Spread {
        let mut values: Vec<f64> = values.filter(|value| !value.is_nan()).collect();
        values.sort_by(f64::total_cmp);
        let (first, last) = (values.first().copied(), values.last().copied());
        let middle = [values.len().saturating_sub(1) / 2, values.len() / 2];
        let [low, high] = middle.map(|place| values.get(place).copied().unwrap_or(f64::NAN));
        // Equal infinities have no mean.
        let median = if low == high { low } else { low + (high - low) / 2.0 };
        let below = |edge: f64| values.partition_point(|value| *value < edge);
        let bins = edges.len().saturating_sub(1);
        let histogram = edges.windows(2).enumerate().map(|(place, edge)| {
            let start = if place == 0 { 0 } else { below(edge[0]) };
            let end = if place + 1 == bins {
                values.len()
            } else {
                below(edge[1])
            };
            Bin {
                low: edge[0],
                high: edge[1],
                count: end - start,
            }
        });
        Spread {
            min: first.unwrap_or(f64::NAN),
            median,
            max: last.unwrap_or(f64::NAN),
            histogram: histogram.collect(),
        }
    }
}
