//! Tests of needles aimed by name, and of paths past bone.

use nalgebra::Point3;

use super::{fixed, resolved};
use crate::input::scenario::{Scenario, ScenarioFile};

/// Coarse abdomen phantom, with a needle to its lesion.
const AIMED: &str = r#"version = 1
[run]
dt_ms = 50
[scene.volume]
phantom = "abdomen"
resolution_mm = 4
[scene.pose]
target = "lesion"
[scene.image]
width = 24
height = 16
[tissue]
nodes = 300
[needle]
target = "lesion"
"#;

fn keys(scenario: &Scenario) -> Vec<(f64, Point3<f64>)> {
    let keys = scenario.path.tip().keys().iter();
    keys.map(|key| (key.time_s, key.pose.position_mm())).collect()
}

#[test]
fn a_needle_enters_beside_the_probe_and_goes_to_its_target() {
    let scenario = resolved(AIMED).expect("a scenario");
    let keys = keys(&scenario);
    assert_eq!(keys.len(), 4);
    let (start, tip) = (keys[0].1, keys[1].1);
    let body = scenario.scene.body();
    let label_at = |point: &Point3<f64>| body.volume.label_index_at(point).map(|label| body.name(label));
    assert_eq!(label_at(&tip).as_deref(), Some("lesion"));
    let label = body.volume.label_index_at(&start);
    assert!(
        label.is_none_or(|label| body.is_outside(label)),
        "{:?}",
        label_at(&start)
    );
    // In the image plane, beyond the ends of the array: 60 mm of radius and 70 degrees.
    let to_probe = scenario.probe(0).inverse();
    let [start, end] = [start, tip].map(|point| to_probe * point);
    assert!(start.z.abs() < 0.1 && end.z.abs() < 0.1, "{start} {end}");
    let entry = start + (end - start).normalize() * 10.0;
    let aside = entry.x.abs() - 60.0 * 35f64.to_radians().sin();
    assert!((9.9..60.1).contains(&aside), "{aside}");
    assert_eq!(scenario.targets[0].name, "lesion");
    assert!((scenario.targets[0].at_mm - tip).norm() < 1e-9);
    assert!(!fixed(&scenario).is_empty(), "what the box cuts is fixed");
    let entry = scenario.probe(0) * entry;
    let nodes = scenario.mesh.nodes().iter().zip(0u32..);
    let near: Vec<u32> = nodes
        .filter(|(node, _)| (Point3::from(**node) - entry).norm() < 15.0)
        .map(|(_, node)| node)
        .collect();
    let fixed_nodes = near
        .iter()
        .filter(|node| fixed(&scenario).contains(&(**node, 0)))
        .count();
    assert!(
        !near.is_empty() && fixed_nodes == 0,
        "the skin at the entry is free: {fixed_nodes} of {}",
        near.len()
    );
}

/// A stated entry in the air or inside the body is moved along its line onto the skin, with a warning.
#[test]
fn a_stated_entry_is_moved_onto_the_skin() {
    let chosen = resolved(AIMED).expect("a scenario");
    let keys_of = keys(&chosen);
    let (start, tip) = (keys_of[0].1, keys_of[1].1);
    for (from_start_mm, told) in [
        (-20.0, Some("outside the skin")),
        (10.0, None),
        (35.0, Some("inside the skin")),
    ] {
        let entry = start + (tip - start).normalize() * from_start_mm;
        let stated = format!("{AIMED}entry = [{}, {}, {}]", entry.x, entry.y, entry.z);
        let scenario = resolved(&stated).expect("a scenario");
        assert!(
            (keys(&scenario)[0].1 - start).norm() < 5.0,
            "{from_start_mm}: {:?}",
            keys(&scenario)
        );
        let warned = scenario
            .warnings
            .iter()
            .find(|warning| warning.starts_with("needle.entry"));
        assert_eq!(warned.is_some(), told.is_some(), "{:?}", scenario.warnings);
        assert!(
            told.is_none_or(|words| warned.is_some_and(|warning| warning.contains(words))),
            "{warned:?}"
        );
    }
}

