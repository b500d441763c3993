//! How values are spread.

/// Ten-degree steps.
pub(super) const ANGLES: [f64; 19] = [
    0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0, 130.0, 140.0, 150.0, 160.0, 170.0,
    180.0,
];
/// From regular to hardly usable.
pub(super) const CONDITIONS: [f64; 9] = [1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 100.0, f64::INFINITY];
/// Orders of magnitude; what is negative lies in the first.
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

/// Least, middle and greatest of a set of values, and how many lie where. NaN are left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// NaN where there is no value.
    pub min: f64,
    /// The middle value, or the mean of the two in the middle; NaN where there is none.
    pub median: f64,
    /// NaN where there is no value.
    pub max: f64,
    /// How many values lie from `low` to below `high`; in the last up to `high` itself.
    pub histogram: Vec<Bin>,
}

/// A range of values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Its least value.
    pub low: f64,
    /// The least value of the next.
    pub high: f64,
    /// How many values lie in it.
    pub count: usize,
}

impl Spread {
    /// Of these values, counted between ascending edges; what lies beyond the edges is in the outermost ranges.
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
