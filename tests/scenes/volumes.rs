//! Volumes, tissues, textures and the place of the probe.

use std::path::Path;

use insonify_anatomy::volume::complete::Unlabelled;
use insonify_imaging::scene::SceneFile;
use nalgebra::Point3;

use super::support::{data, fault, labelled, render, resolve, shrink, small, synthesizer, without_textures};

#[test]
fn a_label_file_alone_is_a_scene() {
    let Some(path) = data("volumes/ts_example_seg_full.nii.gz") else {
        return;
    };
    let mut file = SceneFile::for_labels(&path);
    shrink(&mut file);
    without_textures(&mut file);
    let scene = file.resolve(Path::new("")).expect("scene");
    let notes = scene.notes.join("\n");
    assert!(
        notes.contains("placed over liver") && notes.contains("filled"),
        "{notes}"
    );
    let frame = render(&scene, &mut synthesizer(&scene), 0, 1);
    assert!(frame.pixels.iter().filter(|&&grey| grey > 60).count() > frame.pixels.len() / 10);
    // Placed elsewhere, the body is the same and the probe is not.
    let mut elsewhere = file.clone();
    elsewhere.pose.get_or_insert_default().target = Some("kidney".into());
    let kidney = elsewhere.resolve(Path::new("")).expect("scene");
    assert!(
        kidney.notes.join("\n").contains("placed over kidney"),
        "{:?}",
        kidney.notes
    );
    assert_ne!(kidney.probe_pose(0, 1), scene.probe_pose(0, 1));
}

#[test]
fn a_body_without_air_around_it_still_makes_a_picture() {
    let Some(path) = data("volumes/ts_example_seg_full.nii.gz") else {
        return;
    };
    let mut file = SceneFile::for_labels(&path);
    shrink(&mut file);
    without_textures(&mut file);
    file.volume.as_mut().expect("volume").unlabelled = Some(Unlabelled::Tissue);
    let scene = file.resolve(Path::new("")).expect("scene");
    assert!(
        scene.warnings.join("\n").contains("front of the volume"),
        "{:?}",
        scene.warnings
    );
    let frame = render(&scene, &mut synthesizer(&scene), 0, 1);
    assert!(frame.pixels.iter().any(|&grey| grey > 60));
}

#[test]
fn a_target_is_found_by_name_part_and_value() {
    let over = |target: &str| resolve(&small(&format!("[pose]\ntarget = \"{target}\""))).expect(target);
    for (target, name) in [
        ("liver", "liver"),
        ("Kidney", "kidney_cortex"),
        ("wall gallbladder", "gallbladder_wall"),
        ("11", "liver"),
        ("gallbladder", "gallbladder_wall"),
    ] {
        let scene = over(target);
        assert!(
            scene.notes.join("\n").contains(&format!("placed over {name}:")),
            "{target}: {:?}",
            scene.notes
        );
    }
    let sagittal = resolve(&small("[pose]\nplane = \"sagittal\"")).expect("scene");
    assert!(sagittal.probe_pose(0, 1).lateral().z < -0.7);
    assert!(sagittal.notes.join("\n").contains("placed over liver"));
}

/// A short vein of the file is a vein before the many that are drawn into the liver, of which a portal vein and a vena
/// cava are the roots.
#[test]
fn a_target_is_a_label_of_the_file_before_a_drawn_one() {
    let names = ["liver", "portal_vein_and_splenic_vein", "inferior_vena_cava"];
    let file = labelled([160.0, 140.0, 140.0], 2.0, &names, |p| match p {
        _ if (p.y - 20.0).hypot(p.x) < 5.0 && p.z < -40.0 => 2,
        _ if (p.y - 45.0).hypot(p.x) < 10.0 => 3,
        _ if (p.x / 70.0).powi(2) + (p.y / 60.0).powi(2) + (p.z / 60.0).powi(2) < 1.0 => 1,
        _ => 0,
    });
    let scene = resolve(&file.scene("[pose]\ntarget = \"vein\"\n")).expect("scene");
    let volume = &scene.anatomy.volume;
    let voxels = |name: &str| {
        let is_named = |label: &&u8| volume.labels()[usize::from(**label)].name.as_deref() == Some(name);
        volume.voxels().iter().filter(is_named).count()
    };
    let (of_file, drawn) = (voxels(names[1]), voxels("hepatic_vein"));
    assert!(of_file > 0 && drawn > of_file, "{of_file} voxels, {drawn} drawn");
    let notes = scene.notes.join("\n");
    assert!(notes.contains("placed over portal_vein"), "{notes}");
}

/// The skin that closes a body around labels is that of no patient: where the probe is placed on it, other than from
/// the front, this is told; not where the file has the skin.
#[test]
fn a_place_on_invented_skin_is_told() {
    let placed = |names: [&str; 3]| {
        let file = labelled([160.0, 160.0, 120.0], 4.0, &names, |p: Point3<f64>| match p {
            _ if p.x.abs() < 30.0 && p.y.abs() < 30.0 && p.z.abs() < 30.0 => 1,
            _ if p.x.abs() < 50.0 && (-50.0..-40.0).contains(&p.y) => 2,
            _ if p.x.abs() < 70.0 && p.y.abs() < 70.0 => 3,
            _ => 0,
        });
        let notes = resolve(&file.scene("[pose]\ntarget = \"liver\"\n"))
            .expect("scene")
            .notes;
        notes.join("\n")
    };
    let told = "the skin there is invented: check the position with --overview";
    for (names, is_told) in [(["liver", "sternum", ""], true), (["liver", "sternum", "skin"], false)] {
        let notes = placed(names);
        assert!(
            notes.contains("placed over liver") && !notes.contains("from the front"),
            "{notes}"
        );
        assert_eq!(notes.contains(told), is_told, "{notes}");
    }
}

