//! Error bounds of the blur: a convolution across scanlines with weights that sum to 1.

use crate::parity::rounding::{DIVIDE, ULP};
use crate::parity::{Slack, Step};

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let Some(kernel) = &step.tables.effects.blur else {
        return slack.fault("blur without a kernel");
    };
    let (lines, samples) = (step.lines(), step.samples());
    let before = std::mem::take(&mut slack.amplitude);
    slack.amplitude = vec![0.0; before.len()];
    for sample in 0..samples {
        let weights: Vec<f64> = kernel.at(sample).collect();
        for line in 0..lines {
            let (mut off, mut size, mut norm) = (0.0, 0.0, 0.0);
            for (tap, weight) in weights.iter().enumerate() {
                if let Some(other) = (line + tap).checked_sub(kernel.reach).filter(|&other| other < lines) {
                    let index = other * samples + sample;
                    off += weight * before[index];
                    size += weight * (step.before.amplitude[index].abs() + before[index]);
                    norm += weight;
                }
            }
            // Weights stored (1/2), products (1) and sums; for a truncated kernel also the sum of its weights and a
            // division.
            let rounding = (1.5 + 2.0 * weights.len() as f64) * ULP + DIVIDE;
            slack.amplitude[line * samples + sample] = (off + rounding * size) / norm.min(1.0);
        }
    }
}
