//! Error bounds of interfaces: normals from labels around positions known to within rounding, and the roughness there.

use crate::effects::common::elevation;
use crate::effects::compound::steered;
use crate::effects::interface::{ROUGHNESS_MM, Surfaces, direction};
use crate::effects::slice::WITHIN;

use crate::effects::speckle::bound::{INTERPOLATION, LOUDEST, SLOPE};
use crate::parity::rounding::{DIVIDE, ROOT, ULP, pow};
use crate::parity::{Slack, Step};

/// Change of the gradient per tap along each axis, as a sum over all taps: with weights `w = (1 - x^2 / 9)^2` and
/// slopes `d = x (1 - x^2 / 9)` on six taps, the sums of `|w|`, `|w'|`, `|d|`, `|d'|` are below 3.3, 2.2, 5 and 5.5.
const CHANGE: f64 = 5.5 * 3.3 * 3.3;

/// Rounding error of the gradient: 216 sums of products of weights of ten operations each.
const SUMS: f64 = (216.0 + 3.0 * 10.0 + 3.0) * ULP * 5.0 * 3.3 * 3.3;

/// Rounding error of one term of an index, in ULP: matrix stored (1/2), product (1), three sums (3).
const TERM: f64 = 4.5;

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let tables = step.tables;
    let surfaces = Surfaces::<f64>::new(tables, elevation(step.state));
    let interface = tables.settings.effects.interface.clone().unwrap_or_default();
    let mirror = 10f64.powf(interface.mirror_db / 20.0);
    let (lines, samples) = (step.lines(), step.samples());
    slack.specular = vec![[0.0; 2]; lines * samples];
    let steered = steered(tables);
    slack.look_specular = vec![[0.0; 2]; if steered > 0 { lines * samples } else { 0 }];
    let loudest = 1.0 + LOUDEST;
    for line in 0..lines {
        let mut sums = vec![[0.0; 2]; samples];
        for below in 1..samples {
            let pair = [line * samples + below - 1, line * samples + below];
            let labels =
                [&step.after.label, &step.twin.label].map(|labels| pair.map(|sample_index| labels[sample_index]));
            let places = pair.map(|sample_index| step.after.position[sample_index]);
            let torn = pair
                .iter()
                .any(|sample_index| slack.torn.get(*sample_index).copied().unwrap_or(false));
            let offs = pair.map(|sample_index| slack.position[sample_index]);
            let size = 0.5 * mirror * surfaces.coefficient(labels[1]);
            // Bound and size of the echo in a direction.
            let echo = |towards: [f64; 2]| {
                let [exact, twin] = labels.map(|labels| {
                    let surface = surfaces.surface(labels, places);
                    surface.map_or([0.0; 2], |surface| surfaces.echo(&surface, towards))
                });
                let rounding = match (labels[1][0] != labels[1][1], torn) {
                    (false, _) => 0.0,
                    // Torn positions leave the normal open: the two may be any echoes of this size, even of
                    // opposite sign.
                    (true, true) => 2.0 * size * loudest,
                    (true, false) => {
                        let power = interface.directivity;
                        rounding(step, &surfaces, power, labels[1], places, offs, towards) * size
                    }
                };
                let off = (exact[0] - twin[0]).hypot(exact[1] - twin[1]) + rounding;
                [off, exact[0].hypot(exact[1])]
            };
            let [off, size] = echo([1.0, 0.0]);
            for sample_index in [below - 1, below] {
                sums[sample_index] = [sums[sample_index][0] + off, sums[sample_index][1] + size];
            }
            if labels.iter().all(|[a, b]| a == b) {
                continue;
            }
            // Of all looks, as a difference from the middle one.
            let most = (0..steered).map(|look| echo(direction(tables, look, below)));
            let most = most.fold([0.0f64; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]);
            for index in pair.into_iter().filter(|_| steered > 0) {
                slack.look_specular[index][0] += most[0] + off + 6.0 * ULP * (most[1] + size);
                slack.look_specular[index][1] += most[1] + size;
            }
        }
        for (sample, [off, size]) in sums.into_iter().enumerate() {
            let index = line * samples + sample;
            if tables.effects.speckle.is_some() {
                slack.specular[index] = [off + 5.0 * ULP * size, size];
            } else {
                slack.amplitude[index] += off + (ROOT + 5.0 * ULP) * size + ULP * step.after.amplitude[index];
            }
        }
    }
}

