//! Error bounds of speckle: a lattice interpolated at positions known to within rounding, two convolutions and a
//! modulus.

use crate::effects::speckle::SpeckleTables;
use crate::effects::warp::bound as warp;
use crate::parity::rounding::{DIVIDE, ROOT, ULP};
use crate::parity::{Slack, Step};

/// Largest modulus of a scatterer, a complex number whose parts are uniform in +-sqrt(6) / 2: sqrt(3).
const SCATTERER: f64 = 1.732_050_807_568_877_2;

/// Largest interpolated scatterer. The interpolation divides by the product over the axes of sqrt(f^2 + (1 - f)^2),
/// each at least sqrt(1/2), so the result grows by at most sqrt(8).
pub(crate) const LOUDEST: f64 = SCATTERER * 2.828_427_124_746_190_3;

/// Change of the interpolated value per lattice step along one axis: with q = 1 / sqrt(f^2 + (1 - f)^2), at most q_y
/// q_z (2 |S| q_x + |S| |q_x'|), where q <= sqrt 2 and |q'| <= 1.089.
pub(crate) const SLOPE: f64 = 2.0 * SCATTERER * (2.0 * std::f64::consts::SQRT_2 + 1.089);

/// Rounding error of the interpolation, relative to the loudest: differences (2), products (3) and eight sums (8) of
/// the weighted corners, and for the scale three sums of squares (4 each), two products, root and division.
pub(crate) const INTERPOLATION: f64 = 13.0 * ULP + (6.0 + 2.0) * ULP + ROOT + DIVIDE + ULP;

/// Rounding error of a position in lattice units, in ULP of it: mix of two scanlines (3), offset (3), sum (1), lattice
/// distance stored (1/2) and product (1).
const POSITION: f64 = 8.5;

/// Rounding error of the mix of two positions, whose weight is a quotient.
const MIX: f64 = DIVIDE + 3.0 * ULP;

/// Error bound and size of the echo at each fine scanline and sample.
fn echoes(step: &Step, slack: &Slack, speckle: &SpeckleTables, specular: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (lines, samples) = (step.lines(), step.samples());
    let (fine_lines, over) = (speckle.fine_lines(lines), speckle.oversampling);
    let planes: f64 = speckle.planes.iter().map(|weight| weight.abs()).sum();
    let reach_mm = speckle.plane_mm * (speckle.planes.len() as f64 - 1.0) / 2.0;
    let outermost = step.state.probe_to_world.fixed_view::<3, 1>(0, 2) * reach_mm;
    let mut echoes = vec![[0.0f64; 2]; fine_lines * samples];
    for fine in 0..fine_lines {
        let (line, remainder) = (fine / over, fine % over);
        let next = (line + 1).min(lines - 1);
        let nearest = if remainder > 0 && 2 * remainder >= over {
            next
        } else {
            line
        };
        for sample in 0..samples {
            let (a, b) = (line * samples + sample, next * samples + sample);
            let (pa, pb) = (step.before.position[a], step.before.position[b]);
            let (_, carried) = warp::carried(step, nearest * samples + sample, outermost);
            let steps: f64 = (0..3)
                .map(|axis| {
                    let torn = if slack.torn[a] || slack.torn[b] {
                        (step.twin.position[a][axis] - pa[axis])
                            .abs()
                            .max((step.twin.position[b][axis] - pb[axis]).abs())
                    } else {
                        0.0
                    };
                    let bound = slack.position[a][axis].max(slack.position[b][axis]).max(torn);
                    let size = pa[axis].abs().max(pb[axis].abs()) + reach_mm;
                    (bound + carried[axis] + POSITION * ULP * size + MIX * (pb[axis] - pa[axis]).abs())
                        / speckle.lattice_mm
                })
                .sum();
            let value =
                planes * (SLOPE * steps + LOUDEST * (INTERPOLATION + (1.5 + speckle.planes.len() as f64) * ULP));
            let loud = planes * LOUDEST;
            let index = nearest * samples + sample;
            // Negative where a strong texture is dark.
            let (amplitude, off) = (step.before.amplitude[index].abs(), slack.amplitude[index]);
            // Echoes of surfaces and needles, interpolated between two scanlines, times a stored factor, added.
            let specular = [a, b].map(|index| specular.get(index).copied().unwrap_or([0.0; 2]));
            let factor = speckle.specular.of::<f64>()[sample];
            let [off_specular, size] = [0, 1].map(|part| factor * specular[0][part].max(specular[1][part]));
            let size = size + off_specular;
            echoes[fine * samples + sample] = [
                (amplitude + off) * value
                    + off * loud
                    + ULP * amplitude * loud
                    + off_specular
                    + (2.0 * MIX + 4.0 * ULP) * size
                    + ULP * (amplitude * loud + size),
                amplitude * loud + size,
            ];
        }
    }
    echoes
}

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let Some(speckle) = &step.tables.effects.speckle else {
        return slack.fault("speckle without tables");
    };
    let envelopes = envelopes(step, slack, speckle, &slack.specular);
    slack.amplitude = envelopes.into_iter().map(|[off, _]| off).collect();
    if step.to_nearest {
        check_typical(step, slack);
    }
}

