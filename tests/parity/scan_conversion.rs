//! Scan conversion: bilinear between four samples, at coordinates that all backends share.

use insonify::effects::scan_conversion::bilinear;
use insonify::synth::layers::Beam;
use insonify::synth::tables::Tables;

use crate::case::{Case, check_all};
use crate::rounding::ULP;
use crate::scenes;
use crate::support::scene::{self, SHAPES};

/// Losses of two mixes in a row (difference, product, sum of numbers up to 255; the share is exact), in ULP of 255.
const MIXES: f64 = 2.0 * 4.0;

/// Grey level of each pixel and how far a twin may be off.
pub fn carry(tables: &Tables, beam: &Beam, slack: &[f64]) -> Vec<[f64; 2]> {
    let fill = f64::from(tables.settings.image.fill);
    let pixel = |&at: &[f32; 2]| {
        if at[0] < 0.0 {
            return [fill, 0.0];
        }
        let grey = bilinear(&beam.amplitude, beam.lines, beam.samples, at);
        let off = bilinear(slack, beam.lines, beam.samples, at);
        [grey, off + MIXES * ULP * 255.0]
    };
    tables.scan_map.iter().map(pixel).collect()
}

#[test]
fn pixels_of_every_probe_shape_at_odd_sizes() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (width, height) in [(64, 48), (257, 31), (3, 200), (1, 1)] {
            let probe = scene::probe(shape, 40.0, 24, 96);
            let settings = scene::sized(probe, scene::bare(), width, height);
            cases.push(Case::new(
                format!("{name} {width} x {height}"),
                scenes::random_anatomy(),
                settings,
                scenes::oblique_pose(),
            ));
        }
    }
    check_all("scan conversion", &cases);
}
