//! Error bounds of refraction: cumulative phases are integers, equal wherever the labels above agree; their curvature
//! is a sum of rounded terms.

use crate::effects::refraction::{MAX, Spread, average};

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
    for line in 0..lines {
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
        for (sample, ((factor, terms), twin)) in exact.into_iter().zip(twin).enumerate() {
            let index = line * samples + sample;
            // Twenty operations per term and the division; as many products and sums as samples, of the terms and of
            // 1; decaying factors, with exponents up to ten times the decay length; the position among half beams.
            let sum_off = (2.0 * samples as f64 + 3.0 * halves as f64 + 100.0) * ULP * (1.0 + terms) + DIVIDE * terms;
            let largest = factor.max(twin);
            let off = (factor - twin).abs() + (largest * largest * sum_off).min(MAX) + (DIVIDE + ULP) * largest;
            let amplitude = step.before.amplitude[index].abs();
            slack.amplitude[index] = slack.amplitude[index] * (factor + off) + amplitude * (off + ULP * factor) + TINY;
        }
    }
}
