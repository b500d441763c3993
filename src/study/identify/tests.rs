//! Parameters that made an insertion return from its force and displacements.

use std::fmt::Write as _;
use std::ops::ControlFlow;
use std::path::Path;

use nalgebra::{Point3, Vector3};

use super::data::{MeasuredMotion, Measurements};
use super::simulate::Simulator;
use super::{Identification, Identified, identify, identify_simulated, simulated_layers};
use crate::identification::{CaseFile, IdentificationCase};
use insonify::input::scenario::ScenarioFile;
use insonify::run::{Deformed, Observer, Requests, Step, run};
use insonify_mechanics::insertion::StepError;

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

const KNOWN_LAYERS: &str =
    "[[layer]]\nregion = \"top\"\nknown = true\n[[layer]]\nregion = \"inclusion\"\nknown = true\n";

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

    fn mesh(&mut self, deformed: &Deformed<'_>) -> Result<(), StepError> {
        let nodes = deformed.tissue.reference.iter().zip(&deformed.tissue.current);
        // In the image plane, 5 mm beside the needle; nodes there are not moved to the needle.
        for (rest_mm, moved_mm) in nodes.filter(|(rest_mm, _)| rest_mm[1].abs() < 4.0 && rest_mm[0].abs() > 3.0) {
            let [x, y, z] = rest_mm;
            writeln!(self.motion, "{},{x},{y},{z},{}", self.depth, moved_mm[2] - z).unwrap();
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
    let requests = Requests {
        frames: false,
        mesh_s: Some(2.0),
    };
    run(&scenario, model.as_mut(), requests, &mut recorder).unwrap();
    std::fs::write(folder.join("force.csv"), recorder.force).unwrap();
    std::fs::write(folder.join("u.csv"), recorder.motion).unwrap();
}

/// A case in a folder with the phantom's scenario.
fn case(folder: &Path, scenario: &str, extra: &str) -> IdentificationCase {
    std::fs::write(folder.join("phantom.toml"), scenario).unwrap();
    let text = format!("scenario = \"phantom.toml\"\nforce.file = \"force.csv\"\n{extra}");
    CaseFile::parse(&text, "case.toml")
        .unwrap()
        .resolve(folder, &mut |_| {})
        .unwrap()
}

/// Identifies it.
fn identified_case(folder: &Path, scenario: &str, extra: &str) -> Identification {
    identify(case(folder, scenario, extra), &|_| ControlFlow::Continue(())).unwrap()
}

/// Asserts that the forces returned within 2 %.
fn assert_forces(identified: &Identified) {
    for (layer, [peak, shaft, width]) in identified.layers.iter().zip([[0.06, 0.015, 6.0], [0.11, 0.03, 8.0]]) {
        for (value, exact) in [
            (layer.peak_n_per_mm, peak),
            (layer.shaft_n_per_mm, shaft),
            (layer.width_mm, width),
        ] {
            assert!((value / exact - 1.0).abs() < 0.02, "{layer:?}");
        }
    }
}

#[test]
fn parameters_that_made_the_data_return() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), PHANTOM);
    let identified = identified_case(folder.path(), PHANTOM, KNOWN_LAYERS);
    assert_forces(&identified.results[0]);
    assert!(identified.results[0].motion.is_none() && identified.results[0].force.rms_n < 0.01);
    let start = "motion.file = \"u.csv\"\n[[layer]]\nregion = \"top\"\nknown = true\n[[layer]]\nregion = \"inclusion\"\nyoung_kpa = 22\n";
    let found_case = identified_case(folder.path(), PHANTOM, start);
    let result = &found_case.results[0];
    assert_forces(result);
    for (layer, exact) in result.layers.iter().zip([10.0, 33.0]) {
        assert!((layer.young_kpa / exact - 1.0).abs() < 0.05, "{layer:?}");
    }
    assert!(
        result.beside.len() == 2 && result.beside.iter().all(|sensitivity| sensitivity.cost_ratio > 1.0),
        "{:?}",
        result.beside
    );
    assert!(result.notes.is_empty(), "{:?}", result.notes);
    // The scenario with what was found is one that can be read and has these numbers.
    let (_, text) = &found_case.scenarios()[0];
    let reread = ScenarioFile::parse(text, "found.toml")
        .unwrap()
        .resolve(folder.path(), |_| {})
        .unwrap();
    let inclusion = reread.anatomy.region(&Point3::new(0.0, 5.0, 0.0)).unwrap();
    let material = reread.linear_material(inclusion).unwrap();
    assert_eq!(material.young_kpa(), result.layers[1].young_kpa);
    let interaction = reread.anatomy.interaction(inclusion);
    assert_eq!(interaction.friction_n_per_mm, result.layers[1].shaft_n_per_mm);
    assert_eq!(interaction.peak.unwrap().width_mm, result.layers[1].width_mm);
}

