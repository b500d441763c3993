//! Product rules over the full history: piecewise constant or linear functions, integrated exactly.

use super::history::{History, HistoryError};
use super::kernel::{Basis, Moments};
use insonify_base::simd::{Kernel, vectorised};

/// Fractional integral by a product rule. Every step sums over all values so far.
///
/// While all steps are equal, weights depend only on the lag and are cached; a step then costs one multiplication and
/// one addition per value. Once a step differs, the weights of all lags are recomputed at every step.
#[derive(Clone, Debug)]
pub(super) struct Full {
    components: usize,
    moments: Moments,
    /// Values at the start and after each step, the components of one time after those of another.
    values: Vec<f64>,
    /// Lengths of the steps, s.
    steps: Vec<f64>,
    time_s: f64,
    even: bool,
    /// Weights for equal steps.
    lags: Lags,
    /// Weights of all values in order of time, for unequal steps.
    uneven: Vec<f64>,
}

/// Largest relative difference of steps treated as equal: weights then err by no more than this.
const EQUAL: f64 = 1e-12;

/// Weights by lag for equal steps.
#[derive(Clone, Debug, Default)]
struct Lags {
    step_s: f64,
    /// Weight of the start of the interval that began 1, 2, ... steps ago.
    starts: Vec<f64>,
    /// Weight of the end of the interval that began 1, 2, ... steps ago.
    ends: Vec<f64>,
    /// Weight of the value 1, 2, ... steps ago, where two intervals meet.
    inner: Vec<f64>,
}

impl Lags {
    /// Computes weights for lags up to `count` steps of this length.
    fn reach(&mut self, moments: &Moments, step_s: f64, count: usize) {
        if self.step_s != step_s {
            *self = Lags {
                step_s,
                ..Lags::default()
            };
        }
        for lag in self.starts.len() + 1..=count {
            let ends = moments.weights((lag - 1) as f64 * step_s, step_s);
            if let Some(start) = self.starts.last() {
                self.inner.push(start + ends.end);
            }
            self.starts.push(ends.start);
            self.ends.push(ends.end);
        }
    }
}

impl Full {
    pub(super) fn new(basis: Basis, order: f64, initial: &[f64]) -> Self {
        Full {
            components: initial.len(),
            moments: Moments::new(basis, order),
            values: initial.to_vec(),
            steps: Vec::new(),
            time_s: 0.0,
            even: true,
            lags: Lags::default(),
            uneven: Vec::new(),
        }
    }

    /// Returns the common length of all steps, if this one has it too.
    fn equal(&self, step_s: f64) -> Option<f64> {
        let first_s = self.steps.first().copied().unwrap_or(step_s);
        (self.even && (step_s - first_s).abs() <= EQUAL * first_s).then_some(first_s)
    }

    /// Writes the weights of all values so far to `uneven`, and returns that of the new one. Lags are summed backwards
    /// from the newest step: differences of times would lose short steps late in a long history.
    fn weigh(&mut self, step_s: f64) -> f64 {
        self.uneven.clear();
        self.uneven.resize(self.steps.len() + 1, 0.0);
        let newest = self.moments.weights(0.0, step_s);
        let mut near = step_s;
        let mut start = newest.start;
        for index in (0..self.steps.len()).rev() {
            let step = self.steps[index];
            let ends = self.moments.weights(near, step);
            near += step;
            self.uneven[index + 1] = start + ends.end;
            start = ends.start;
        }
        self.uneven[0] = start;
        newest.end
    }
}

impl History for Full {
    fn components(&self) -> usize {
        self.components
    }

    fn time_s(&self) -> f64 {
        self.time_s
    }

    fn predict(&mut self, step_s: f64, history: &mut [f64]) -> Result<f64, HistoryError> {
        HistoryError::check_step(step_s)?;
        HistoryError::check_components(history.len(), self.components)?;
        history.fill(0.0);
        if let Some(step) = self.equal(step_s) {
            let count = self.steps.len() + 1;
            self.lags.reach(&self.moments, step, count);
            let (initial, others) = self.values.split_at(self.components);
            for (sum, value) in history.iter_mut().zip(initial) {
                *sum = self.lags.starts[count - 1] * value;
            }
            add_weighted::<true>(&self.lags.inner[..count - 1], others, history);
            return Ok(self.lags.ends[0]);
        }
        let weight = self.weigh(step_s);
        add_weighted::<false>(&self.uneven, &self.values, history);
        Ok(weight)
    }