/// Propagates the bounds to the envelopes of the steered looks: scatterers of which are turned, and made up for.
pub(crate) fn carry_looks(step: &Step, slack: &mut Slack) {
    let Some(speckle) = &step.tables.effects.speckle else {
        return slack.fault("speckle without tables");
    };
    let steered = crate::effects::compound::steered(step.tables);
    let gains = &speckle.phasors.of::<f64>()[..steered * step.samples()];
    let gain = gains.iter().copied().fold(1.0, f64::max);
    // Echoes of the middle look, and what this one has more.
    let mut specular = slack.specular.clone();
    for (of_all, more) in specular.iter_mut().zip(&slack.look_specular) {
        *of_all = [of_all[0] + more[0] + 2.0 * ULP * more[1], of_all[1] + more[1]];
    }
    // Gain, cosine and sine stored (1/2 each), three products, a sum.
    let looks = envelopes(step, slack, speckle, &specular).into_iter();
    slack.looks = looks
        .map(|[off, size]| [gain * (off + 5.0 * ULP * size), gain * size])
        .collect();
}

/// Bound and size of the envelope of each sample.
fn envelopes(step: &Step, slack: &Slack, speckle: &SpeckleTables, specular: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let (lines, samples) = (step.lines(), step.samples());
    let fine_lines = speckle.fine_lines(lines);
    let over = speckle.oversampling;
    let echoes = echoes(step, slack, speckle, specular);
    let reach = speckle.axial_reach();
    let mut spread = vec![[0.0f64; 2]; fine_lines * samples];
    for fine in 0..fine_lines {
        for sample in 0..samples {
            let mut sum = [0.0; 2];
            let axial = speckle.axial_at::<f64>(sample, samples);
            for (tap, weight) in axial.iter().enumerate() {
                if let Some(index) = (sample + tap).checked_sub(reach).filter(|&index| index < samples) {
                    sum = add(sum, weight.abs(), echoes[fine * samples + index]);
                }
            }
            // One more product with a stored factor at the ends.
            let factor = speckle.ends.of::<f64>()[sample];
            spread[fine * samples + sample] = rounded(sum, axial.len() + 2).map(|x| x * factor);
        }
    }
    let reach = speckle.lateral.reach;
    let mut envelopes = vec![[0.0; 2]; lines * samples];
    for line in 0..lines {
        let centre = line * over;
        for sample in 0..samples {
            let mut sum = [0.0; 2];
            for (tap, weight) in speckle.lateral.at(sample).enumerate() {
                if let Some(fine) = (centre + tap).checked_sub(reach).filter(|&fine| fine < fine_lines) {
                    sum = add(sum, weight.abs(), spread[fine * samples + sample]);
                }
            }
            let taps = 2 * reach + 1;
            let [off, size] = rounded(sum, taps);
            let scale = speckle
                .edge(line, lines)
                .map_or(1.0, |row| speckle.edges.of::<f64>()[row * samples + sample]);
            // The modulus: root of a sum of two squares; at the edges times a stored factor.
            let modulus = ROOT + 2.0 * ULP + 1.5 * ULP;
            envelopes[line * samples + sample] = [scale * (off + modulus * size), scale * size];
        }
    }
    envelopes
}

/// Ratio of typical error to bound. The bound adds thousands of roundings (kernel taps, corners, terms) as if all had
/// the same sign. Independent roundings add in quadrature (N. J. Higham and T. Mary, SIAM J. Sci. Comput. 41(5), 2019):
/// the sum of `n` of equal size is the bound over sqrt(n). With more than 400 in every echo of these scenes, typically
/// a twentieth remains. This holds for rounding to nearest, whose errors have no common sign, and not where a device
/// truncates, as WGSL allows.
const TYPICAL: f64 = 1.0 / 20.0;

/// Checks the root mean square of the deviations, which an error too small for the bounds would still raise. Samples
/// with a wide bound because of a doubtful label nearby are excluded; only the bounds apply to them.
fn check_typical(step: &Step, slack: &mut Slack) {
    let mut bounds = slack.amplitude.clone();
    bounds.sort_by(f64::total_cmp);
    let Some(&middle) = bounds.get(bounds.len() / 2) else {
        return;
    };
    let (mut off, mut bound) = (0.0, 0.0);
    for (index, &sample_bound) in slack
        .amplitude
        .iter()
        .enumerate()
        .filter(|&(_, sample_bound)| *sample_bound <= 2.0 * middle)
    {
        off += (step.after.amplitude[index] - step.twin.amplitude[index]).powi(2);
        bound += sample_bound * sample_bound;
    }
    let (off, bound) = (off.sqrt(), TYPICAL * bound.sqrt());
    if off > bound || off.is_nan() {
        slack.fault(format!(
            "speckle is off by {off:e} in all, typically by no more than {bound:e}"
        ));
    }
}

fn add(sum: [f64; 2], weight: f64, term: [f64; 2]) -> [f64; 2] {
    [sum[0] + weight * term[0], sum[1] + weight * term[1]]
}

/// Bounds a sum of weighted terms: weights stored (1/2), products (1), as many sums as terms.
fn rounded([off, size]: [f64; 2], terms: usize) -> [f64; 2] {
    [off + (1.5 + terms as f64) * ULP * size, size]
}