/// Returns the rounding error of the echo of a surface of size 1, met along a direction.
fn rounding(
    step: &Step,
    surfaces: &Surfaces<f64>,
    power: f64,
    labels: [u8; 2],
    places: [[f64; 4]; 2],
    offs: [[f64; 3]; 2],
    [cosine, sine]: [f64; 2],
) -> f64 {
    let loudest = 1.0 + LOUDEST;
    let [before, after] = places.map(|position| [position[0], position[1], position[2]]);
    let [along, across] = surfaces.incidence(labels, [before, after]);
    let [along_off, across_off] = incidence_off(step, surfaces, labels, [before, after], offs, [along, across]);
    let square = (along * cosine + across * sine).abs().min(1.0);
    // Of a direction across the beam, two stored numbers, two products and a sum.
    let square_off = if sine == 0.0 {
        along_off
    } else {
        along_off * cosine + (across_off + 4.0 * ULP) * sine.abs() + 4.0 * ULP * along.abs()
    };
    let [low, high] = [(square - square_off).max(0.0), (square + square_off).min(1.0)];
    let raised = square.powf(power);
    let raised_off = (high.powf(power) - raised).max(raised - low.powf(power)) + high.powf(power) * pow(high, power);
    let steps: f64 = (0..3)
        .map(|axis| (offs[1][axis] + 3.0 * ULP * after[axis].abs()) / ROUGHNESS_MM)
        .sum();
    let rough_off = SLOPE * steps + LOUDEST * INTERPOLATION;
    // Coefficient and products.
    raised_off * loudest + (raised + raised_off) * (rough_off + (DIVIDE + 10.0 * ULP) * loudest)
}

/// Bounds the errors of the cosines of an incidence.
fn incidence_off(
    step: &Step,
    surfaces: &Surfaces<f64>,
    labels: [u8; 2],
    [before, after]: [[f64; 3]; 2],
    offs: [[f64; 3]; 2],
    [cosine, across]: [f64; 2],
) -> [f64; 2] {
    let matrix = step.tables.volume.world_to_index();
    let size = step.tables.volume.size();
    // Error bounds of the indices of the two positions.
    let index_off = |position: [f64; 3], off: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|row| {
            let terms = |q: [f64; 3]| (0..3).map(|c| (matrix[(row, c)] * q[c]).abs()).sum::<f64>();
            terms(off) + TERM * ULP * (terms(position) + matrix[(row, 3)].abs())
        })
    };
    let ends: [[f64; 3]; 2] = [index_off(before, offs[0]), index_off(after, offs[1])];
    let index = |position: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|row| (0..3).map(|c| matrix[(row, c)] * position[c]).sum::<f64>() + matrix[(row, 3)])
    };
    let (from, to) = (index(before), index(after));
    // At a face of the volume rounding decides whether there is a voxel beyond it: the cosine may be anything.
    let near_face = (0..3).any(|axis| {
        let shifted = to[axis] + 0.5;
        let reach = ends[1][axis] + 2.0 * WITHIN;
        shifted.abs() < reach || (shifted - size[axis] as f64).abs() < reach
    });
    let gradient = surfaces.gradient(labels, after);
    let (Some(gradient), false) = (gradient, near_face) else {
        return if near_face { [1.0; 2] } else { [0.0; 2] };
    };
    let stride = surfaces.stride();
    // Division by the stride: errors of the position, with its rounding, and of the result.
    let moved: f64 = (0..3)
        .map(|axis| (ends[1][axis] + 4.0 * ULP * size[axis] as f64) / stride[axis])
        .sum();
    let gradient_off: [f64; 3] =
        std::array::from_fn(|axis| (CHANGE * moved + SUMS) / stride[axis] + DIVIDE * gradient[axis].abs());
    let (mut along_off, mut along_size) = (0.0, 0.0);
    let (mut steep, mut steep_off, mut long, mut long_off) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
    for axis in 0..3 {
        let crossed = (to[axis] - from[axis]).abs();
        along_off += gradient_off[axis] * crossed
            + (gradient[axis].abs() + gradient_off[axis]) * (ends[0][axis] + ends[1][axis]);
        along_size += gradient[axis].abs() * crossed;
        let slope = |vector: [f64; 3]| (0..3).map(|row| (matrix[(row, axis)] * vector[row]).abs()).sum::<f64>();
        let exact: f64 = (0..3).map(|row| matrix[(row, axis)] * gradient[row]).sum();
        steep += exact * exact;
        steep_off += (slope(gradient_off) + 4.0 * ULP * slope(gradient)).powi(2);
        let offset = after[axis] - before[axis];
        long += offset * offset;
        long_off += (offs[0][axis] + offs[1][axis] + ULP * (before[axis].abs() + after[axis].abs())).powi(2);
    }
    let (steep, steep_off, long, long_off) = (steep.sqrt(), steep_off.sqrt(), long.sqrt(), long_off.sqrt());
    // The cosine is a quotient: where its divisor errs by more than a quarter, the expansion below does not hold.
    let relative = steep_off / steep + long_off / long;
    if relative.is_nan() || relative > 0.25 {
        return [1.0; 2];
    }
    let along_off = (along_off + 6.0 * ULP * along_size) / (steep * long);
    let rounded = ROOT + DIVIDE + 12.0 * ULP;
    let quotient = |off: f64, value: f64| {
        let value = value.abs();
        ((off + value * relative) / (1.0 - 1.3 * relative) + value * rounded).min(1.0)
    };
    // Across, the numerator is a product of normal and step, each off by its share, the terms of which may cancel.
    [
        quotient(along_off, cosine),
        quotient(1.3 * relative + 16.0 * ULP, across),
    ]
}
