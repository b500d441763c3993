//! Error bounds of refraction: cumulative phases are integers, equal wherever the labels above agree; their curvature
//! is a sum of rounded terms.

use crate::effects::compound::steered;
use crate::effects::refraction::{MAX, Spread, average, shifts};

use crate::parity::rounding::{DIVIDE, TINY, ULP};
use crate::parity::{Slack, Step};

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let (lines, samples) = (step.lines(), step.samples());
    let spread = Spread::<f64>::new(step.tables);
    let halves = step.tables.effects.refraction.halves;
    let phases = [step.after, step.twin].map(|beam| {
        let mut phases = vec![0; halves * samples];
        for (half, down) in phases.chunks_mut(samples).enumerate() {
            average(step.tables, half, &beam.label, down);
        }
        phases
    });
    // Factor, factor of the twin, and rounding error.
    let factors = if steered(step.tables) == 0 {
        straight(step, &spread, &phases)
    } else {
        mean(step, &spread, &phases)
    };
    for index in 0..lines * samples {
        let [factor, twin, rounding] = factors[index];
        let off = (factor - twin).abs() + rounding;
        let amplitude = step.before.amplitude[index].abs();
        slack.amplitude[index] = slack.amplitude[index] * (factor + off) + amplitude * (off + ULP * factor) + TINY;
    }
}

/// Rounding error of a factor whose terms add up to this.
fn rounding(spread: &Spread<f64>, largest: f64, terms: f64) -> f64 {
    // Twenty operations per term and the division; as many products and sums as samples, of the terms and of 1;
    // decaying factors, with exponents up to ten times the decay length; the position among half beams.
    let operations = 2.0 * spread.samples as f64 + 3.0 * spread.halves as f64 + 100.0;
    let sum_off = operations * ULP * (1.0 + terms) + DIVIDE * terms;
    (largest * largest * sum_off).min(MAX) + (DIVIDE + ULP) * largest
}

fn straight(step: &Step, spread: &Spread<f64>, phases: &[Vec<u32>; 2]) -> Vec<[f64; 3]> {
    let samples = step.samples();
    let mut factors = Vec::new();
    for line in 0..step.lines() {
        let (mut exact, mut twin) = (Vec::new(), Vec::new());
        let mut terms = 0.0f64;
        spread.factors(
            line,
            |half| &phases[0][half * samples..][..samples],
            |_, term, factor| {
                terms += term;
                exact.push((factor, terms));
            },
        );
        spread.factors(
            line,
            |half| &phases[1][half * samples..][..samples],
            |_, _, factor| twin.push(factor),
        );
        let both = exact.into_iter().zip(twin);
        factors.extend(both.map(|((factor, terms), twin)| [factor, twin, rounding(spread, factor.max(twin), terms)]));
    }
    factors
}

fn mean(step: &Step, spread: &Spread<f64>, phases: &[Vec<u32>; 2]) -> Vec<[f64; 3]> {
    let (lines, samples) = (step.lines(), step.samples());
    let looks = 1 + steered(step.tables);
    let of_rays = |phases: &[u32]| {
        let (mut curvatures, mut sums) = (Vec::new(), Vec::new());
        for ray in 0..looks * spread.halves {
            let mut terms = 0.0;
            spread.down_ray(step.tables, ray, phases, |_, term, sum| {
                terms += term;
                curvatures.push(sum);
                sums.push(terms);
            });
        }
        (curvatures, sums)
    };
    let [(exact, terms), (twin, _)] = [&phases[0], &phases[1]].map(|phases| of_rays(phases));
    (0..lines * samples)
        .map(|index| {
            let (line, sample) = (index / samples, index % samples);
            let (mut sums, mut count) = ([0.0; 3], 0.0);
            for look in 0..looks {
                let (side, shifts) = shifts(step.tables, look);
                let element = line as i32 - side * shifts.map_or(0, |shifts| shifts[sample]);
                if (0..lines as i32).contains(&element) {
                    let [factor, twin] =
                        [&exact, &twin].map(|curvatures| spread.factor(look, element, sample, curvatures));
                    let first = (look * spread.halves + spread.place(element).0) * samples + sample;
                    let terms = terms[first].max(terms[first + samples]);
                    sums[0] += factor;
                    sums[1] += twin;
                    sums[2] += rounding(spread, factor.max(twin), terms);
                    count += 1.0;
                }
            }
            let [factor, twin, rounding] = sums.map(|sum| sum / count);
            [factor, twin, rounding + (looks as f64 * ULP + DIVIDE) * factor]
        })
        .collect()
}