#[test]
fn measurements_that_cannot_be_used_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let input = |name: &str| folder.path().join(name);
    std::fs::write(input("phantom.toml"), PHANTOM).unwrap();
    let text = "scenario = \"phantom.toml\"\nforce.file = \"force.csv\"\nmotion.file = \"u.csv\"\nmotion.frames = \"frames.csv\"\n";
    let case = CaseFile::parse(text, "case.toml")
        .unwrap()
        .resolve(folder.path(), &mut |_| {})
        .unwrap();
    let force = |force: &dyn Fn(f64) -> Option<f64>| {
        let rows = (0..=500).filter_map(|step| Some((0.1 * f64::from(step), force(0.1 * f64::from(step))?)));
        rows.fold("tip_mm,force_n\n".to_owned(), |text, (tip, force)| {
            format!("{text}{tip},{force}\n")
        })
    };
    let steps = |depth: f64| 0.06 * depth.min(6.0) + 0.015 * depth + 0.07 * (depth - 21.0).clamp(0.0, 8.0);
    let motion = "frame,line,window,depth_mm,axial_um\n0,0,0,20,0\n1,0,0,20,5\n2,0,0,20,9\n";
    let frames = "frame,tip_mm\n0,-1\n1,20\n2,40\n";
    let monotone = force(&|depth| Some(steps(depth)));
    for (forces, motion, frames, expected) in [
        (
            force(&|depth| (!(10.0..14.0).contains(&depth)).then(|| steps(depth))),
            motion,
            frames,
            "no force between 9.90 and 14.00 mm",
        ),
        (
            force(&|depth| (depth < 18.0).then(|| steps(depth))),
            motion,
            frames,
            "phantom_inclusion on the needle's line begins at 21.1 mm",
        ),
        (
            force(&|depth| Some(-steps(depth))),
            motion,
            frames,
            "a force that is not positive at the deepest point",
        ),
        (
            force(&|depth| Some(0.02 * depth)),
            motion,
            frames,
            "a force of fewer than 4 regions",
        ),
        (
            force(&|depth| Some(steps(depth) - 0.02 * (depth - 6.0).max(0.0))),
            motion,
            frames,
            "does not rise in region 2",
        ),
        (
            "tip,force\n1,2\n".to_owned(),
            motion,
            frames,
            "found other columns; expected tip_mm,force_n",
        ),
        (
            monotone.clone(),
            "frame,line\n0,0\n",
            frames,
            "found other columns; expected a table of `insonify motion`",
        ),
        (
            monotone.clone(),
            motion,
            "frame,tip_mm\n0,2\n1,20\n2,40\n",
            "found the needle 2.0 mm deep in the first frame",
        ),
        (
            monotone.clone(),
            motion,
            "frame,tip_mm\n0,-1\n1,20\n",
            "a frame whose depth of the needle is known",
        ),
        (
            monotone.clone(),
            "frame,line,window,depth_mm,axial_um\n0,9999,0,20,0\n",
            frames,
            "lines, those of the scenario's probe",
        ),
    ] {
        std::fs::write(input("force.csv"), forces).unwrap();
        std::fs::write(input("u.csv"), motion).unwrap();
        std::fs::write(input("frames.csv"), frames).unwrap();
        let error = Measurements::read(&case)
            .and_then(|data| data.model(&case))
            .unwrap_err()
            .to_string();
        assert!(
            error.contains(expected) && error.contains(".csv"),
            "{error}\nexpected {expected}"
        );
    }
    let unknown = |text: &str| {
        CaseFile::parse(text, "case.toml")
            .and_then(|file| file.resolve(folder.path(), &mut |_| {}))
            .unwrap_err()
            .to_string()
    };
    let head = "scenario = \"phantom.toml\"\nforce.file = \"force.csv\"\n";
    for (lines, expected) in [
        ("", "no displacements"),
        ("motion.file = \"u.csv\"\npoisson = [0.5]\n", "0 to below 0.5"),
        (
            "motion.file = \"u.csv\"\nweights = [1, 2]\n",
            "4, two for each of 2 layers",
        ),
        (
            "motion.file = \"u.csv\"\n[[layer]]\nregion = \"liver\"\n",
            "no region \"liver\"",
        ),
        (
            "motion.file = \"u.csv\"\n[[layer]]\nregion = \"top\"\nyoung_kpa = -1\n",
            "above 0",
        ),
    ] {
        let error = unknown(&format!("{head}{lines}"));
        assert!(error.contains(expected), "{error}\nexpected {expected}");
    }
    assert!(unknown(&head.replace("phantom.toml", "two-layer-insertio")).contains("two-layer-insertion"));
}

