//! Blur: a convolution across scanlines with weights that sum to 1.

use insonify_imaging::effects::blur::Blur;

use crate::parity_tests::case::{check_all, random};
use crate::support::scene::{self, SHAPES};

#[test]
fn narrow_and_wide_blurs_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (width_mm, growth_mm_cm) in [(0.6, 0.06), (0.0, 0.0), (12.0, 2.0)] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
            settings.effects.blur = Some(Blur {
                width_mm: Some(width_mm),
                growth_mm_cm: Some(growth_mm_cm),
            });
            cases.push(random(format!("{name}, {width_mm} mm"), settings));
        }
    }
    check_all(&cases);
}
