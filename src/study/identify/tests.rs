//! Parameters that made an insertion return from its force and displacements.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::Point3;

use super::{Identification, Identified, identify};
use crate::input::identification::CaseFile;
use crate::input::scenario::ScenarioFile;
use crate::input::scenario::run::{Deformed, Moment, Observer, Requests, Step, run};
use crate::mechanics::insertion::StepError;

/// The two-layer phantom in a coarse mesh.
const PHANTOM: &str = r#"version = 1
[run]
dt_ms = 100
[scene.volume]
phantom = "two-layer"
resolution_mm = 3
[scene.image]
width = 24
height = 16
[tissue]
nodes = 300
[[tissue.fix]]
box_mm = [[-inf, -inf, 44], [inf, inf, inf]]
[[tissue.fix]]
box_mm = [[-inf, -inf, -inf], [inf, -39, inf]]
[[tissue.material]]
region = "phantom_top"
young_kpa = 10.0
poisson = 0.49
cutting_n = 0.0
friction_n_per_mm = 0.015
peak = { density_n_per_mm = 0.06, width_mm = 6.0 }
[[tissue.material]]
region = "phantom_inclusion"
young_kpa = 33.0
poisson = 0.49
cutting_n = 0.0
friction_n_per_mm = 0.03
peak = { density_n_per_mm = 0.11, width_mm = 8.0 }
[needle]
[[needle.motion.keyframes]]
time_s = 0
tip_mm = [0, 5, -47]
direction = [0, 0, 1]
[[needle.motion.keyframes]]
time_s = 36
tip_mm = [0, 5, 7]
direction = [0, 0, 1]
[[needle.motion.keyframes]]
time_s = 40
tip_mm = [0, 5, 1]
direction = [0, 0, 1]
"#;

/// Writes the force of every step and the displacements of nodes at intervals, as a user's tables.
struct Recorder {
    force: String,
    motion: String,
    depth: f64,
}

impl Observer for Recorder {
    type Error = StepError;

    fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
        let tip = step.base * Point3::new(0.0, 0.0, 150.0);
        self.depth = tip.z + 45.0;
        writeln!(self.force, "{},{}", self.depth, -step.outcome.on_hand.force_n.z).unwrap();
        Ok(())
    }

    fn frame(&mut self, _: &Moment<'_>) -> Result<(), StepError> {
        Ok(())
    }

    fn mesh(&mut self, deformed: &Deformed<'_>) -> Result<(), StepError> {
        let nodes = deformed.tissue.reference.iter().zip(&deformed.tissue.current);
        // In the image plane, 5 mm beside the needle; nodes there are not moved to the needle.
        for (rest, now) in nodes.filter(|(rest, _)| rest[1].abs() < 4.0 && rest[0].abs() > 3.0) {
            let [x, y, z] = rest;
            writeln!(self.motion, "{},{x},{y},{z},{}", self.depth, now[2] - z).unwrap();
        }
        Ok(())
    }
}

fn write(folder: &Path, scenario: &str) {
    let scenario = ScenarioFile::parse(scenario, "phantom.toml")
        .unwrap()
        .resolve(folder, |_| {})
        .unwrap();
    let mut model = scenario.model(|_, _| {}).unwrap();
    let mut recorder = Recorder {
        force: "tip_mm,force_n\n".to_owned(),
        motion: "tip_mm,x_mm,y_mm,z_mm,uz_mm\n".to_owned(),
        depth: 0.0,
    };
    let asked = Requests {
        frames: false,
        mesh_s: Some(2.0),
    };
    run(&scenario, model.as_mut(), asked, &mut recorder).unwrap();
    std::fs::write(folder.join("force.csv"), recorder.force).unwrap();
    std::fs::write(folder.join("u.csv"), recorder.motion).unwrap();
}

/// Identifies a case in a folder with the phantom's scenario.
fn found(folder: &Path, scenario: &str, more: &str) -> Identification {
    std::fs::write(folder.join("phantom.toml"), scenario).unwrap();
    let text = format!("scenario = \"phantom.toml\"\nforce.file = \"force.csv\"\n{more}");
    let case = CaseFile::parse(&text, "case.toml")
        .unwrap()
        .resolve(folder, |_| {})
        .unwrap();
    identify(case, |_| {}).unwrap()
}

/// Asserts that the forces returned within 2 %.
fn assert_forces(found: &Identified) {
    for (layer, [peak, shaft, width]) in found.layers.iter().zip([[0.06, 0.015, 6.0], [0.11, 0.03, 8.0]]) {
        for (found, exact) in [
            (layer.peak_n_per_mm, peak),
            (layer.shaft_n_per_mm, shaft),
            (layer.width_mm, width),
        ] {
            assert!((found / exact - 1.0).abs() < 0.02, "{layer:?}");
        }
    }
}

#[test]
fn parameters_that_made_the_data_return() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), PHANTOM);
    let known = "[[layer]]\nregion = \"top\"\nknown = true\n[[layer]]\nregion = \"inclusion\"\nknown = true\n";
    let inner = found(folder.path(), PHANTOM, known);
    assert_forces(&inner.found[0]);
    assert!(inner.found[0].motion.is_none() && inner.found[0].force.rms_n < 0.01);
    let start = "motion.file = \"u.csv\"\n[[layer]]\nregion = \"top\"\nyoung_kpa = 14\n[[layer]]\nregion = \"inclusion\"\nyoung_kpa = 22\n";
    let outer = found(folder.path(), PHANTOM, start);
    let one = &outer.found[0];
    assert_forces(one);
    for (layer, exact) in one.layers.iter().zip([10.0, 33.0]) {
        assert!((layer.young_kpa / exact - 1.0).abs() < 0.05, "{layer:?}");
    }
    assert!(
        one.beside.len() == 4 && one.beside.iter().all(|beside| beside.cost_ratio > 1.0),
        "{:?}",
        one.beside
    );
    assert!(one.notes.is_empty(), "{:?}", one.notes);
    // The scenario with what was found is one that can be read and has these numbers.
    let (_, text) = &outer.scenarios()[0];
    let again = ScenarioFile::parse(text, "found.toml")
        .unwrap()
        .resolve(folder.path(), |_| {})
        .unwrap();
    let inclusion = again.anatomy.region(&Point3::new(0.0, 5.0, 0.0)).unwrap();
    let at = again
        .mesh
        .regions()
        .iter()
        .position(|region| *region == inclusion)
        .unwrap();
    assert_eq!(again.materials[at].young_kpa(), one.layers[1].young_kpa);
    let interaction = again.anatomy.interaction(inclusion);
    assert_eq!(interaction.friction_n_per_mm, one.layers[1].shaft_n_per_mm);
    assert_eq!(interaction.peak.unwrap().width_mm, one.layers[1].width_mm);
}
