//! Error bounds of speckle reduction: sums along lines, a weight that falls with the variation along each, and a mean
//! with these weights. The errors of both sums are taken apart, and the weight at both ends of the variation that they
//! allow.

use crate::effects::speckle_reduction::{COUNT, DIRECTIONS, EVENNESS, INNER, INNER_COUNT, LEAST, TAPS, strength};

use crate::parity::rounding::{DIVIDE, TINY, ULP};
use crate::parity::{Slack, Step};

/// Weight of a line of a variation.
fn weight(variation: f64) -> f64 {
    1.0 / (1.0 + variation.powi(8))
}

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let counts = [step.lines(), step.samples()];
    let before = std::mem::take(&mut slack.amplitude);
    let strength = strength(tables);
    let bound = |index: usize| {
        let (line, sample) = step.place(index);
        let offsets = &tables.effects.speckle_reduction[sample];
        // Amplitude and its error, at an offset of taps.
        let at = |[across, along]: [isize; 2], tap: usize| {
            let away = |axis: usize, sign: isize| match tap {
                0 => 0,
                _ => sign * offsets[axis][tap - 1] as isize,
            };
            let [line, sample] = [(0, line, across), (1, sample, along)]
                .map(|(axis, at, sign)| (at as isize + away(axis, sign)).clamp(0, counts[axis] as isize - 1) as usize);
            let index = line * counts[1] + sample;
            [step.before.amplitude[index], before[index]]
        };
        let [middle, off] = at([0, 0], 0);
        let mut means = [[0.0; 5]; 4];
        for (mean, direction) in means.iter_mut().zip(DIRECTIONS) {
            let taps = |reach: usize| {
                let both = (1..=reach).flat_map(move |tap| [(direction, tap), (direction.map(|sign| -sign), tap)]);
                std::iter::once((direction, 0))
                    .chain(both)
                    .map(|(direction, tap)| at(direction, tap))
            };
            let [mut sum, mut sum_off, mut size, mut squares, mut squares_off] = [0.0; 5];
            for [value, off] in taps(TAPS) {
                sum += value;
                sum_off += off;
                size += value.abs() + off;
                squares += value * value;
                squares_off += (2.0 * value.abs() + off) * off + TINY;
            }
            // Ten additions; products and ten additions.
            sum_off += 10.0 * ULP * size;
            squares_off += 11.0 * ULP * (squares + squares_off);
            let variation = |squares: f64, sum: f64, rounding: f64| {
                // Products (1 each) and the quotient.
                let ratio = COUNT * squares / (sum * sum).max(LEAST) * (1.0 + rounding * (2.0 * ULP + DIVIDE));
                // The difference (1), the constant stored (1/2) and the product (1).
                let above = ratio - 1.0;
                (above + rounding * 2.5 * ULP * above.abs()) * EVENNESS
            };
            let least = variation((squares - squares_off).max(0.0), sum.abs() + sum_off, -1.0);
            let most = variation(squares + squares_off, (sum.abs() - sum_off).max(0.0), 1.0);
            let exact = weight(variation(squares, sum, 0.0));
            let nearest = 0.0f64.clamp(least, most);
            let farthest = least.abs().max(most.abs());
            // Seven for the power, the sum (1) and the quotient.
            let rounding = 8.0 * ULP + DIVIDE;
            let low = weight(farthest) * (1.0 - rounding);
            let high = weight(nearest) * (1.0 + rounding);
            let (mut inner, mut inner_off, mut inner_size) = (0.0, 0.0, 0.0);
            for [value, off] in taps(INNER) {
                inner += value / INNER_COUNT;
                inner_off += off / INNER_COUNT;
                inner_size += (value.abs() + off) / INNER_COUNT;
            }
            // Four additions, the constant stored (1/2) and the product (1).
            inner_off += 5.5 * ULP * inner_size;
            *mean = [inner, inner_off, exact, low, high];
        }
        let total = 1.0 + means.iter().map(|[_, _, exact, ..]| exact).sum::<f64>();
        let smooth = (middle + means.iter().map(|[inner, _, exact, ..]| exact * inner).sum::<f64>()) / total;
        let least = 1.0 + means.iter().map(|[.., low, _]| low).sum::<f64>();
        let (mut smooth_off, mut size) = (off, middle.abs() + off);
        for [inner, inner_off, exact, low, high] in means {
            smooth_off += high * inner_off + (high - exact).max(exact - low) * (inner - smooth).abs();
            size += high * (inner.abs() + inner_off);
        }
        // Products (1), four additions of each sum and the quotient.
        let smooth_off = (smooth_off + (9.0 * ULP + DIVIDE) * size) / least;
        let change = (smooth - middle).abs() + smooth_off + off;
        // The difference (1), the strength stored (1/2) and the product (1); the sum (1).
        (1.0 - strength) * off
            + strength * (smooth_off + 2.5 * ULP * change)
            + ULP * (middle.abs() + off + strength * change)
            + 3.0 * TINY
    };
    slack.amplitude = (0..before.len()).map(bound).collect();
}
