//! Error bounds of refraction: cumulative phases are integers, equal wherever the labels above agree; their curvature
//! is a sum of rounded terms.

use crate::effects::refraction::{MAX, Spread};

use crate::parity::rounding::{DIVIDE, TINY, ULP};
use crate::parity::{Slack, Step};

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let (lines, samples) = (step.lines(), step.samples());
    let spread = Spread::<f64>::new(step.tables);
    let reach = step.tables.effects.refraction.reach;
    let phases = [step.after, step.twin].map(|beam| -> Vec<f64> {
        let increment = |index: usize| f64::from(step.tables.label_rows[usize::from(beam.label[index])].phase);
        let mut phases = vec![0.0; lines / reach * samples];
        for (half, down) in phases.chunks_mut(samples).enumerate() {
            let mut sum = 0.0;
            for (sample, phase) in down.iter_mut().enumerate() {
                let scanlines = half * reach..(half + 1) * reach;
                sum += scanlines.map(|line| increment(line * samples + sample)).sum::<f64>();
                *phase = sum;
            }
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
                terms += term.abs();
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
            // Fifteen operations per term and the division; as many products and sums as samples, of the terms and of
            // 1; decaying factors, with exponents up to ten times the decay length.
            let sum_off = (2.0 * samples as f64 + 80.0) * ULP * (1.0 + terms) + DIVIDE * terms;
            let largest = factor.max(twin);
            let off = (factor - twin).abs() + (largest * largest * sum_off).min(MAX) + (DIVIDE + ULP) * largest;
            let amplitude = step.before.amplitude[index].abs();
            slack.amplitude[index] = slack.amplitude[index] * (factor + off) + amplitude * (off + ULP * factor) + TINY;
        }
    }
}
