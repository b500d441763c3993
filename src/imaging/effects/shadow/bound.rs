//! Error bounds of shadows: sums of integers, equal wherever the labels above agree, their exponentials, and their
//! means over the aperture and over the beam.

use crate::effects::common::spacing;
use crate::effects::shadow::aperture::LEAST_PRESENT;
use crate::effects::shadow::b_lines::BLines;
use crate::effects::shadow::penumbra::opaque_units;
use crate::effects::shadow::reverberation::{self, Surface, returned, share};
use crate::effects::shadow::{MAX_UNITS, exponent_per_unit, mirror, needle_units, opens};
use crate::effects::speckle::bound::{INTERPOLATION, LOUDEST, SLOPE};

use crate::parity::rounding::{DIVIDE, ROOT, TINY, ULP, exp2};
use crate::parity::{Slack, Step};

/// Propagates the bounds through the pass of the losses, which does not change echoes.
pub(crate) fn carry_loss(step: &Step, slack: &mut Slack) {
    let samples = step.samples();
    let scanlines =
        (0..step.lines()).flat_map(|line| down(step, |sample| losses(step, slack, line * samples + sample)));
    let losses = scanlines.map(|[_, off]| off).collect();
    slack.loss = losses;
}

/// Returns the losses of a sample, by attenuation and others, in units, with their error bounds.
fn losses(step: &Step, slack: &Slack, index: usize) -> [[f64; 2]; 2] {
    let [exact, twin] = [step.after, step.twin].map(|beam| {
        let row = step.tables.label_rows[usize::from(beam.label[index])];
        [row.attenuation, row.loss - row.attenuation].map(f64::from)
    });
    let [needle, needle_off] = needle(step, slack, index);
    [
        [exact[0], (exact[0] - twin[0]).abs()],
        [exact[1] + needle, (exact[1] - twin[1]).abs() + needle_off],
    ]
}

/// Returns the loss of a sample in the needle, in units, and its error bound.
fn needle(step: &Step, slack: &Slack, index: usize) -> [f64; 2] {
    let units = f64::from(needle_units(step.tables));
    let Some(shade) = step.after.shade.get(index).filter(|_| step.tables.settings.has_needle) else {
        return [0.0; 2];
    };
    let shade_off = slack.shade.get(index).copied().unwrap_or(0.0);
    // Truncating the product to whole units may change it by one.
    let off = if shade_off > 0.0 {
        units * (shade_off + ULP) + 1.0
    } else {
        0.0
    };
    [(shade * units).floor(), off]
}

/// Accumulates the samples' own losses down to the middle of each sample, as a pulse feels them, with error bounds.
fn down(step: &Step, losses: impl Fn(usize) -> [[f64; 2]; 2]) -> Vec<[f64; 2]> {
    let [unfelt, least_centre_at] = step.tables.effects.shadow.downshift;
    let mut above = [[0.0; 2]; 2];
    let sample = |sample| {
        let own = losses(sample);
        let [attenuation, other] = [0, 1].map(|kind| {
            let ([sum, sum_off], [loss, off]) = (above[kind], own[kind]);
            // Half of the sample's own loss, again truncated to whole units.
            let halved = if off > 0.0 { 0.5 * off + 1.0 } else { 0.0 };
            above[kind] = [sum + loss, sum_off + off];
            [(sum + (0.5 * loss).floor()).min(f64::from(MAX_UNITS)), sum_off + halved]
        });
        let shifting = attenuation[0].min(least_centre_at);
        let spared = unfelt * shifting * (2.0 * attenuation[0] - shifting);
        // Units converted (1/2), both numbers stored (1), a difference and a sum (2) of up to twice the units, two
        // products; truncated to whole units.
        let rounded = 12.0 * ULP * unfelt * shifting * 2.0 * attenuation[0] + if spared > 0.0 { 1.0 } else { 0.0 };
        [
            attenuation[0] - spared.floor() + other[0],
            attenuation[1] + other[1] + rounded,
        ]
    };
    (0..step.samples()).map(sample).collect()
}

