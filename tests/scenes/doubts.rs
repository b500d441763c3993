//! What is possible and seldom meant: each doubt with one scene that earns it and one near miss that does not.

use insonify_imaging::plan::Plan;
use insonify_imaging::scene::Scene;
use insonify_imaging::synth::tables::Tables;

use super::support::{data, parse, resolve, shrink, small, without_textures};

/// Warnings about a scene.
fn warnings(text: &str) -> Vec<String> {
    let scene = resolve(&small(text)).unwrap_or_else(|error| panic!("{error}\n{text}"));
    scene.warnings
}

/// Warnings about a scene and what its effects derive.
fn all_warnings(text: &str) -> Vec<String> {
    let scene = resolve(&small(text)).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let tables = Tables::new(scene.anatomy.clone(), scene.settings.clone()).expect("tables");
    [scene.warnings, Plan::new(&tables).warnings].concat()
}

#[test]
fn what_is_seldom_meant_is_doubted_and_what_is_near_is_not() {
    let needle = |x: f64, z: f64| {
        format!(
            "[pose]\nposition_mm = [0, -120, 0]\ndirection = [0, 1, 0]\n\
             [needle]\ntip_mm = [{x}, 0, {z}]\nentry_mm = [{}, -60, {z}]",
            x + 30.0
        )
    };
    let path = |factor: f64| {
        let keyframe = |time_s: f64, z: f64| {
            format!(
                "[[motion.keyframes]]\ntime_s = {time_s}\nposition_mm = [0, {}, {}]\ndirection = [0, 1, 0]\n",
                -105.0 * factor,
                z * factor
            )
        };
        format!("{}{}", keyframe(0.0, -10.0), keyframe(1.0, 10.0))
    };
    let attenuation =
        |name: &str, value: f64| format!("[[tissue]]\nname = \"{name}\"\nattenuation_db_cm_mhz = {value}");
    for (doubted, words, near) in [
        (
            "[probe]\nangle_deg = 1.22".to_owned(),
            &["probe.angle_deg = 1.22", "in radians", "70 degrees"][..],
            "[probe]\nangle_deg = 5.0".to_owned(),
        ),
        (
            "[probe]\nradius_mm = 6\ndepth_mm = 15".to_owned(),
            &["probe.radius_mm = 6 and probe.depth_mm = 15: in cm?", "60 and 150 mm"],
            // A convex array for small parts.
            "[probe]\nradius_mm = 10\ndepth_mm = 40".to_owned(),
        ),
        (
            "[probe]\ndepth_mm = 0.12".to_owned(),
            &["probe.depth_mm = 0.12: in m?"],
            "[probe]\ndepth_mm = 120".to_owned(),
        ),
        (
            "[needle]\ntip_mm = [-0.038, -0.04, -0.016]\nentry_mm = [-0.038, -0.094, -0.016]".to_owned(),
            &["needle.entry_mm and tip_mm are 0.05 mm apart: in m or cm?"],
            "[needle]\ntip_mm = [-38, -40, -16]\nentry_mm = [-38, -42, -16]".to_owned(),
        ),
        (
            attenuation("liver", 50.0),
            &["\"liver\": attenuation_db_cm_mhz = 50", "at most 3"],
            attenuation("liver", 2.9),
        ),
        (
            attenuation("bone", 30.0),
            &["\"bone\": attenuation_db_cm_mhz = 30", "at most 20"],
            attenuation("bone", 19.0),
        ),
        (
            "[probe]\nfrequency_mhz = 50".to_owned(),
            &[
                "soft tissue takes 392 dB from an echo of 150 mm",
                "at 50 MHz",
                "below 46 mm",
            ],
            "[probe]\nfrequency_mhz = 8".to_owned(),
        ),
        (
            "[randomise]\ndepth_mm = { uniform = [10, 60] }".to_owned(),
            &["probe.depth_mm = 10: in cm?"],
            "[randomise]\ndepth_mm = { uniform = [30, 60] }".to_owned(),
        ),
        (
            "[randomise]\nliver.attenuation_db_cm_mhz = { uniform = [0.4, 45] }".to_owned(),
            &["\"liver\": attenuation_db_cm_mhz = 45"],
            "[randomise]\nliver.attenuation_db_cm_mhz = { uniform = [0.4, 2.9] }".to_owned(),
        ),
        (
            "[randomise]\nprostate_central.attenuation_db_cm_mhz = { uniform = [0.4, 0.6] }".to_owned(),
            &[
                "change nothing: no label of the volume is of it",
                "\"prostate_central\"",
            ],
            "[randomise]\nliver.attenuation_db_cm_mhz = { uniform = [0.4, 0.6] }".to_owned(),
        ),
        (
            "[randomise]\neffects.needle.thickness_mm = { uniform = [1, 3] }".to_owned(),
            &["`effects.needle.thickness_mm` changes nothing", "has no needle"],
            "[needle]\ntip_mm = [-38, -40, -16]\nentry_mm = [-38, -94, -16]\n\
             [randomise]\neffects.needle.thickness_mm = { uniform = [1, 3] }"
                .to_owned(),
        ),
        (
            "[probe]\ndepth_mm = 16\n[pose]\ntarget = \"kidney\"".to_owned(),
            &["is nowhere within 16 mm of the skin in sight", "it begins at"],
            "[probe]\ndepth_mm = 140\n[pose]\ntarget = \"kidney\"".to_owned(),
        ),
        (
            "[needle]\ntip_mm = [-38, -94, -16]\nentry_mm = [-38, -40, -16]".to_owned(),
            &["comes from within the body", "entry and its tip exchanged"],
            "[needle]\ntip_mm = [-38, -40, -16]\nentry_mm = [-38, -94, -16]".to_owned(),
        ),
        (
            path(0.1),
            &[
                "the probe lies within the body in 2 of 2 poses",
                "in cm?",
                "on the body in 2",
            ],
            path(1.0),
        ),
        (
            needle(0.0, 8.0),
            &["the needle never meets the scan plane: it stays 8.0 mm"],
            needle(0.0, 0.2),
        ),
        (
            needle(200.0, 0.0),
            &["the needle never meets the scan plane"],
            needle(20.0, 0.0),
        ),
    ] {
        let told = warnings(&doubted);
        let has = |warning: &String| words.iter().all(|word| warning.contains(word));
        assert_eq!(
            told.iter().filter(|warning| has(warning)).count(),
            1,
            "{doubted}: {told:?}"
        );
        let near_by = warnings(&near);
        let same = |warning: &String| warning.contains(words[0].split([':', '=']).next().unwrap_or_default());
        assert!(!near_by.iter().any(same), "{near}: {near_by:?}");
    }
}