/// A load cell that reads 50 mN at rest and 0.3 N more when the needle is out again: the curve is that without either.
#[test]
fn a_drift_of_the_load_cell_is_taken_off() {
    let folder = tempfile::tempdir().unwrap();
    let depth = |row: i32| 40.0 - 0.25 * f64::from((row - 200).abs());
    let rows = |reads: &dyn Fn(f64) -> f64| {
        let lines = (0..=400).map(|row| {
            let force = 0.03 * depth(row).max(0.0);
            format!("{},{}\n", depth(row), force + reads(f64::from(row) / 400.0))
        });
        std::fs::write(
            folder.path().join("force.csv"),
            "tip_mm,force_n\n".to_owned() + &lines.collect::<String>(),
        )
        .unwrap();
        Measurements::read(&case(folder.path(), PHANTOM, KNOWN_LAYERS)).unwrap()
    };
    let (exact, measured) = (rows(&|_| 0.0), rows(&|share| 0.05 + 0.3 * share));
    // The rows in the mean before the tissue are 20 after the first, so are those at the end.
    assert!(
        (measured.offset_n.unwrap() - 0.065).abs() < 0.002,
        "{:?}",
        measured.offset_n
    );
    assert!(
        (measured.drift_n.unwrap() - 0.27).abs() < 0.004,
        "{:?}",
        measured.drift_n
    );
    for (exact, measured) in exact.force.iter().zip(&measured.force) {
        assert!((exact[1] - measured[1]).abs() < 1e-9, "{exact:?} {measured:?}");
    }
}

/// A load cell that reads 50 mN at rest, with 20 mN of noise: the offset is taken off and told, and parameters return;
/// without the rows before the tissue, its absence is told.
#[test]
fn an_offset_of_the_load_cell_is_taken_off() {
    const OFFSET_N: f64 = 0.05;
    let folder = tempfile::tempdir().unwrap();
    let scenario = &PHANTOM.replace("dt_ms = 100", "dt_ms = 50");
    write(folder.path(), scenario);
    let path = folder.path().join("force.csv");
    let exact = std::fs::read_to_string(&path).unwrap();
    let seed = insonify_base::random::seed_words(5);
    let measured: String = exact
        .lines()
        .enumerate()
        .map(|(row, line)| match line.split_once(',') {
            Some((depth, force)) if row > 0 => {
                let noise = 0.02 * insonify_base::random::normal([row as i32, 0, 0], seed);
                format!("{depth},{}\n", force.parse::<f64>().unwrap() + OFFSET_N + noise)
            }
            _ => format!("{line}\n"),
        })
        .collect();
    std::fs::write(&path, &measured).unwrap();
    let identified = identified_case(folder.path(), scenario, KNOWN_LAYERS);
    let offset_n = identified.offset_n.unwrap();
    assert!((offset_n - OFFSET_N).abs() < 0.01, "{offset_n}");
    let result = &identified.results[0];
    assert!(
        result.notes[0].contains("this offset was taken off"),
        "{:?}",
        result.notes
    );
    for (layer, [peak, shaft, width]) in result.layers.iter().zip([[0.06, 0.015, 6.0], [0.11, 0.03, 8.0]]) {
        let off = |value: f64, exact: f64| (value / exact - 1.0).abs();
        assert!(off(layer.width_mm, width) < 0.1, "{layer:?}");
        assert!(
            off(layer.peak_n_per_mm, peak) < 0.15 && off(layer.shaft_n_per_mm, shaft) < 0.15,
            "{layer:?}"
        );
    }
    let in_tissue: Vec<&str> = measured.lines().filter(|line| !line.starts_with('-')).collect();
    std::fs::write(&path, in_tissue.join("\n")).unwrap();
    let unknown = identified_case(folder.path(), scenario, KNOWN_LAYERS);
    assert_eq!(unknown.offset_n, None);
    let notes = &unknown.results[0].notes;
    assert!(
        notes
            .iter()
            .any(|note| note.contains("an offset of the load cell is not known")),
        "{notes:?}"
    );
}

