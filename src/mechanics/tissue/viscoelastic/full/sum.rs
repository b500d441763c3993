//! Weighted sums over a history.

use crate::base::simd::{Kernel, vectorised};

/// Values summed in a block; block sums are then added up, which keeps rounding small in long histories.
const BLOCK: usize = 512;
const LANES: usize = 32;

/// Adds to each component the sum of weight times value over the history. `values` holds the components of one time
/// after those of another; the first weight is that of the first time, or of the last if `BACKWARDS`.
pub(in super::super) fn add_weighted<const BACKWARDS: bool>(weights: &[f64], values: &[f64], sums: &mut [f64]) {
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
            let mut at = 0;
            while at < count {
                let end = (at + BLOCK).min(count);
                let block = if BACKWARDS {
                    &weights[count - end..count - at]
                } else {
                    &weights[at..end]
                };
                *sum += dot::<BACKWARDS>(block, &values[at..end]);
                at = end;
            }
            return;
        }
        for (at, time) in values.chunks_exact(sums.len().max(1)).enumerate() {
            let weight = weights[if BACKWARDS { weights.len() - 1 - at } else { at }];
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
    for at in (0..whole).step_by(LANES) {
        let value = &values[at..at + LANES];
        let weight = if BACKWARDS {
            &weights[weights.len() - at - LANES..weights.len() - at]
        } else {
            &weights[at..at + LANES]
        };
        for lane in 0..LANES {
            lanes[lane] += weight[if BACKWARDS { LANES - 1 - lane } else { lane }] * value[lane];
        }
    }
    let mut sum: f64 = lanes.iter().sum();
    for at in whole..values.len() {
        sum += weights[if BACKWARDS { weights.len() - 1 - at } else { at }] * values[at];
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_a_plain_loop() {
        for (times, components) in [(0, 1), (1, 1), (31, 1), (32, 1), (1300, 1), (5, 3), (40, 2), (7, 0)] {
            let weights: Vec<f64> = (0..times).map(|at| 1.0 / (1.0 + at as f64)).collect();
            let values: Vec<f64> = (0..times * components).map(|at| (at as f64 * 0.7).sin()).collect();
            let plain = |component: usize, backwards: bool| -> f64 {
                let weight = |at: usize| weights[if backwards { times - 1 - at } else { at }];
                (0..times)
                    .map(|at| weight(at) * values[at * components + component])
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
