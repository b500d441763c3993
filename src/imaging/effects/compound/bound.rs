//! Error bounds of compounding: a mean of looks, each shaded by itself.

use crate::effects::compound::{is_present, steered, steps};
use crate::effects::shadow::bound::{left, of_rays};
use crate::parity::rounding::{DIVIDE, TINY, ULP};
use crate::parity::{Slack, Step};

/// Propagates the bounds of the looks to their mean.
pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let beam = step.lines() * step.samples();
    let looks = steered(step.tables);
    let rays = of_rays(step, slack);
    let mut counts = vec![1.0; beam];
    for look in 0..looks {
        let left = left(step, slack, steps(look), &rays);
        for (index, [square, square_off]) in left.into_iter().enumerate() {
            if is_present(step.tables, look, [index / step.samples(), index % step.samples()]) {
                let [off, size] = slack.looks[index];
                // Two products.
                slack.amplitude[index] +=
                    off * (square + square_off) + size * (square_off + 2.0 * ULP * (square + square_off)) + TINY;
                counts[index] += 1.0;
            }
        }
    }
    for (index, count) in counts.into_iter().enumerate() {
        let mean = step.after.amplitude[index];
        let summed = (looks as f64 * ULP + DIVIDE) * mean;
        slack.amplitude[index] = slack.amplitude[index] / count + summed;
    }
}
