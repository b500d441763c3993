//! Error bounds of the tone pass: a clamped logarithm. Its slope is steep for faint echoes, so both ends of the
//! amplitude interval are mapped. Automatic gain is a ratio of two sums over a depth band of terms that increase with
//! amplitude, so its ends are mapped in the same way.

use crate::effects::tone::auto_gain::{
    AutoGain, BANDS, FULL_WEIGHT, MAX, PRIOR, ZERO_WEIGHT, at, gains, middle, range, tops,
};
use crate::effects::tone::{MID_GREY, Tone};

use crate::parity::rounding::{DIVIDE, ULP, log2, pow};
use crate::parity::{Slack, Step};

/// Amplitude below which echoes are black on all backends.
const SMALLEST: f64 = 1e-10;

/// Lower and upper bound.
type Ends = [f64; 2];

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let effects = &step.tables.settings.effects;
    let bands = AutoGain::of(step.tables).map(|automatic| {
        let tops = [step.after, step.twin].map(|beam| tops(step.tables, &beam.label));
        let exact = gains(
            &automatic,
            step.tables.effects.tone.gain.of::<f64>(),
            &step.before.amplitude,
            &tops[0],
        );
        (
            exact,
            std::array::from_fn(|band| band_ends(&automatic, step, slack, band, &tops)),
        )
    });
    for index in 0..step.after.amplitude.len() {
        let (_, sample) = step.place(index);
        let gain = step.tables.effects.tone.gain.of::<f64>()[sample];
        let (amplitude, off) = (step.before.amplitude[index], slack.amplitude[index]);
        // Gain stored (1/2), product (1).
        let off = gain * (off + 1.5 * ULP * (amplitude + off));
        let exact = gain * amplitude;
        let [low, high] = match &effects.tone {
            Some(tone) => {
                let [least, most] = bands
                    .as_ref()
                    .map_or([0.0; 2], |(exact, ends)| lifted(exact, ends, sample, step.samples()));
                [
                    compressed(tone, exact - off, least)[0],
                    compressed(tone, exact + off, most)[1],
                ]
            }
            None => [exact - off, exact + off].map(|a| (255.0 * a).clamp(0.0, 255.0)),
        };
        let grey = step.after.amplitude[index];
        slack.amplitude[index] = (grey - low).max(high - grey) + ULP * 255.0;
    }
}

/// Returns the bounds of the automatic gain of a band, octaves.
fn band_ends(automatic: &AutoGain, step: &Step, slack: &Slack, band: usize, tops: &[Vec<u32>; 2]) -> Ends {
    let gain = step.tables.effects.tone.gain.of::<f64>();
    let range = range(band, step.samples());
    let count = (range.len() * step.lines()) as f64;
    let (mut weight, mut value) = ([0.0; 2], [0.0; 2]);
    for line in 0..step.lines() {
        for sample in range.clone() {
            let index = line * step.samples() + sample;
            let factor = gain[sample] * automatic.scale;
            let (echo, off) = (factor * step.before.amplitude[index], factor * slack.amplitude[index]);
            // Gain and factor stored (1/2 each), two products (2).
            let off = off + 3.0 * ULP * (echo + off);
            for (end, echo) in [(echo - off).max(0.0), echo + off].into_iter().enumerate() {
                let side = 2.0 * end as f64 - 1.0;
                // Difference, at most 0.3 where not clamped (1), its constant stored (1/2), both times 5; then the
                // factor stored and the product, at most 1 (2).
                let own_weight =
                    ((echo - ZERO_WEIGHT) / (FULL_WEIGHT - ZERO_WEIGHT) + side * 5.0 * ULP).clamp(0.0, 1.0);
                // Below what is opaque to both backends nothing counts; to one, anything up to that.
                let above = tops
                    .each_ref()
                    .map(|tops| tops.get(line).is_none_or(|top| sample < *top as usize));
                let counts = if end == 0 {
                    above[0] && above[1]
                } else {
                    above[0] || above[1]
                };
                let own_weight = own_weight * f64::from(u8::from(counts));
                weight[end] += own_weight;
                value[end] += own_weight * echo.min(MAX) * (1.0 + side * ULP);
            }
        }
    }
    let prior = PRIOR * (count + 1.0);
    let level = [0, 1].map(|end| {
        let side = 2.0 * end as f64 - 1.0;
        // Each addition loses 1; the prior is stored and multiplied (2) and added (1).
        let sums = 1.0 + side * (count + 3.0) * ULP;
        (value[end] + prior) * sums / ((weight[1 - end] + prior) * (2.0 - sums)) * (1.0 + side * DIVIDE)
    });
    let middle = gain[middle(band, step.samples())].log2();
    let room = automatic.ceiling - middle;
    // Ceiling and gain stored (1/2 each), difference (1).
    let room_off = log2(middle) + ULP * (automatic.ceiling.abs() + 1.0 + room.abs());
    // Louder tissue gets less gain.
    [1, 0].map(|end| {
        let side = 1.0 - 2.0 * end as f64;
        let octaves = level[end].log2();
        let gain = -automatic.share * octaves;
        // Share stored and multiplied (2).
        let off = automatic.share * log2(octaves) + 2.0 * ULP * gain.abs();
        (gain + side * off).min((room + side * room_off).max(0.0))
    })
}

