//! Tests of resolved scenarios: motion, materials, mesh, probe.

use nalgebra::{Point3, Vector3};

use super::{BLOCK, fixed, resolved, with_probe};

#[test]
fn the_base_lies_behind_the_tip_and_turns_with_the_roll() {
    let scenario = resolved(BLOCK).expect("a scenario");
    let [first, last] = [0, 200].map(|step| scenario.instruments(step).base);
    let tip = Point3::new(0.0, 0.0, 100.0);
    assert!((first * tip - Point3::new(0.0, 0.0, -50.0)).norm() < 1e-9);
    assert!((last * tip - Point3::new(0.0, 0.0, -30.0)).norm() < 1e-9);
    let [side, turned] = [first, last].map(|base| base * Vector3::x());
    assert!(side.dot(&turned).abs() < 1e-9 && (side.cross(&turned).norm() - 1.0).abs() < 1e-9);
}

#[test]
fn materials_are_those_of_the_tissues_but_for_what_is_said() {
    let scenario = resolved(BLOCK).expect("a scenario");
    let interaction = |region: i32| {
        scenario
            .interactions
            .iter()
            .find(|(listed, _)| *listed == region)
            .expect("a region")
            .1
    };
    assert_eq!(
        (interaction(1).friction_n_per_mm, interaction(2).friction_n_per_mm),
        (0.02, 0.25)
    );
    // Cutting force of the inclusion is left to its tissue.
    assert_eq!(interaction(2).cutting_n, 1.5);
    assert_eq!(
        [1, 2].map(|region| scenario.linear_material(region).unwrap().young_kpa()),
        [10.0, 33.0]
    );
    assert!(!fixed(&scenario).is_empty());
    let is_in_box = fixed(&scenario)
        .iter()
        .all(|(node, _)| scenario.mesh.nodes()[*node as usize][2] >= 40.0);
    assert!(is_in_box, "only what the box holds is fixed");

    let rigid = resolved(&BLOCK.replace("friction_n_per_mm = 0.25", "rigid = true")).expect("a scenario");
    assert!(fixed(&rigid).len() > fixed(&scenario).len());
    assert!(rigid.interactions[1].1.bone.is_some(), "what is rigid stops a needle");
}

#[test]
fn a_box_crops_what_is_meshed() {
    let cropped = BLOCK.replace(
        "nodes = 250",
        "nodes = 250\nbox_mm = [[-20, -inf, -inf], [20, inf, inf]]",
    );
    let scenario = resolved(&cropped).expect("a scenario");
    let [low, high] = scenario.mesh.bounds();
    // To within half a voxel and the smoothing of the mesh.
    assert!(
        (low[0] + 20.0).abs() < 5.0 && (high[0] - 20.0).abs() < 5.0,
        "{low:?} {high:?}"
    );
}

#[test]
fn a_probe_finds_the_nodes_that_it_can_touch() {
    let text = with_probe();
    let scenario = resolved(&text.replace("nodes = 250", "nodes = 1500")).expect("a scenario");
    let contact = scenario.contact().expect("a probe");
    assert!(contact.probe.candidates.len() > 10);
    for &node in &contact.probe.candidates {
        let [x, y, z] = scenario.mesh.nodes()[node as usize];
        assert!((x.hypot(y - 26.0) - 9.0).abs() <= 3.0 + 1e-9, "{x} {y} {z}");
    }
    let thinned = text.replace("nodes = 250", "nodes = 1500") + "thinning = 3\n";
    let thinned = resolved(&thinned).expect("a scenario");
    let thinned = thinned.contact().expect("a probe");
    let (all, kept) = (&contact.probe.candidates, &thinned.probe.candidates);
    assert!(kept.iter().all(|node| all.contains(node)));
    assert!(
        (all.len() / 5..=all.len() / 2).contains(&kept.len()),
        "{} of {}",
        kept.len(),
        all.len()
    );
    let instruments = scenario.instruments(1);
    let probe = instruments.probe.expect("a probe");
    assert!((probe * Point3::origin() - Point3::new(0.0, 26.0, 50.0)).norm() < 1e-9);
    assert!((probe * Vector3::z() - Vector3::z()).norm() < 1e-9);
}

#[test]
fn the_mesh_is_finer_along_the_path_unless_the_file_says_no() {
    let fine = BLOCK.replace("nodes = 250", "nodes = 600");
    let even = fine.replace("nodes = 600", "nodes = 600\nalong_path = false");
    let [fine, even] = [&fine, &even].map(|text| resolved(text).expect("a scenario"));
    let near = |scenario: &crate::input::scenario::Scenario| {
        let nodes = scenario.mesh.nodes().iter();
        nodes
            .filter(|node| node[0].hypot(node[1]) < 12.0 && node[2] < -20.0)
            .count()
    };
    assert!(near(&fine) > 2 * near(&even), "{} and {}", near(&fine), near(&even));
    let told = |scenario: &crate::input::scenario::Scenario, words: &str| {
        let notes = scenario.notes.iter();
        notes
            .clone()
            .any(|note| note.starts_with("mesh: ") && note.contains(words))
    };
    assert!(told(&fine, ", finer along the needle's path; "), "{:?}", fine.notes);
    assert!(told(&even, "no finer along the needle's path; "), "{:?}", even.notes);
    assert!(told(&even, "within 20 mm of the path"), "{:?}", even.notes);
}