/// Returns the one-way transmittance down every ray of every element, with error bounds, if there are any.
pub(crate) fn of_rays(step: &Step, slack: &Slack) -> Vec<[f64; 2]> {
    if !opens(step.tables) {
        return Vec::new();
    }
    let (lines, samples) = (step.lines(), step.samples());
    let aperture = &step.tables.effects.shadow.aperture;
    (0..aperture.rays() * lines)
        .flat_map(|row| {
            let (ray, element) = (row / lines, row % lines);
            let losses = down(step, |sample| {
                let line = aperture.line_at([ray, element, sample], lines);
                losses(step, slack, line * samples + sample)
            });
            losses.into_iter().map(|[loss, off]| one_way(loss, off))
        })
        .collect()
}

/// Returns the one-way transmittance of every sample before the mean over the beam, with error bounds, in the look so
/// many steps to the side.
fn through(step: &Step, slack: &Slack, steps: i32, of_rays: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (lines, samples) = (step.lines(), step.samples());
    if !opens(step.tables) {
        let losses = step.after.loss.iter().zip(&slack.loss);
        return losses.map(|(loss, off)| one_way(f64::from(*loss), *off)).collect();
    }
    let aperture = &step.tables.effects.shadow.aperture;
    let rays = aperture.rays_of(steps).len() as f64;
    let mean = |line: usize, sample: usize| {
        // Least, exact and largest product of the means, and of the weights that are present.
        let (mut product, mut whole) = ([1.0; 3], 1.0);
        for way in 0..2 {
            let (mut sum, mut off, mut present) = (0.0, 0.0, 0.0);
            for (of_look, ray) in aperture.rays_of(steps).enumerate() {
                let weight = aperture.weights::<f64>(of_look)[way][sample];
                if let Some(element) = aperture.element_at([ray, line, sample], lines) {
                    let [through, through_off] = of_rays[(ray * lines + element) * samples + sample];
                    sum += weight * through;
                    off += weight * through_off;
                    present += weight;
                }
            }
            // Weights stored (1/2), products (1) and sums; what is present to as many, relative to 1.
            let present = f64::max(present, LEAST_PRESENT.sqrt());
            let off = off + (rays + 1.5) * ULP * (sum + off) * (1.0 + 1.0 / present) + TINY;
            product[0] *= (sum - off).max(0.0) / present;
            product[1] *= sum / present;
            product[2] *= (sum + off) / present;
            whole *= present;
        }
        let [least, exact, most] = product.map(f64::sqrt);
        // Two products, the division and the root; small products may be flushed to zero.
        let off = (DIVIDE + ROOT + 2.0 * ULP) * most + 2.0 * (TINY / whole).sqrt();
        [exact, (most - exact).max(exact - least) + off]
    };
    (0..lines * samples)
        .map(|index| mean(index / samples, index % samples))
        .collect()
}

/// Returns the one-way transmittance for a loss, and its error bound.
fn one_way(loss: f64, off: f64) -> [f64; 2] {
    let exponent = 0.5 * exponent_per_unit();
    let left = |units: f64| (units.clamp(0.0, f64::from(MAX_UNITS)) * exponent).exp2();
    let (largest_share, least_share) = (left(loss - off), left(loss + off));
    let largest = (loss + off) * exponent.abs();
    // Units converted, beyond 2^24 in either direction (1), factor stored (1/2), product (1); then the exponential.
    let relative = exp2(largest, 2.5 * ULP * largest);
    [
        left(loss),
        largest_share - least_share + largest_share * relative.min(1.0) + TINY,
    ]
}

/// Propagates the bounds through the mean over the beam.
pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    if step.tables.effects.shadow.penumbra.is_none() {
        return slack.fault("a shadow without a kernel");
    }
    let left = left(step, slack, 0, &of_rays(step, slack));
    for (index, [square, square_off]) in left.into_iter().enumerate() {
        let amplitude = step.before.amplitude[index].abs();
        // Two products.
        slack.amplitude[index] = slack.amplitude[index] * (square + square_off)
            + amplitude * (square_off + 2.0 * ULP * (square + square_off))
            + TINY * (1.0 + amplitude);
    }
}