/// Returns the bounds of the automatic gain at a sample, octaves.
fn lifted(exact: &[f64; BANDS], ends: &[Ends; BANDS], sample: usize, samples: usize) -> Ends {
    let largest = ends
        .iter()
        .flatten()
        .fold(0.0f64, |largest, octaves| largest.max(octaves.abs()));
    // An error of 5 of 16 in the position moves the gain by at most twice the largest; difference, product and sum lose
    // 4 of that.
    let rounding = (5.0 * 16.0 * 2.0 + 4.0) * ULP * largest;
    let middle = at(exact, sample, samples);
    [0, 1].map(|end| {
        let ends: [f64; BANDS] = std::array::from_fn(|band| ends[band][end]);
        let side = 2.0 * end as f64 - 1.0;
        let octaves = at(&ends, sample, samples) + side * rounding;
        if end == 0 {
            octaves.min(middle)
        } else {
            octaves.max(middle)
        }
    })
}

/// Returns the bounds of the grey level of an amplitude raised by some octaves.
fn compressed(tone: &Tone, amplitude: f64, lifted: f64) -> Ends {
    let per_octave = 20.0 * 2f64.log10() / tone.dynamic_range_db;
    let octaves = amplitude.max(SMALLEST).log2();
    let share = MID_GREY + per_octave * (octaves + lifted);
    // Constants stored (1/2 each), two sums and a product.
    let off = per_octave * log2(octaves)
        + ULP * (2.5 * per_octave * (octaves.abs() + lifted.abs()) + 0.5 * MID_GREY + share.abs());
    let bend = tone.bend();
    let end = |share: f64, side: f64| {
        let share = share.clamp(0.0, 1.0);
        let bent = share - bend * share * (1.0 - share) * (1.0 - 2.0 * share);
        // Differences of at most 1 (2), products of at most 0.25 (1), all times the bend, and the last difference (1).
        let bent = (bent + side * if bend == 0.0 { 0.0 } else { ULP * (3.0 * bend + bent) }).clamp(0.0, 1.0);
        let (mapped, off) = if tone.gamma == 1.0 {
            (bent, 0.0)
        } else {
            let mapped = bent.powf(tone.gamma);
            let exponent = tone.gamma * 0.5 * ULP * bent.max(1e-30).log2().abs();
            (mapped, mapped * (pow(bent, tone.gamma) + exponent))
        };
        (255.0 * (mapped + side * (off + ULP * mapped))).clamp(0.0, 255.0)
    };
    [end(share - off, -1.0), end(share + off, 1.0)]
}