#[test]
fn turns_apply_to_the_default_pose() {
    let still = resolve(&small("")).expect("scene").probe_pose(0, 1);
    let turned = resolve(&small("[pose]\nrotate_deg = 20"))
        .expect("scene")
        .probe_pose(0, 1);
    assert!((still.position_mm() - turned.position_mm()).norm() < 1e-9);
    assert!((still.axial().into_inner() - turned.axial().into_inner()).norm() < 1e-9);
    assert!((still.lateral().angle(&turned.lateral()).to_degrees() - 20.0).abs() < 1e-6);
}

#[test]
fn tissues_of_the_scene_override_the_built_in_ones() {
    let scene = resolve(&small(
        "[[tissue]]\nname = \"liver\"\nechogenicity_db = 7\n[[tissue]]\nname = \"odd\"\nlabels = [99]",
    ))
    .expect("scene");
    let liver = scene
        .anatomy
        .tissues
        .tissues
        .iter()
        .find(|tissue| tissue.name == "liver")
        .expect("liver");
    assert_eq!(liver.echogenicity_db, 7.0);
    assert!(
        scene.warnings.iter().any(|warning| warning.contains("99")),
        "{:?}",
        scene.warnings
    );
    let error = fault(&small("[[tissue]]\nname = \"a\"\n[[tissue]]\nname = \"a\""));
    assert_eq!(error.key(), Some("tissue[1].name"));
}

#[test]
fn textures_come_from_files() {
    let folder = tempfile::tempdir().expect("folder");
    let mut nrrd = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nspacings: 1 1 1\nencoding: raw\n\n".to_vec();
    nrrd.extend((0..64u8).map(|value| value * 3 + 1));
    std::fs::write(folder.path().join("t.nrrd"), nrrd).expect("file");
    let text = |more: &str| {
        small(&format!(
            "[[texture]]\nname = \"mine\"\nfile = \"t.nrrd\"\n{more}\n[[tissue]]\nname = \"liver\"\ntexture = \"mine\"\n"
        ))
    };
    let resolve = |text: &str| SceneFile::parse(text, "t.toml").and_then(|file| file.resolve(folder.path()));
    let scene = resolve(&text("spacing_mm = [0.5, 0.5, 0.5]\nseam = \"mirror\"")).expect("scene");
    let texture = &scene.anatomy.textures["mine"];
    assert_eq!((texture.size(), texture.spacing_mm()), ([8; 3], [0.5; 3]));
    for (more, key) in [
        ("spacing_mm = [0, 1, 1]", "texture[0].spacing_mm"),
        ("values = { log = { db_per_unit = 99 } }", "texture[0].values"),
        ("seam = { cross_fade = { share = 0.9 } }", "texture[0].seam"),
    ] {
        let error = resolve(&text(more)).map(drop).expect_err(more);
        assert_eq!(error.key(), Some(key), "{error}");
        assert!(error.location().is_some());
    }
}

#[test]
fn a_probe_outside_the_volume_is_warned_of() {
    let scene = resolve(&small("[pose]\nposition_mm = [5000, 0, 0]\ndirection = [1, 0, 0]")).expect("scene");
    assert!(
        scene.warnings.join("\n").contains("sees nothing of the volume"),
        "{:?}",
        scene.warnings
    );
    let inside = resolve(&small("")).expect("scene");
    assert!(inside.warnings.is_empty(), "{:?}", inside.warnings);
}

/// Without a volume, a scene shows the usual one, changed as it says.
#[test]
fn a_volume_that_is_not_named_is_the_usual_one() {
    let told = |text: &str| {
        let scene = resolve(text).unwrap_or_else(|error| panic!("{error}"));
        let notes = scene
            .notes
            .iter()
            .filter(|note| note.contains("names no volume"))
            .count();
        (scene.anatomy.volume, notes)
    };
    let (stated, notes) = told("volume = { phantom = \"abdomen\", resolution_mm = 4, seed = 3 }");
    assert_eq!(notes, 0);
    let (open, notes) = told("volume = { resolution_mm = 4, seed = 3 }");
    assert_eq!(notes, 1);
    assert!(open.voxels() == stated.voxels() && open.index_to_world() == stated.index_to_world());
    let (other, _) = told("volume = { resolution_mm = 4 }");
    assert!(other.voxels() != stated.voxels());
    let error = resolve("volume = { ct = \"ct.nii.gz\" }")
        .map(drop)
        .expect_err("no labels");
    assert!(error.to_string().contains("neither `phantom` nor `file`"), "{error}");
}

/// A probe of which half the array hangs in the air is told.
#[test]
fn an_array_in_the_air_is_told() {
    let at = |x: f64| {
        let text = format!(
            "version = 1\n[volume]\nphantom = \"two-layer\"\nresolution_mm = 4\n[probe]\nkind = \"linear\"\nwidth_mm = 40\ndepth_mm = 50\n\
             [pose]\nposition_mm = [{x}, 0, 45]\ndirection = [0, 0, -1]\nlateral = [1, 0, 0]\n"
        );
        resolve(&text).expect("a scene").warnings
    };
    let warns = |warnings: &[String]| {
        warnings
            .iter()
            .any(|it| it.contains("no body within 12 mm (at the worst pose) and is dark: move"))
    };
    assert!(!warns(&at(0.0)), "{:?}", at(0.0));
    assert!(warns(&at(60.0)), "{:?}", at(60.0));
}
