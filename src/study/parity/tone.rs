//! Tone: a logarithm, clamped. Its slope is steep for faint echoes, so the bound is taken at both ends of the interval that
//! the amplitude is known to.

use crate::effects::tone::{MID_GREY, Tone};

use super::rounding::{ULP, log2, pow};
use super::slack::{Slack, Step};

/// Echoes below this are black on all backends.
const SMALLEST: f64 = 1e-10;

pub fn carry(step: &Step, slack: &mut Slack) {
    let gain = step.tables.gain.of::<f64>();
    for index in 0..step.after.amplitude.len() {
        let gain = gain[index % step.samples()];
        let (amplitude, off) = (step.before.amplitude[index], slack.amplitude[index]);
        // Gain stored (1/2), product (1).
        let off = gain * (off + 1.5 * ULP * (amplitude + off));
        let exact = gain * amplitude;
        let [low, high] = match &step.tables.settings.effects.tone {
            Some(tone) => [compressed(tone, exact - off)[0], compressed(tone, exact + off)[1]],
            None => [exact - off, exact + off].map(|a| (255.0 * a).clamp(0.0, 255.0)),
        };
        let found = step.after.amplitude[index];
        slack.amplitude[index] = (found - low).max(high - found) + ULP * 255.0;
    }
}

/// Lowest and highest grey level of an amplitude.
fn compressed(tone: &Tone, amplitude: f64) -> [f64; 2] {
    let per_octave = 20.0 * 2f64.log10() / tone.dynamic_range_db;
    let octaves = amplitude.max(SMALLEST).log2();
    let share = MID_GREY + per_octave * octaves;
    // Constants stored (1/2 each), product and sum.
    let off = per_octave * log2(octaves) + ULP * (1.5 * per_octave * octaves.abs() + 0.5 * MID_GREY + share.abs());
    let end = |share: f64, side: f64| {
        let share = share.clamp(0.0, 1.0);
        let (mapped, off) = if tone.gamma == 1.0 {
            (share, 0.0)
        } else {
            let mapped = share.powf(tone.gamma);
            let exponent = tone.gamma * 0.5 * ULP * share.max(1e-30).log2().abs();
            (mapped, mapped * (pow(share, tone.gamma) + exponent))
        };
        (255.0 * (mapped + side * (off + ULP * mapped))).clamp(0.0, 255.0)
    };
    [end(share - off, -1.0), end(share + off, 1.0)]
}
