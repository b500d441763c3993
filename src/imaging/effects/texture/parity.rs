//! Texture: trilinear look-up in the atlas at a position known to within rounding.

use insonify_imaging::effects::texture::Texture;

use crate::parity_tests::case::{check_all, random};
use crate::support::scene::{self, SHAPES};

#[test]
fn solid_textures_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
        settings.effects.texture = Some(Texture { strength: 0.7 });
        cases.push(random(name, settings));
    }
    check_all(&cases);
}
