//! Error bounds of the texture pass: a trilinear look-up in the atlas at a position known to within rounding.

use crate::parity::rounding::ULP;
use crate::parity::{Slack, Step};

/// Rounding error of one term of a voxel index, in ULP: product (1) and two sums (2); all backends store the same rows.
const TERM: f64 = 3.0;

/// Rounding error of the look-up, in ULP of the largest value: three successive mixes, each a difference, a product and
/// a sum of numbers up to twice as large, and the weight, which lost 1 in the difference with its floor.
const MIXES: f64 = 3.0 * 4.0 + 3.0;

/// Rounding error of `amplitude * (1 + strength * (value - 1))`, in ULP of its terms: strength stored (1/2),
/// difference, product, sum and product.
const APPLY: f64 = 4.5;

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let Some(atlas) = &step.tables.effects.texture else {
        return slack.fault("a texture pass without an atlas");
    };
    let strength = step
        .tables
        .settings
        .effects
        .texture
        .as_ref()
        .map_or(0.0, |texture| texture.strength);
    for index in 0..step.after.amplitude.len() {
        let [x, y, z, _] = step.after.position[index];
        // Two parts: another label, if rounding of the position has chosen one, counts in full; the same label differs
        // by the texture between the two positions.
        let row = |label: u8| step.tables.label_rows[usize::from(label)];
        let predicted = |label: u8| {
            let factor = match row(label).texture {
                0 => 1.0,
                entry => 1.0 + strength * (atlas.sample(entry as usize - 1, [x, y, z]) - 1.0),
            };
            f64::from(row(label).echo) * factor
        };
        let twin = row(step.twin.label[index]);
        let mut off = (predicted(step.after.label[index]) - predicted(step.twin.label[index])).abs();
        if twin.texture > 0 {
            let (moved, largest) = look_up(step, twin.texture as usize - 1, [x, y, z], slack.position[index]);
            off += f64::from(twin.echo) * (strength * moved + APPLY * ULP * (1.0 + strength * (1.0 + largest)));
        }
        slack.amplitude[index] = off;
    }
}

/// Returns the error bound of a look-up and the largest value that it can give.
fn look_up(step: &Step, entry: usize, p: [f64; 3], off: [f64; 3]) -> (f64, f64) {
    let Some(atlas) = &step.tables.effects.texture else {
        return (0.0, 0.0);
    };
    let placed = &atlas.entries[entry];
    let count: usize = placed.size.iter().map(|&n| n as usize).product();
    let data = &atlas.data[placed.offset as usize..][..count];
    let (least, largest) = data.iter().fold((f64::INFINITY, 0.0f64), |(low, high), &value| {
        (low.min(f64::from(value)), high.max(f64::from(value)))
    });
    let steps: f64 = placed
        .to_voxel
        .iter()
        .map(|row| {
            let terms = |q: [f64; 3]| (0..3).map(|c| (f64::from(row[c]) * q[c]).abs()).sum::<f64>();
            terms(off) + TERM * ULP * terms(p)
        })
        .sum();
    // Between neighbouring voxels a value changes by no more than the full range.
    ((largest - least) * steps + MIXES * ULP * largest, largest)
}