    fn commit(&mut self, step_s: f64, value: &[f64]) -> Result<(), HistoryError> {
        HistoryError::check_step(step_s)?;
        HistoryError::check_components(value.len(), self.components)?;
        HistoryError::check_value(value)?;
        self.even = self.equal(step_s).is_some();
        if !self.even {
            // No longer valid.
            self.lags = Lags::default();
        }
        self.steps.push(step_s);
        self.values.extend_from_slice(value);
        self.time_s += step_s;
        Ok(())
    }

    fn bytes(&self) -> usize {
        let lags = [&self.lags.starts, &self.lags.ends, &self.lags.inner];
        let own_lists = [&self.values, &self.steps, &self.uneven];
        let count: usize = own_lists.iter().chain(&lags).map(|list| list.len()).sum();
        count * size_of::<f64>()
    }

    fn boxed(&self) -> Box<dyn History> {
        Box::new(self.clone())
    }
}

/// Values summed in a block; block sums are then added up, which keeps rounding small in long histories.
const BLOCK: usize = 512;
const LANES: usize = 32;

/// Adds to each component the sum of weight times value over the history. `values` holds the components of one time
/// after those of another; the first weight is that of the first time, or of the last if `BACKWARDS`.
pub(super) fn add_weighted<const BACKWARDS: bool>(weights: &[f64], values: &[f64], sums: &mut [f64]) {
    vectorised(Sum::<BACKWARDS> { weights, values, sums });
}

struct Sum<'a, const BACKWARDS: bool> {
    weights: &'a [f64],
    values: &'a [f64],
    sums: &'a mut [f64],
}

impl<const BACKWARDS: bool> Kernel for Sum<'_, BACKWARDS> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Sum { weights, values, sums } = self;
        if let [sum] = sums {
            let count = weights.len();
            let mut start = 0;
            while start < count {
                let end = (start + BLOCK).min(count);
                let block = if BACKWARDS {
                    &weights[count - end..count - start]
                } else {
                    &weights[start..end]
                };
                *sum += dot::<BACKWARDS>(block, &values[start..end]);
                start = end;
            }
            return;
        }
        for (index, time) in values.chunks_exact(sums.len().max(1)).enumerate() {
            let weight = weights[if BACKWARDS { weights.len() - 1 - index } else { index }];
            for (sum, value) in sums.iter_mut().zip(time) {
                *sum += weight * value;
            }
        }
    }
}

#[inline(always)]
fn dot<const BACKWARDS: bool>(weights: &[f64], values: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    let whole = values.len() / LANES * LANES;
    for start in (0..whole).step_by(LANES) {
        let value = &values[start..start + LANES];
        let weight = if BACKWARDS {
            &weights[weights.len() - start - LANES..weights.len() - start]
        } else {
            &weights[start..start + LANES]
        };
        for lane in 0..LANES {
            lanes[lane] += weight[if BACKWARDS { LANES - 1 - lane } else { lane }] * value[lane];
        }
    }
    let mut sum: f64 = lanes.iter().sum();
    for index in whole..values.len() {
        sum += weights[if BACKWARDS { weights.len() - 1 - index } else { index }] * values[index];
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_a_plain_loop() {
        for (times, components) in [(0, 1), (1, 1), (31, 1), (32, 1), (1300, 1), (5, 3), (40, 2), (7, 0)] {
            let weights: Vec<f64> = (0..times).map(|index| 1.0 / (1.0 + index as f64)).collect();
            let values: Vec<f64> = (0..times * components)
                .map(|index| (index as f64 * 0.7).sin())
                .collect();
            let plain = |component: usize, backwards: bool| -> f64 {
                let weight = |index: usize| weights[if backwards { times - 1 - index } else { index }];
                (0..times)
                    .map(|index| weight(index) * values[index * components + component])
                    .sum()
            };
            let mut sums = vec![0.0; components];
            add_weighted::<false>(&weights, &values, &mut sums);
            for (component, sum) in sums.iter().enumerate() {
                assert!((sum - plain(component, false)).abs() < 1e-13);
            }
            sums.fill(0.0);
            add_weighted::<true>(&weights, &values, &mut sums);
            for (component, sum) in sums.iter().enumerate() {
                assert!((sum - plain(component, true)).abs() < 1e-13);
            }
        }
    }
}
