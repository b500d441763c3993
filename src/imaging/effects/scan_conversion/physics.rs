//! Scan conversion: a constant has no seams, a ramp in depth stays one, and the sector has its area.

use insonify_imaging::effects::scan_conversion::bilinear;
use insonify_imaging::effects::tone::{MID_GREY, Tone};

use crate::support::anatomy::{self, PLAIN};
use crate::support::scene::{self, SHAPES};
use crate::support::scene::{precisions, synthesizer};

#[test]
fn a_constant_has_no_seams() {
    for (kind, shape) in SHAPES {
        for (width, height) in [(320, 240), (97, 211)] {
            for (name, backend) in precisions() {
                let mut settings = scene::sized(scene::probe(shape, 40.0, 24, 96), scene::bare(), width, height);
                settings.effects.tone = Some(Tone {
                    gain_db: 0.0,
                    ..Tone::linear()
                });
                let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, backend);
                let pixels = synthesizer.render(&scene::straight()).expect("a frame").pixels.clone();
                let grey = (255.0 * MID_GREY).round() as u8;
                let inside = pixels.iter().filter(|&&pixel| pixel == grey).count();
                let outside = pixels.iter().filter(|&&pixel| pixel == settings.image.fill).count();
                assert_eq!(
                    inside + outside,
                    width * height,
                    "{name}, {kind}: neither tissue nor fill"
                );
                let area = inside as f64 * synthesizer.frame().pixel_mm.powi(2);
                let expected = synthesizer.tables().grid.sector_area_mm2();
                assert!(
                    (area / expected - 1.0).abs() < 0.02,
                    "{name}, {kind}: {area} mm2 of sector, not {expected}"
                );
            }
        }
    }
}

#[test]
fn interpolation_between_equal_neighbours_is_exact_to_one_ulp() {
    for value in [0.1f32, 107.1, 255.0] {
        let beam = [value; 12];
        for line in 0..20 {
            for sample in 0..30 {
                let position = [line as f32 * 0.1, sample as f32 * 0.1];
                assert!(
                    (bilinear(&beam, 3, 4, position) - value).abs() <= value * f32::EPSILON,
                    "{position:?}"
                );
            }
        }
    }
}

#[test]
fn a_ramp_in_depth_is_one_on_the_image() {
    for (kind, shape) in SHAPES {
        for (name, backend) in precisions() {
            let mut settings = scene::sized(scene::probe(shape, 40.0, 48, 96), scene::bare(), 200, 160);
            // 20 dB over 40 mm in a range of 60 dB.
            settings.effects.tone = Some(Tone {
                tgc_db_cm: Some(5.0),
                gain_db: -10.0,
                ..Tone::linear()
            });
            let mut synthesizer = synthesizer(&anatomy::uniform(PLAIN), &settings, backend);
            let pixels = synthesizer.render(&scene::straight()).expect("a frame").pixels.clone();
            let (grid, image) = (&synthesizer.tables().grid, &synthesizer.tables().image_grid);
            let mut compared = 0;
            for (index, &pixel) in pixels.iter().enumerate() {
                let [x, y] = image.to_plane((index % 200) as f64, (index / 200) as f64);
                let Some((_, sample)) = grid.to_beam(x, y) else {
                    continue;
                };
                // The first and last half sample repeat.
                let depth = (sample.clamp(0.0, 95.0) + 0.5) * 40.0 / 96.0;
                let expected = 255.0 * (MID_GREY + (0.5 * depth - 10.0) / 60.0);
                assert!(
                    (f64::from(pixel) - expected).abs() < 0.51,
                    "{name}, {kind}: {pixel} at {depth} mm, not {expected}"
                );
                compared += 1;
            }
            assert!(compared > 5000, "{name}, {kind}: {compared}");
        }
    }
}

#[test]
fn a_pixel_shows_the_tissue_at_its_place_in_the_world() {
    // A ball seen through every probe shape: pixels inside it by the frame's own transform are bright, others are not.
    let frame = anatomy::Frame::around([0.0, 20.0, 0.0], [160, 160, 9], 0.5);
    let (centre, radius) = ([3.0, 22.0, 0.0], 7.0);
    let anatomy = anatomy::ball(frame, centre, radius, &[anatomy::SILENT, anatomy::SILENT, PLAIN]);
    for (kind, shape) in SHAPES {
        let lines = if kind == "radial" { 1200 } else { 200 };
        let mut settings = scene::sized(scene::probe(shape, 40.0, lines, 400), scene::bare(), 240, 200);
        settings.image.fill = 0;
        let mut synthesizer = synthesizer(&anatomy, &settings, insonify_imaging::synth::Backend::Cpu);
        let frame = synthesizer.render(&scene::straight()).expect("a frame");
        let (mut bright, mut dark) = (0, 0);
        for (index, &pixel) in frame.pixels.iter().enumerate() {
            let pixel_position = nalgebra::Point3::new((index % 240) as f64, (index / 240) as f64, 0.0);
            let world = frame.image_to_world.transform_point(&pixel_position);
            let away = ((world.x - centre[0]).powi(2) + (world.y - centre[1]).powi(2)).sqrt();
            // Half a voxel's diagonal, a scanline and a sample blur the rim.
            if away < radius - 0.8 {
                assert_eq!(pixel, 255, "{kind}: {world} lies in the ball");
                bright += 1;
            } else if away > radius + 0.8 {
                assert_eq!(pixel, 0, "{kind}: {world} lies outside the ball");
                dark += 1;
            }
        }
        assert!(bright > 500 && dark > 5000, "{kind}: {bright} bright, {dark} dark");
    }
}
