//! Error bounds of haze: sums of non-negative powers, and a root.

use crate::effects::haze::{Column, Numbers, beside, columns_of, reflectors_of};
use insonify_base::simd::Kernel;

use crate::parity::rounding::{DIVIDE, ROOT, TINY, ULP, root_off};
use crate::parity::{Slack, Step};

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let (tables, lines, samples) = (step.tables, step.lines(), step.samples());
    let columns = columns_of(lines);
    let [reflectors, of_twin] = [step.after, step.twin].map(|beam| {
        let mut reflectors = vec![0.0; lines * samples];
        for (reflectors, labels) in reflectors.chunks_mut(samples).zip(beam.label.chunks(samples)) {
            reflectors_of(tables, labels, reflectors);
        }
        reflectors
    });
    let means_of = |amplitudes: &[f64], reflectors: &[f64]| {
        let mut means = vec![0.0; columns * samples];
        let weights = tables.effects.haze.weights.chunks(lines);
        for (means, weights) in means.chunks_mut(samples).zip(weights) {
            let numbers = Numbers::of(tables);
            Column {
                numbers,
                weights,
                gains: &tables.effects.haze.gains,
                amplitudes,
                reflectors,
                reflecting: &vec![0..samples; lines],
                reflected: &mut vec![0.0; samples],
                means,
            }
            .run();
        }
        means
    };
    let before = &step.before.amplitude[..lines * samples];
    // As amplitudes whose powers are the errors of the powers.
    let offs = before.iter().zip(&slack.amplitude);
    let offs: Vec<f64> = offs
        .map(|(echo, off)| ((2.0 * echo.abs() + off) * off).sqrt())
        .collect();
    let (means, mut mean_offs) = (means_of(before, &reflectors), means_of(&offs, &reflectors));
    // Where labels within rounding of a face differ, so do reflectors.
    for (off, (mean, twin)) in mean_offs.iter_mut().zip(means.iter().zip(means_of(before, &of_twin))) {
        *off += (mean - twin).abs();
    }
    // Reflectors are differences of powers of 2, whose errors grow with the exponent, as they fall with it.
    let rounding = |reflector: &f64| {
        if *reflector > 0.0 {
            40.0 * ULP + (2.0 * DIVIDE + 4.0 * ULP) * reflector
        } else {
            0.0
        }
    };
    let roundings: Vec<f64> = reflectors.iter().map(rounding).collect();
    let [with, without] = [&roundings[..], &vec![0.0; lines * samples]].map(|reflectors| means_of(before, reflectors));
    for (off, (with, without)) in mean_offs.iter_mut().zip(with.iter().zip(without)) {
        *off += with - without;
    }
    let numbers = Numbers::of(tables);
    let (level, decaying) = (numbers.level, numbers.fading.abs() + numbers.behind_fading.abs());
    // A product and a sum per scanline; as many per sample, with gains and a decay of which each has the error of
    // `exp2`, and that of eight steps of parallel sums.
    let decays = samples as f64 * (10.0 + 4.0 * decaying);
    let relative = (4.0 * lines as f64 + 3.0 * decays + 100.0) * ULP;
    for index in 0..lines * samples {
        let (line, sample) = step.place(index);
        let (beside, after) = beside::<f64>(line, lines);
        let pattern = level * f64::from(tables.effects.haze.pattern[index]);
        let [near, far] = beside.map(|column| means[column * samples + sample]);
        let [near_off, far_off] = beside.map(|column| mean_offs[column * samples + sample]);
        let haze = pattern * (near * (1.0 - after) + far * after);
        // The position among columns has an error of a division by their number.
        let position_off = (columns as f64 + 1.0) * (DIVIDE + 3.0 * ULP) * (near + far);
        let haze_off = pattern * (near_off.max(far_off) + position_off) * (1.0 + relative) + relative * haze;
        let silent = [step.after, step.twin].map(|beam| beam.label[index] == 0);
        let (echo, off) = (step.before.amplitude[index].abs(), slack.amplitude[index]);
        let square = echo * echo + if silent[0] { 0.0 } else { haze };
        // Where a label within rounding of a face is background on one side only, all haze may appear or vanish.
        let torn = if silent[0] == silent[1] { 0.0 } else { haze };
        let square_off = (2.0 * echo + off) * off + haze_off + torn + 4.0 * ULP * (square + off * off) + 8.0 * TINY;
        slack.amplitude[index] = root_off(square, square_off) + ROOT * (square + square_off).sqrt();
    }
}
