//! Error bounds of the receiver: integers up to the power drawn, then a sum of squares and a root.

use crate::effects::receiver::{DRAW_MEAN, draw};

use crate::parity::rounding::{ROOT, TINY, ULP, root_off};
use crate::parity::{Slack, Step};

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let receiver = tables.settings.effects.receiver.as_ref();
    let noise = receiver.map_or(0.0, |receiver| receiver.noise_power() / DRAW_MEAN);
    for index in 0..step.after.amplitude.len() {
        let (line, sample) = step.place(index);
        let drawn = f64::from(draw(line, sample, step.state.frame, tables.settings.seed));
        let heard = f64::from(tables.effects.receiver.clutter[index]) + noise * drawn;
        let silent = [step.after, step.twin].map(|beam| beam.label[index] == 0);
        let (echo, off) = (step.before.amplitude[index].abs(), slack.amplitude[index]);
        // Power stored (1/2), integer rounded (1), product (1), added to the clutter (1); square of the echo (1); their
        // sum (1).
        let rounding = ULP * (4.5 * heard + 2.0 * (echo + off).powi(2)) + 3.0 * TINY;
        let square_off = (2.0 * echo + off) * off + rounding;
        let square = echo * echo + if silent[0] { 0.0 } else { heard };
        // Where a label within rounding of a face is background on one side only, the entire noise may appear or
        // vanish.
        let torn = if silent[0] == silent[1] { 0.0 } else { heard };
        let root = (square + square_off + torn).sqrt();
        slack.amplitude[index] = root_off(square, square_off + torn) + ROOT * root;
    }
}
