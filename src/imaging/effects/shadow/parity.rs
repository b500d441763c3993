//! Shadow: a sum of integers, which agree exactly wherever the labels above agree, one exponential, and its mean over
//! the beam.

use insonify_imaging::effects::shadow::Shadow;

use crate::parity_tests::case::{Case, check_all, random};
use crate::parity_tests::scenes;
use crate::support::scene::{self, SHAPES};

#[test]
fn attenuation_and_occlusion_on_every_probe_shape() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        // 700 samples: several to an invocation of the parallel sum.
        for samples in [96, 255, 256, 257, 700] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, 5, samples), scene::bare());
            settings.effects.shadow = Some(Default::default());
            cases.push(random(format!("{name}, {samples} samples"), settings));
        }
    }
    check_all(&cases);
}

#[test]
fn beams_of_any_width() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for beam_mm in [Some(0.0), Some(0.4), Some(20.0), None] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
            settings.effects.shadow = Some(Shadow {
                beam_mm,
                ..Shadow::default()
            });
            cases.push(random(format!("{name}, {beam_mm:?} mm"), settings));
        }
    }
    check_all(&cases);
}

#[test]
fn opaque_tissue_shades_part_of_the_aperture() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        let mut settings = scene::settings(scene::probe(shape, 40.0, 24, 96), scene::bare());
        for f_number in [Some(0.0), Some(0.7), Some(2.5), None] {
            settings.effects.shadow = Some(Shadow {
                f_number,
                ..Default::default()
            });
            let name = format!("{name}, f-number {f_number:?}");
            cases.push(Case::new(
                name,
                scenes::with_bone(),
                settings.clone(),
                scenes::oblique_pose(),
            ));
        }
    }
    check_all(&cases);
}

#[test]
fn echoes_are_repeated_above_bone_and_mirrored_above_gas() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (reverberation, lines, samples) in [(0.35, 24, 96), (1.0, 1, 130), (0.6, 3, 700)] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, lines, samples), scene::bare());
            settings.effects.shadow = Some(Shadow {
                reverberation,
                ..Default::default()
            });
            for (volume, anatomy) in [
                ("bone", scenes::with_bone()),
                ("gas", scenes::with_gas()),
                ("gas below a ball", scenes::above_gas()),
                ("random", scenes::random_anatomy()),
            ] {
                cases.push(Case::new(
                    format!("{name}, {lines} lines, {samples} samples, {volume}"),
                    anatomy,
                    settings.clone(),
                    scenes::oblique_pose(),
                ));
            }
        }
    }
    check_all(&cases);
}

#[test]
fn b_lines_ring_down_from_gas() {
    let mut cases = Vec::new();
    for (name, shape) in SHAPES {
        for (b_lines, samples) in [(0.3, 96), (1.0, 700)] {
            let mut settings = scene::settings(scene::probe(shape, 40.0, 12, samples), scene::bare());
            settings.effects.shadow = Some(Shadow {
                b_lines,
                ..Default::default()
            });
            for (volume, anatomy) in [("bone", scenes::with_bone()), ("gas", scenes::with_gas())] {
                cases.push(Case::new(
                    format!("{name}, {b_lines}, {samples} samples, {volume}"),
                    anatomy,
                    settings.clone(),
                    scenes::oblique_pose(),
                ));
            }
        }
    }
    check_all(&cases);
}

#[test]
fn the_needle_shades() {
    let mut settings = scene::settings(scene::small_probe(), scene::bare());
    settings.has_needle = true;
    settings.effects.needle = Some(Default::default());
    settings.effects.shadow = Some(Default::default());
    let cases = [
        Case::new(
            "needle and tissue",
            scenes::random_anatomy(),
            settings.clone(),
            scenes::with_needle(scenes::oblique_pose()),
        ),
        Case::new(
            "needle alone",
            scenes::unattenuating(),
            settings,
            scenes::with_needle(scenes::oblique_pose()),
        ),
    ];
    check_all(&cases);
}
