//! The scenes that come with the crate load, resolve and render.

use std::path::Path;

use insonify_imaging::scene::{EXAMPLES, SceneFile};
use insonify_imaging::synth::Frame;

use super::support::{render, shrink, synthesizer, without_textures};

fn example(name: &str) -> SceneFile {
    let (_, text) = EXAMPLES.iter().find(|(known, _)| *known == name).expect(name);
    let mut file = SceneFile::parse(text, name).expect(name);
    shrink(&mut file);
    file
}

/// As [`example`], quicker to render.
fn quick(name: &str) -> SceneFile {
    let mut file = example(name);
    without_textures(&mut file);
    file
}

#[test]
fn every_scene_makes_a_picture() {
    for (name, _) in EXAMPLES {
        // One of them with its solid textures.
        let file = if *name == "default" { example(name) } else { quick(name) };
        let scene = file.resolve(Path::new(".")).expect(name);
        assert!(scene.warnings.is_empty(), "{name}: {:?}", scene.warnings);
        let mut synthesizer = synthesizer(&scene);
        let frame = render(&scene, &mut synthesizer, 0, scene.frames());
        assert_eq!((frame.width, frame.height), (120, 90));
        let bright = frame.pixels.iter().filter(|&&grey| grey > 60).count();
        let dark = frame.pixels.iter().filter(|&&grey| grey < 20).count();
        let pixels = frame.pixels.len();
        assert!(
            bright > pixels / 20 && dark > pixels / 20,
            "{name}: {bright} bright, {dark} dark of {pixels}"
        );
    }
}

#[test]
fn what_a_scene_does_not_name_is_not_made() {
    let plain = quick("default").resolve(Path::new(".")).expect("default");
    assert!(plain.anatomy.mesh.is_none() && !plain.settings.has_needle);
    assert!(plain.needle_pose(0, 1).is_none());
    let plan = synthesizer(&plain).plan().report(&plain.origins);
    let passes: Vec<_> = plan.passes.iter().map(|pass| pass.effect).collect();
    for absent in ["warp", "needle", "blur", "noise"] {
        assert!(!passes.contains(&absent), "{absent} in {passes:?}");
        assert!(plan.without.iter().any(|omitted| omitted.name == absent), "{absent}");
    }
    let needle = quick("liver-needle").resolve(Path::new(".")).expect("needle");
    assert!(needle.anatomy.mesh.is_some() && needle.settings.has_needle);
    let plan = synthesizer(&needle);
    assert!(plan.plan().has("warp") && plan.plan().has("needle"));
}

#[test]
fn the_needle_scene_shows_its_needle() {
    let with = quick("liver-needle");
    let mut without = with.clone();
    without.needle = None;
    let [with, without] = [with, without].map(|file| file.resolve(Path::new(".")).expect("scene"));
    let [shown, hidden] = [&with, &without].map(|scene| render(scene, &mut synthesizer(scene), 0, 1));
    let to_image = shown.image_to_world.try_inverse().expect("image");
    let shaft = with.needle_pose(0, 1).expect("needle");
    // From the tip back to the skin.
    let (tip, back) = (shaft.tip_mm(), shaft.direction().into_inner());
    let along = |frame: &Frame| {
        let greys = (0..40).map(|mm| {
            let pixel = to_image.transform_point(&(tip - back * f64::from(mm)));
            f64::from(frame.pixels[pixel.y.round() as usize * frame.width + pixel.x.round() as usize])
        });
        greys.sum::<f64>() / 40.0
    };
    let (with, without) = (along(&shown), along(&hidden));
    assert!(
        with > without + 40.0,
        "mean grey {with} with the needle, {without} without"
    );
}

#[test]
fn a_sweep_shows_different_places() {
    let scene = quick("sweep").resolve(Path::new(".")).expect("sweep");
    assert_eq!(scene.frames(), 24);
    let mut synthesizer = synthesizer(&scene);
    let first = render(&scene, &mut synthesizer, 0, 24);
    let last = render(&scene, &mut synthesizer, 23, 24);
    let same = first.pixels.iter().zip(&last.pixels).filter(|(a, b)| a == b).count();
    assert!(same < first.pixels.len() * 3 / 4, "{same} pixels alike");
    let turned = scene
        .probe_pose(0, 24)
        .rotation()
        .angle_to(&scene.probe_pose(23, 24).rotation());
    assert!((turned.to_degrees() - 28.0).abs() < 0.1, "{}", turned.to_degrees());
}
