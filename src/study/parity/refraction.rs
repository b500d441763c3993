//! Refraction: phases are whole numbers, which agree exactly wherever the labels above agree; their curvature is a sum of rounded terms.

use crate::effects::refraction::{MOST, Spread};

use super::rounding::{DIVIDE, TINY, ULP};
use super::slack::{Slack, Step};

pub fn carry(step: &Step, slack: &mut Slack) {
    let (lines, samples) = (step.lines(), step.samples());
    let spread = Spread::<f64>::new(step.tables);
    let phases = [step.after, step.twin].map(|beam| -> Vec<f64> {
        let phase = |label: &u8| f64::from(step.tables.label_rows[usize::from(*label)].phase);
        let scanlines = beam.label[..lines * samples].chunks(samples);
        let down = scanlines.flat_map(|labels| {
            labels.iter().scan(0.0, move |sum, label| {
                *sum += phase(label);
                Some(*sum)
            })
        });
        down.collect()
    });
    for line in 0..lines {
        let (mut exact, mut twin) = (Vec::new(), Vec::new());
        let mut terms = 0.0f64;
        spread.factors(
            line,
            |line| &phases[0][line * samples..][..samples],
            |_, term, factor| {
                terms += term.abs();
                exact.push((factor, terms));
            },
        );
        spread.factors(
            line,
            |line| &phases[1][line * samples..][..samples],
            |_, _, factor| twin.push(factor),
        );
        for (sample, ((factor, terms), twin)) in exact.into_iter().zip(twin).enumerate() {
            let index = line * samples + sample;
            // Ten operations a term and the division; as many products and sums as samples, of terms and of 1; factors that fade, of exponents up to
            // ten times as long as it takes to fade.
            let sum_off = (2.0 * samples as f64 + 60.0) * ULP * (1.0 + terms) + DIVIDE * terms;
            let largest = factor.max(twin);
            let off = (factor - twin).abs() + (largest * largest * sum_off).min(MOST) + (DIVIDE + ULP) * largest;
            let amplitude = step.before.amplitude[index].abs();
            slack.amplitude[index] = slack.amplitude[index] * (factor + off) + amplitude * (off + ULP * factor) + TINY;
        }
    }
}