/// Returns the two-way transmittance of every sample in the look so many steps to the side, with error bounds; all of
/// it without a shadow.
pub(crate) fn left(step: &Step, slack: &Slack, steps: i32, of_rays: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (lines, samples) = (step.lines(), step.samples());
    let mut squares = vec![[1.0, 0.0]; lines * samples];
    let Some(kernel) = &step.tables.effects.shadow.penumbra else {
        return squares;
    };
    let opaque = opaque_units(step.tables.sample_mm());
    let is_opaque = |label: u8| step.tables.label_rows[usize::from(label)].loss >= opaque;
    let left_of_all = through(step, slack, steps, of_rays);
    for sample in 0..samples {
        let weights: Vec<f64> = kernel.at(sample).collect();
        let through: Vec<[f64; 2]> = (0..lines).map(|line| left_of_all[line * samples + sample]).collect();
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
            // As in `blur`: weights stored (1/2), products (1) and sums; for a truncated kernel also a division.
            let off = off + ((1.5 + 2.0 * weights.len() as f64) * ULP + DIVIDE) * (mean + off) / norm.min(1.0);
            let index = line * samples + sample;
            let [on_line, line_off] = through[line];
            let darker = [on_line.min(mean), off.max(line_off)];
            let [left, off] = match [step.after, step.twin].map(|beam| is_opaque(beam.label[index])) {
                [false, false] => [mean, off],
                [true, true] => darker,
                // Within rounding of the face of something opaque: any value between.
                [true, false] => [darker[0], mean - darker[0] + off.max(line_off)],
                [false, true] => [mean, mean - darker[0] + off.max(line_off)],
            };
            squares[index] = [left * left, (2.0 * left + off) * off];
        }
    }
    squares
}

/// Returns the first opaque sample of each scanline, for both backends.
fn tops(step: &Step) -> [Vec<u32>; 2] {
    [step.after, step.twin].map(|beam| reverberation::tops(step.tables, &beam.label))
}

/// Returns the rounding error of the norm of two numbers: squares below the smallest normal number may be flushed to
/// zero.
fn norm(size: f64) -> f64 {
    (ROOT + 4.0 * ULP) * size + 2.0 * TINY.sqrt()
}

