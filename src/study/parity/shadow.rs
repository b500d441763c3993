//! Shadow: a sum of integers, which agree exactly wherever the labels above agree, one exponential, and its mean over the beam.

use crate::effects::shadow::penumbra::opaque_units;
use crate::effects::shadow::{MOST_UNITS, exponent_per_unit, needle_units};

use super::rounding::{DIVIDE, TINY, ULP, exp2};
use super::slack::{Slack, Step};

/// Past the pass of the losses, which leaves echoes as they are.
pub fn carry_loss(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let needle = tables.settings.has_needle.then(|| f64::from(needle_units(tables)));
    let tissue = |label: u8| f64::from(tables.label_rows[usize::from(label)].loss);
    slack.loss = vec![0.0; step.after.loss.len()];
    for line in 0..step.lines() {
        let mut above = 0.0;
        for sample in 0..step.samples() {
            let index = line * step.samples() + sample;
            let mut own = (tissue(step.after.label[index]) - tissue(step.twin.label[index])).abs();
            let shade_off = slack.shade.get(index).copied().unwrap_or(0.0);
            if let Some(units) = needle
                && shade_off > 0.0
            {
                // Cutting the product to a whole number of units may take one more or less.
                own += units * (shade_off + ULP) + 1.0;
            }
            // Half of the sample's own loss, again cut to whole units.
            let halved = if own > 0.0 { 0.5 * own + 1.0 } else { 0.0 };
            slack.loss[index] = above + halved;
            above += own;
        }
    }
}

/// One-way transmittance of a sample, and how far a twin's may be off.
fn one_way(loss: f64, off: f64) -> [f64; 2] {
    let exponent = 0.5 * exponent_per_unit();
    let left = |units: f64| (units.clamp(0.0, f64::from(MOST_UNITS)) * exponent).exp2();
    let (most, least) = (left(loss - off), left(loss + off));
    let largest = (loss + off) * exponent.abs();
    // Units stored (1/2), the factor stored (1/2), product (1); then the exponential.
    let relative = exp2(largest, 2.0 * ULP * largest);
    [left(loss), most - least + most * relative.min(1.0) + TINY]
}

/// Past the pass that takes the mean over the beam.
pub fn carry(step: &Step, slack: &mut Slack) {
    let Some(kernel) = &step.tables.penumbra else {
        return slack.fault("a shadow without a kernel");
    };
    let (lines, samples) = (step.lines(), step.samples());
    let opaque = opaque_units(step.tables.sample_mm());
    let is_opaque = |label: u8| step.tables.label_rows[usize::from(label)].loss >= opaque;
    for sample in 0..samples {
        let weights: Vec<f64> = kernel.at(sample).collect();
        let through: Vec<[f64; 2]> = (0..lines)
            .map(|line| line * samples + sample)
            .map(|at| one_way(f64::from(step.after.loss[at]), slack.loss[at]))
            .collect();
        for line in 0..lines {
            let (mut mean, mut off, mut norm) = (0.0, 0.0, 0.0);
            for (tap, weight) in weights.iter().enumerate() {
                if let Some(other) = (line + tap).checked_sub(kernel.reach).filter(|&other| other < lines) {
                    mean += weight * through[other][0];
                    off += weight * through[other][1];
                    norm += weight;
                }
            }
            let (mean, off) = (mean / norm, off / norm);
            // As in `blur`: weights stored (1/2), products (1) and sums; where the kernel is cut, a division.
            let off = off + ((1.5 + 2.0 * weights.len() as f64) * ULP + DIVIDE) * (mean + off) / norm.min(1.0);
            let index = line * samples + sample;
            let [own, own_off] = through[line];
            let darker = [own.min(mean), off.max(own_off)];
            let [left, off] = match [step.after, step.twin].map(|beam| is_opaque(beam.label[index])) {
                [false, false] => [mean, off],
                [true, true] => darker,
                // Within rounding of the face of something opaque: anything between.
                [true, false] => [darker[0], mean - darker[0] + off.max(own_off)],
                [false, true] => [mean, mean - darker[0] + off.max(own_off)],
            };
            let (square, square_off) = (left * left, (2.0 * left + off) * off);
            let amplitude = step.before.amplitude[index].abs();
            // Two products.
            slack.amplitude[index] = slack.amplitude[index] * (square + square_off)
                + amplitude * (square_off + 2.0 * ULP * (square + square_off))
                + TINY * (1.0 + amplitude);
        }
    }
}