#[test]
fn the_lines_that_are_told_state_the_same() {
    let aimed = resolved(AIMED).expect("a scenario");
    let told = aimed
        .notes
        .iter()
        .find_map(|note| note.split_once("lines of a scenario:\n"));
    let (_, lines) = told.expect("lines");
    let written = AIMED.replace("[tissue]\nnodes = 300\n[needle]\ntarget = \"lesion\"\n", "");
    let stated = resolved(&format!(
        "{written}{}",
        lines.replace("[tissue]", "[tissue]\nnodes = 300")
    ))
    .expect(lines);
    assert_eq!(keys(&stated), keys(&aimed));
    assert_eq!(stated.mesh.nodes(), aimed.mesh.nodes());
    assert_eq!(fixed(&stated), fixed(&aimed));
}

#[test]
fn what_cannot_be_aimed_is_refused_at_its_line() {
    let far = "[needle]\nlength_mm = 30";
    for (written, replacement, line, words) in [
        (
            "[needle]\ntarget = \"lesion\"",
            "[needle]\ntarget = \"lesions\"",
            15,
            "did you mean",
        ),
        (
            "[needle]\ntarget = \"lesion\"",
            "[needle]\ntarget = \"lesion\"\nentry = \"left\"",
            16,
            "beside the probe",
        ),
        (
            "[needle]\ntarget = \"lesion\"",
            "[needle]\ntarget = \"lesion\"\nentry = [1e9, 0, 0]",
            16,
            "1e6",
        ),
        (
            "[needle]\ntarget = \"lesion\"",
            "[needle]\nentry = \"beside the probe\"\nmotion.csv = \"a.csv\"",
            15,
            "without `target`",
        ),
        (
            "[needle]\ntarget = \"lesion\"",
            "[needle]\ntarget = \"lesion\"\nmotion.csv = \"a.csv\"",
            15,
            "each moves the needle",
        ),
        (
            "[needle]\ntarget = \"lesion\"",
            "[needle]\ntarget = \"bone\"",
            15,
            "which is bone",
        ),
        ("[needle]", far, 14, "no skin beside the probe"),
        (
            "[needle]\ntarget = \"lesion\"",
            "[needle]\nlength_mm = 100",
            14,
            "a needle that does not move",
        ),
    ] {
        let text = AIMED.replacen(written, replacement, 1);
        assert_ne!(text, AIMED, "{written}");
        let error = resolved(&text).map(drop).expect_err(replacement);
        let told = format!("{error} {}", error.help().unwrap_or_default());
        assert!(told.contains(words), "{replacement}: {told}");
        assert_eq!(
            error.location().map(|(_, line)| line),
            Some(line),
            "{replacement}: {error}"
        );
    }
}

/// A path along a row of the block whose inclusion is turned into bone.
#[test]
fn bone_on_the_way_is_found_before_the_run() {
    let bony = super::BLOCK.replace(
        "[scene.image]",
        "[[scene.tissue]]\nname = \"phantom_inclusion\"\nyoung_kpa = 1.5e7\n[scene.image]",
    );
    let clear = resolved(&bony).expect("a scenario");
    let near = clear.notes.iter().find(|note| note.contains("bone"));
    println!("{near:?} {:?}", clear.warnings);
    assert!(
        near.is_some_and(|note| note.contains("phantom_inclusion")),
        "{:?}",
        clear.notes
    );
    let through = bony.replace("tip_mm = [0, 0, -30]", "tip_mm = [0, 0, 30]");
    let through_bone = resolved(&through).expect("a scenario");
    let warning = through_bone
        .warnings
        .iter()
        .find(|warning| warning.contains("meets bone (phantom_inclusion)"));
    assert!(
        warning.is_some(),
        "{:?} {:?}",
        through_bone.notes,
        through_bone.warnings
    );
}

#[test]
fn a_label_file_and_a_target_are_a_scenario() {
    let file = ScenarioFile::for_labels("nowhere.nii.gz".as_ref(), "liver");
    let error = file.resolve(".".as_ref(), |_| {}).map(drop).expect_err("no such file");
    assert!(error.to_string().contains("nowhere.nii.gz"), "{error}");
}