/// Propagates the bounds through the pass that adds mirror images.
pub(crate) fn carry_mirror(step: &Step, slack: &mut Slack) {
    let (lines, samples) = (step.lines(), step.samples());
    let spacing = spacing(step.tables);
    let tops = tops(step);
    let share = mirror::share(step.tables);
    let before = &step.before.amplitude;
    let carried = slack.amplitude.clone();
    for line in 0..lines {
        let row = line * samples;
        // Mirror image with its error bound, for each backend.
        let images = [(&tops[0], step.after), (&tops[1], step.twin)].map(|(tops, beam)| {
            let mut images = vec![[0.0; 2]; samples];
            let depth = tops[line] as usize;
            let is_gas = |label: u8| step.tables.label_rows[usize::from(label)].impedance < mirror::GAS_MRAYL;
            if depth >= samples || !is_gas(beam.label[row + depth]) {
                return images;
            }
            let mirror = mirror::Mirror { tops, samples, spacing };
            let slope = Surface::new(step.tables, tops).slope(line, spacing);
            let index = row + depth - 1;
            let rate = f64::from(step.after.loss[index]) * exponent_per_unit() / depth as f64;
            for (sample, image) in images.iter_mut().enumerate().skip(depth) {
                let [from_line, from, longer] = mirror.place(line, slope, sample);
                if !(-2.0..lines as f64 + 1.0).contains(&from_line) || !(-2.0..samples as f64 + 1.0).contains(&from) {
                    continue;
                }
                // About twenty operations on lengths up to the radius of the far end, also in units of scanlines.
                let distance = spacing[0] + spacing[1] * from.max(0.5);
                let radius = if spacing[1] > 0.0 { spacing[0] / spacing[1] } else { 0.0 } + samples as f64;
                let off = 20.0 * ULP * 2.0 * radius;
                let off = off + off / distance + 4.0 * ULP * lines as f64;
                let around = |values: &[f64]| {
                    let window = |position: f64, count: usize| {
                        let first = position.floor() as i64 - 1;
                        first.max(0) as usize..(first + 4).clamp(0, count as i64) as usize
                    };
                    let mut loudest = 0.0f64;
                    for other in window(from_line, lines) {
                        for sample in window(from, samples) {
                            loudest = loudest.max(values[other * samples + sample]);
                        }
                    }
                    loudest
                };
                let exponent = rate * longer;
                let left = share * exponent.exp2();
                let lost = (slack.loss[index] * exponent_per_unit().abs() / depth as f64) * longer;
                let relative = exp2(exponent.abs(), 8.0 * ULP * exponent.abs() + lost + rate.abs() * off);
                let largest = around(before);
                let exact = left * mirror.echo(before, [from_line, from]);
                *image = [
                    exact,
                    left * (2.0 * off * largest + around(&carried)) + (relative + 12.0 * ULP) * left * largest,
                ];
            }
            images
        });
        let least = tops[0][line].min(tops[1][line]) as usize;
        for sample in least..samples {
            let [[exact, off], [twin, twin_off]] = [images[0][sample], images[1][sample]];
            // The norm of a pair moves by at most the change of either component.
            slack.amplitude[row + sample] +=
                (exact - twin).abs() + off.max(twin_off) + norm(before[row + sample].hypot(exact));
        }
    }
}

/// Propagates the bounds through the pass that adds reverberation.
pub(crate) fn carry_reverberation(step: &Step, slack: &mut Slack) {
    let (lines, samples) = (step.lines(), step.samples());
    let [tops, of_twin] = tops(step);
    for line in 0..lines {
        let row = line * samples;
        let before = &step.before.amplitude[row..][..samples];
        let left = step.tables.effects.shadow.left_of_average.of::<f64>();
        // Period, gain with its error bound, and the resulting echoes.
        let repeated = |tops: &[u32], labels: &[u8]| {
            let depth = tops[line] as usize;
            if depth >= samples {
                return (samples, 0.0, 0.0, before.to_vec());
            }
            let index = row + depth - 1;
            let surface = Surface::new(step.tables, tops);
            let returned = returned(step.tables, [labels[index], labels[index + 1]], depth);
            let (period, met) = surface.stretch::<f64>(line);
            let gain = returned * met * surface.directivity(line, spacing(step.tables));
            // About seventy operations on numbers up to 1 in the directivity, the reflection and the product; two
            // stored numbers, their ratio and a product.
            let off = 80.0 * ULP + 3.0 * DIVIDE;
            let mut echoes = before.to_vec();
            for sample in depth.max(period)..samples {
                let passed = left[sample] / left[sample - period];
                echoes[sample] = echoes[sample].hypot(gain * passed * echoes[sample - period]);
            }
            (period, gain, off * share(step.tables), echoes)
        };
        let (period, gain, gain_off, echoes) = repeated(&tops, &step.after.label);
        let (twin_period, of_other, other_off, others) = repeated(&of_twin, &step.twin.label);
        let (gain, gain_off) = (gain.max(of_other), gain_off.max(other_off));
        let least = tops[line].min(of_twin[line]) as usize;
        for sample in least..samples {
            let now = row + sample;
            // The norm of a pair moves by at most the change of either component.
            for from in [period, twin_period]
                .map(|period| sample.checked_sub(period))
                .into_iter()
                .flatten()
            {
                slack.amplitude[now] += (gain + gain_off) * slack.amplitude[row + from] + gain_off * echoes[from];
            }
            slack.amplitude[now] += norm(echoes[sample]) + (echoes[sample] - others[sample]).abs();
        }
    }
}

