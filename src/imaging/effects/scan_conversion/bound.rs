//! Error bounds of scan conversion: bilinear interpolation of four samples, at coordinates common to all backends.

use crate::effects::scan_conversion::bilinear;

use crate::parity::rounding::ULP;
use crate::parity::{Slack, Step};

/// Rounding error of two successive mixes (difference, product, sum of numbers up to 255; the weight is exact), in ULP
/// of 255.
const MIXES: f64 = 2.0 * 4.0;

pub(crate) fn carry(step: &Step, slack: &mut Slack) {
    let (tables, beam) = (step.tables, step.after);
    let fill = f64::from(tables.settings.image.fill);
    let pixel = |&beam_position: &[f32; 2]| {
        if beam_position[0] < 0.0 {
            return [fill, 0.0];
        }
        let grey = bilinear(&beam.amplitude, beam.lines, beam.samples, beam_position);
        let off = bilinear(&slack.amplitude, beam.lines, beam.samples, beam_position);
        [grey, off + MIXES * ULP * 255.0]
    };
    slack.image = tables.scan_map.iter().map(pixel).collect();
}