#[test]
fn the_usual_probe_of_each_kind_is_not_doubted() {
    const PLAIN: &str = "[effects]\ntexture = false";
    for kind in ["linear", "curvilinear", "phased"] {
        let told = all_warnings(&format!("[probe]\nkind = \"{kind}\"\n{PLAIN}"));
        let is_of_probe = |warning: &&String| warning.contains("kernel") || warning.contains("in cm?");
        assert_eq!(told.iter().find(is_of_probe), None, "{kind}");
    }
    // One that is given by its three keys alone.
    let alone = format!("[probe]\nkind = \"phased\"\nangle_deg = 90\ndepth_mm = 160\n{PLAIN}");
    let told = all_warnings(&alone);
    assert!(!told.iter().any(|warning| warning.contains("kernel")), "{told:?}");
    let wide = all_warnings(&format!("{alone}\n[effects.speckle]\nlateral_mm = 12"));
    assert!(
        wide.iter().any(|warning| warning.contains("speckle.lateral_mm")),
        "{wide:?}"
    );
}

#[test]
fn a_scene_is_blind_only_if_no_frame_shows_the_volume() {
    let motion = |x: [f64; 2]| {
        let key = |time, x| {
            format!("[[motion.keyframes]]\ntime_s = {time}\nposition_mm = [{x}, -120, 0]\ndirection = [0, 1, 0]\n")
        };
        resolve(&small(&format!(
            "[motion]\nframes = 21\n{}{}",
            key(0.0, x[0]),
            key(1.0, x[1])
        )))
        .expect("a scene")
    };
    let blind = motion([3000.0, 4000.0]);
    assert!(
        blind.blind().is_some_and(|reason| reason.contains("2 of 2 poses")),
        "{:?}",
        blind.warnings
    );
    // Both ends lie beside the body, and the way between them crosses it.
    let across = motion([-3000.0, 3000.0]);
    assert_eq!(across.blind(), None);
    assert_eq!(motion([0.0, 4000.0]).blind(), None);
    // In a corner of the volume, away from the body and towards it.
    let in_corner = |direction: &str| {
        let pose = format!("[pose]\nposition_mm = [-110, -95, 0]\ndirection = {direction}\n");
        resolve(&small(&pose)).expect("a scene")
    };
    let away = in_corner("[-1, -1, 0]");
    assert!(
        away.blind()
            .is_some_and(|reason| reason.contains("only air lies before it")),
        "{:?}",
        away.warnings
    );
    assert_eq!(in_corner("[0.5, 1, 0]").blind(), None);
}

#[test]
fn an_open_depth_holds_the_target_and_a_stated_one_is_told_to_cut_it_off() {
    let Some(path) = data("volumes/tsd_s0328_labels.nii.gz") else {
        return;
    };
    let over = |probe: &str| -> Scene {
        let text = format!(
            "version = 2\n{probe}\n[volume]\nfile = '{}'\n[pose]\ntarget = \"liver\"\nplane = \"transverse\"\n",
            path.display()
        );
        let mut file = parse(&text).expect("a file");
        shrink(&mut file);
        without_textures(&mut file);
        file.resolve("".as_ref()).expect("a scene")
    };
    let open = over("");
    let told = |scene: &Scene, words: &str| scene.notes.iter().any(|note| note.contains(words));
    assert!(told(&open, "so that it holds liver"), "{:?}", open.notes);
    assert!(open.settings.probe.depth_mm > 150.0 && open.settings.probe.depth_mm <= 240.0);
    let stated = over("probe = { depth_mm = 150 }");
    assert_eq!(stated.settings.probe.depth_mm, 150.0);
    assert!(
        told(&stated, "liver is cut off by the lower edge"),
        "{:?}",
        stated.notes
    );
    let deep = over("probe = { depth_mm = 220 }");
    assert!(!told(&deep, "cut off"), "{:?}", deep.notes);
}