/// A B-line of a scanline, for one backend.
struct Stripe {
    /// Sample of the surface.
    top: usize,
    /// Strength, with its error bound.
    strength: [f64; 2],
    /// Two-way transmittance down to the surface, with its error bound.
    passed: [f64; 2],
    /// Place on the lattice, and how far rounding moves it.
    place: [f64; 3],
    moved: f64,
}

/// Propagates the bounds through the pass that draws B-lines.
pub(crate) fn carry_b_lines(step: &Step, slack: &mut Slack) {
    let (lines, samples) = (step.lines(), step.samples());
    let tops = tops(step);
    let b_lines = BLines::<f64>::of(step.tables);
    let left = step.tables.effects.shadow.left_of_average.of::<f64>();
    for line in 0..lines {
        let row = line * samples;
        let stripes = [(&tops[0], step.after), (&tops[1], step.twin)].map(|(tops, beam)| {
            let top = tops[line] as usize;
            if top >= samples || !mirror::is_gas(step.tables, beam.label[row + top]) {
                return None;
            }
            let index = row + top;
            let position = step.after.position[index];
            let place = b_lines.place(position);
            let torn = slack.torn.get(index).copied().unwrap_or(false);
            // Position, its product with the stored density, and the sum with what lies along the beam.
            let moved: f64 = (0..3)
                .map(|axis| slack.position[index][axis] * b_lines.per_mm + 4.0 * ULP * place[axis].abs())
                .sum();
            // Torn positions leave it open.
            let moved = if torn { f64::INFINITY } else { moved };
            let rough_off = SLOPE * moved + LOUDEST * INTERPOLATION;
            let strength = b_lines.strength(place);
            // The square of the modulus, the stored threshold, a difference and a product.
            let strength_off = b_lines.steepness
                * ((2.0 * LOUDEST + rough_off) * rough_off + 6.0 * ULP * (LOUDEST * LOUDEST + b_lines.threshold));
            let strength_off = strength_off.min(1.0);
            let [one_way, off] = one_way(f64::from(step.after.loss[index - 1]), slack.loss[index - 1]);
            let passed = one_way * one_way;
            let passed_off = (2.0 * one_way + off) * off;
            Some(Stripe {
                top,
                strength: [strength, strength_off],
                passed: [passed, passed_off],
                place,
                moved,
            })
        });
        if stripes.iter().all(Option::is_none) {
            continue;
        }
        for sample in 0..samples {
            let amplitude = step.before.amplitude[row + sample];
            let own = slack.amplitude[row + sample];
            // Echo of each backend with its error bound.
            let [exact, twin] = stripes.each_ref().map(|stripe| {
                let Some(stripe) = stripe.as_ref().filter(|stripe| sample >= stripe.top) else {
                    return [amplitude, own];
                };
                let Stripe {
                    top,
                    strength: [strength, strength_off],
                    passed: [passed, passed_off],
                    place,
                    moved,
                } = *stripe;
                let below = sample - top;
                let size = b_lines.ring * passed * left[sample] / left[top];
                let size_off = size * (8.0 * ULP + DIVIDE) + b_lines.ring * passed_off * left[sample] / left[top];
                let along = b_lines.per_sample * below as f64;
                let ripple_off = SLOPE * (moved + 4.0 * ULP * along) + LOUDEST * INTERPOLATION;
                let ripple_off = (ripple_off + norm(LOUDEST)).min(2.0 * LOUDEST);
                let ripple = b_lines.ripple(place, below);
                let stripe = size * strength * ripple;
                let stripe_off = (size + size_off) * ((strength + strength_off) * ripple_off + strength_off * ripple)
                    + size_off * strength * ripple;
                let echo = amplitude * (1.0 - strength);
                let echo_off = own * (1.0 - strength + strength_off) + amplitude * (strength_off + 2.0 * ULP);
                let sum = echo.hypot(stripe);
                [sum, echo_off + stripe_off + norm(sum)]
            });
            slack.amplitude[row + sample] = (exact[0] - twin[0]).abs() + exact[1].max(twin[1]);
        }
    }
}
