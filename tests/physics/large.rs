//! The largest frame that users have asked for.

use insonify_imaging::synth::Backend;

use crate::support::anatomy::{self, PLAIN};
use crate::support::scene;
use crate::support::scene::synthesizer;

#[test]
#[ignore = "takes 1 GB of memory; run it with --ignored"]
fn a_frame_of_8192_by_8192_pixels() {
    let probe = scene::probe(scene::SHAPES[1].1, 40.0, 16, 32);
    let settings = scene::sized(probe, scene::bare(), 8192, 8192);
    let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, Backend::Cpu);
    let area = synthesizer.tables().grid.sector_area_mm2();
    let frame = synthesizer.render(&scene::straight()).expect("a frame");
    let inside = frame.pixels.iter().filter(|&&pixel| pixel == 255).count() as f64;
    let measured_mm2 = inside * frame.pixel_mm.powi(2);
    assert!(
        (measured_mm2 / area - 1.0).abs() < 1e-3,
        "{measured_mm2} mm2 of sector, not {area}"
    );
}