/// A case of the phantom with a share of its force densities, and starts of the moduli.
fn case_of(folder: &Path, share: f64, law: &str, moduli_kpa: [f64; 2]) -> crate::identification::IdentificationCase {
    let mut scenario = PHANTOM.to_owned();
    for density in [0.06, 0.11, 0.015, 0.03] {
        let scaled = format!("n_per_mm = {}", density * share);
        scenario = scenario.replace(&format!("n_per_mm = {density}\n"), &format!("{scaled}\n"));
        scenario = scenario.replace(&format!("n_per_mm = {density},"), &format!("{scaled},"));
    }
    std::fs::write(folder.join("scaled.toml"), scenario).unwrap();
    let layer = |region: &str, young_kpa: f64| format!("[[layer]]\nregion = \"{region}\"\nyoung_kpa = {young_kpa}\n");
    let [top, inclusion] = moduli_kpa;
    let text = format!(
        "scenario = \"scaled.toml\"\nforce.file = \"force.csv\"\nmotion.file = \"u.csv\"\n{law}{}{}",
        layer("top", top),
        layer("inclusion", inclusion)
    );
    let case = CaseFile::parse(&text, "case.toml").unwrap();
    case.resolve(folder, &mut |_| {}).unwrap()
}

/// Points of the image plane, 5 mm beside the needle, with the direction along it.
fn points() -> Vec<(Point3<f64>, Vector3<f64>)> {
    let steps = (-2..=2).flat_map(|x| (-8..=1).map(move |z| [5.0 * f64::from(x), 5.0 * f64::from(z)]));
    let points = steps.filter(|[x, _]| x.abs() > 3.0);
    points.map(|[x, z]| (Point3::new(x, 0.0, z), Vector3::z())).collect()
}

const NEO_HOOKEAN: &str = "law.kind = \"neo-hookean\"\n";

/// Displacements of tissue of a law over those of linear tissue, at the last depth: the largest relative difference.
#[test]
fn under_small_forces_tissue_of_a_law_moves_as_linear_tissue() {
    let folder = tempfile::tempdir().unwrap();
    let differences = [1e-3, 1.0].map(|share| {
        let moved = ["", NEO_HOOKEAN].map(|law| {
            let case = case_of(folder.path(), share, law, [10.0, 33.0]);
            let motion = MeasuredMotion {
                points: points(),
                depths_mm: vec![40.0],
                measured_mm: Vec::new(),
            };
            let layers = simulated_layers(&case);
            let course = Simulator::new(&case, Some(&motion), 40.0).run(&layers, true).unwrap();
            assert_eq!(course.unsettled, 0);
            course.moved_mm[0].clone()
        });
        let [linear, other] = moved;
        let largest = |values: &[f64]| values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        let apart: Vec<f64> = linear.iter().zip(&other).map(|(a, b)| a - b).collect();
        largest(&apart) / largest(&linear)
    });
    assert!(differences[0] < 1e-4 && differences[1] > 0.01, "{differences:?}");
}

#[test]
#[ignore = "half a minute: `.ci/more plans`"]
fn moduli_of_neo_hookean_tissue_return() {
    let folder = tempfile::tempdir().unwrap();
    let truth = case_of(folder.path(), 1.0, NEO_HOOKEAN, [10.0, 33.0]);
    let found = ["", NEO_HOOKEAN].map(|law| {
        let case = case_of(folder.path(), 1.0, law, [14.0, 22.0]);
        identify_simulated(&truth, &case, points()).unwrap()
    });
    let moduli = found
        .each_ref()
        .map(|found| [0, 1].map(|layer| found.layers[layer].young_kpa));
    for (young_kpa, exact) in moduli[1].into_iter().zip([10.0, 33.0]) {
        assert!((young_kpa / exact - 1.0).abs() < 0.01, "{moduli:?}");
    }
    assert_forces(&found[1]);
    // Linear tissue that moves as much is of another modulus.
    let [top, inclusion] = moduli[0];
    assert!(top > 1.008 * 10.0 && inclusion > 1.012 * 33.0, "{moduli:?}");
}
