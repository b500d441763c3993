//! Scenarios read, resolved and run with a model that only says what it is told.

use std::path::Path;

use nalgebra::{Point3, Vector3};

use super::record::Record;
use super::run::{Asked, Deformed, Moment, Observer, Step, run};
use super::{Scenario, ScenarioError, ScenarioFile, Summary};
use crate::mechanics::insertion::{
    Event, EventKind, Field, Imager, Instruments, Model, Outcome, Saved, Snapshot, StepError, Tissue, Wrench,
};
use crate::mechanics::mesh::TetMesh;
use crate::mechanics::needle::CentreLine;

/// A coarse block, held from below, with a needle that goes in 20 mm along z in 2 s.
const BLOCK: &str = r#"version = 1
[run]
dt_ms = 10
[scene.volume]
phantom = "two-layer"
resolution_mm = 5
[scene.image]
width = 24
height = 16
[tissue]
nodes = 250
[[tissue.fix]]
box_mm = [[-inf, -inf, 40], [inf, inf, inf]]
[[tissue.material]]
region = "phantom_inclusion"
friction_n_per_mm = 0.25
[needle]
length_mm = 100
deposit_s = [1.0]
[[needle.motion.keyframes]]
time_s = 0
tip_mm = [0, 0, -50]
direction = [0, 0, 1]
[[needle.motion.keyframes]]
time_s = 2
tip_mm = [0, 0, -30]
direction = [0, 0, 1]
roll_deg = 90
"#;

fn resolved(text: &str) -> Result<Scenario, ScenarioError> {
    ScenarioFile::parse(text, "block.toml")?.resolve(Path::new("."), |_| {})
}

/// Holds the tip where an unloaded needle has it, and pushes on the hand with its depth.
struct Told {
    outcome: Outcome,
    line: CentreLine,
    seeds: Vec<Point3<f64>>,
    steps: u64,
    length_mm: f64,
    mesh: TetMesh,
}

impl Told {
    fn new(scenario: &Scenario) -> Self {
        Self {
            outcome: Outcome::default(),
            line: CentreLine::default(),
            seeds: Vec::new(),
            steps: 0,
            length_mm: scenario.needle.length_mm,
            mesh: (*scenario.mesh).clone(),
        }
    }
}

impl Model for Told {
    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
        self.steps += 1;
        let base = Point3::from(instruments.base.translation.vector);
        let tip = instruments.base * Point3::new(0.0, 0.0, self.length_mm);
        self.line.set([(0.0, base), (self.length_mm, tip)]);
        // Between two steps, so that rounding decides nothing.
        let depth = (tip.z + 44.95).max(0.0);
        self.outcome = Outcome {
            on_hand: Wrench {
                force_n: Vector3::new(0.0, 0.0, -depth),
                torque_nmm: Vector3::zeros(),
            },
            // 3 N across the probe, 50 mm behind its end.
            on_probe: instruments.probe.map(|pose| Wrench {
                force_n: Vector3::new(0.0, -3.0, 0.0),
                torque_nmm: (pose.rotation * Vector3::new(0.0, 0.0, -50.0)).cross(&Vector3::new(0.0, -3.0, 0.0)),
            }),
            tip_mm: tip,
            inserted_mm: depth,
            remeshes: usize::from(depth > 0.0),
            converged: self.steps != 3,
            ..Outcome::default()
        };
        if instruments.deposit {
            self.seeds.push(tip + Vector3::new(0.5, 0.0, 0.0));
            self.outcome.events.push(Event {
                kind: EventKind::Seed,
                time_s: self.steps as f64 * dt_s,
                at_mm: tip,
                region: Some(1),
            });
        }
        Ok(&self.outcome)
    }

    fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    fn snapshot(&mut self, into: &mut Snapshot) {
        into.step = self.steps;
        into.line.clone_from(&self.line);
        into.seeds.clone_from(&self.seeds);
        into.field = Field::default();
    }

    fn imager(&self) -> Box<dyn Imager> {
        Box::new(Rest(self.mesh.clone()))
    }

    fn save(&mut self) -> Saved {
        Saved(serde_json::Value::Null)
    }

    fn restore(&mut self, _saved: &Saved) -> Result<(), StepError> {
        Ok(())
    }
}

/// Tissue at rest, of which it is said that seven elements are inverted.
struct Rest(TetMesh);

impl Imager for Rest {
    fn elements(&self) -> &[[u32; 4]] {
        self.0.elements()
    }

    fn tissue(&mut self, _snapshot: &Snapshot, into: &mut Tissue) {
        into.reference = self.0.nodes().to_vec();
        into.current = self.0.nodes().to_vec();
        into.inverted = 7;
    }
}

/// Keeps what it hears.
#[derive(Default)]
struct Heard {
    steps: Vec<(f64, f64)>,
    frames: Vec<(u64, f64, usize)>,
    meshes: Vec<f64>,
}

impl Observer for Heard {
    type Error = StepError;

    fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
        self.steps.push((step.time_s, step.outcome.tip_mm.z));
        Ok(())
    }

    fn frame(&mut self, moment: &Moment<'_>) -> Result<(), StepError> {
        let shaft = moment.state.needle.as_ref().map_or(0, |needle| needle.nodes.len());
        self.frames.push((moment.number, moment.time_s, shaft));
        Ok(())
    }

    fn mesh(&mut self, deformed: &Deformed<'_>) -> Result<(), StepError> {
        self.meshes.push(deformed.time_s);
        Ok(())
    }
}

fn heard(scenario: &Scenario, asked: Asked) -> (Heard, Summary) {
    let mut heard = Heard::default();
    let summary = run(scenario, &mut Told::new(scenario), asked, &mut heard).expect("a run");
    (heard, summary)
}

#[test]
fn a_run_steps_from_start_to_end_and_tells_of_it() {
    let scenario = resolved(BLOCK).expect("a scenario");
    assert!(scenario.scene.settings.has_needle && scenario.scene.anatomy.mesh.is_some());
    let asked = Asked {
        frames: true,
        mesh_s: Some(0.5),
    };
    let (heard, summary) = heard(&scenario, asked);
    assert_eq!((summary.steps, heard.steps.len()), (200, 200));
    assert!((summary.simulated_s - 2.0).abs() < 1e-12);
    for &(time_s, tip) in &heard.steps {
        assert!((tip - (-50.0 + 10.0 * time_s)).abs() < 1e-9, "{tip} at {time_s} s");
    }
    // 25 frames a second and the mesh twice a second, both from the first step on and at the end.
    assert_eq!((heard.frames.len(), heard.meshes.len()), (51, 5));
    assert_eq!(heard.frames[10], (10, heard.steps[39].0, 2));
    assert!((summary.max_base_force_n - 14.95).abs() < 1e-9);
    assert!((summary.max_inserted_mm - 14.95).abs() < 1e-9);
    assert_eq!(summary.not_converged, 1);
    assert_eq!(summary.max_inverted_elements, Some(7));
    assert!(
        summary
            .warnings
            .iter()
            .any(|warning| warning.starts_with("up to 7 elements"))
    );
    assert_eq!(summary.remeshes, 150);
    assert!(summary.step_ms.remesh_max.is_some() && summary.step_ms.median <= summary.step_ms.max);
    assert_eq!(summary.seeds.len(), 1);
    assert!((summary.seeds[0].time_s - 1.0).abs() < 1e-9 && summary.seeds[0].planned_mm.is_none());
    let deposited = summary.seeds[0].deposited_mm.expect("in tissue");
    assert!((deposited[0] - 0.5).abs() < 1e-9);
    assert_eq!(summary.events[0].region.as_deref(), Some("phantom_top"));
    assert!(
        summary
            .warnings
            .iter()
            .any(|warning| warning.starts_with("1 of 200 steps did not converge"))
    );
}

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
    let own = |region: i32| {
        scenario
            .interactions
            .iter()
            .find(|(of, _)| *of == region)
            .expect("a region")
            .1
    };
    assert_eq!((own(1).friction_n_per_mm, own(2).friction_n_per_mm), (0.02, 0.25));
    // Cutting of the inclusion was left to its tissue.
    assert_eq!(own(2).cutting_n, 1.5);
    let of = |region| {
        scenario
            .mesh
            .regions()
            .iter()
            .position(|of| *of == region)
            .expect("an element")
    };
    assert_eq!(
        [1, 2].map(|region| scenario.materials[of(region)].young_kpa()),
        [10.0, 60.0]
    );
    assert!(!scenario.fixed.is_empty());
    let held = scenario
        .fixed
        .iter()
        .all(|(node, _)| scenario.mesh.nodes()[*node as usize][2] >= 40.0);
    assert!(held, "only what the box holds is fixed");

    let rigid = resolved(&BLOCK.replace("friction_n_per_mm = 0.25", "rigid = true")).expect("a scenario");
    assert!(rigid.fixed.len() > scenario.fixed.len());
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
    // To within half a voxel and what the mesh smooths.
    assert!(
        (low[0] + 20.0).abs() < 5.0 && (high[0] - 20.0).abs() < 5.0,
        "{low:?} {high:?}"
    );
}

#[test]
fn a_plan_moves_the_needle_and_leaves_seeds_on_the_way_out() {
    let at = BLOCK.find("[needle]").expect("a table");
    let planned = BLOCK[..at].to_owned()
        + r#"
[needle]
length_mm = 100
[plan]
speed_mm_s = 10
pause_s = 1
template = { origin_mm = [-5, -5, -50], x_axis = [1, 0, 0], y_axis = [0, 1, 0], names = { columns = ["A", "a"], rows = ["1", "2"] } }
[[plan.needle]]
hole = "a2"
depth_mm = 20
seeds_mm = [10, 20]
[[plan.needle]]
hole = "A1"
depth_mm = 10
speed_mm_s = 5
[[plan.target]]
name = "middle"
at_mm = [0, 0, -35]
"#;
    let scenario = resolved(&planned).expect("a scenario");
    // In 2 s, 1 s there, out 2 s, 1 s on the way, in 2 s, 1 s there, out 2 s.
    assert_eq!(scenario.timing.steps, 1100);
    let tip = |step| scenario.instruments(step).base * Point3::new(0.0, 0.0, 100.0);
    for (step, expected) in [
        (0, [0.0, 0.0, -50.0]),
        (200, [0.0, 0.0, -30.0]),
        (400, [0.0, 0.0, -40.0]),
        (600, [-5.0, -5.0, -50.0]),
        (850, [-5.0, -5.0, -40.0]),
    ] {
        assert!(
            (tip(step) - Point3::from(expected)).norm() < 1e-9,
            "{step}: {}",
            tip(step)
        );
    }
    assert_eq!(scenario.instruments(100).guide, Some(Point3::new(0.0, 0.0, -50.0)));
    assert_eq!(scenario.instruments(550).guide, None, "between two holes");
    let (_, summary) = heard(&scenario, Asked::default());
    assert_eq!(summary.max_inverted_elements, None);
    let seeds: Vec<_> = summary
        .seeds
        .iter()
        .map(|seed| (seed.time_s, seed.planned_mm))
        .collect();
    assert_eq!(seeds.len(), 2);
    assert!(
        (seeds[0].0 - 3.0).abs() < 1e-9 && (seeds[1].0 - 4.0).abs() < 1e-9,
        "{seeds:?}"
    );
    assert_eq!(seeds[0].1, Some([0.0, 0.0, -30.0]));
    for seed in &summary.seeds {
        // The model leaves them 0.5 mm beside the tip.
        assert!((seed.distance_mm.expect("in tissue") - 0.5).abs() < 1e-9);
    }
    assert!((summary.targets[0].nearest_tip_mm) < 1e-6);
    assert!((summary.targets[0].nearest_seed_mm.expect("a seed") - f64::hypot(5.0, 0.5)).abs() < 1e-9);
}

/// The block with a cylinder in its hole, which runs along z, 26 mm from its middle.
fn with_probe() -> String {
    let text = BLOCK.to_owned()
        + r#"
[contact_probe]
radius_mm = 9
length_mm = 120
axis = [0, 0, 1]
end_mm = [0, 0, 0]
within_mm = 3
"#;
    text.replace(
        "[scene.image]",
        "[scene.pose]\nposition_mm = [0, 26, 50]\ndirection = [0, -1, 0]\nlateral = [-1, 0, 0]\n[scene.image]",
    )
}

#[test]
fn a_probe_finds_the_nodes_that_it_can_touch() {
    let text = with_probe();
    let scenario = resolved(&text.replace("nodes = 250", "nodes = 1500")).expect("a scenario");
    let contact = scenario.contact.as_ref().expect("a probe");
    assert!(contact.probe.candidates.len() > 10);
    for &node in &contact.probe.candidates {
        let [x, y, z] = scenario.mesh.nodes()[node as usize];
        assert!((x.hypot(y - 26.0) - 9.0).abs() <= 3.0 + 1e-9, "{x} {y} {z}");
    }
    let thinned = text.replace("nodes = 250", "nodes = 1500") + "thinning = 3\n";
    let thinned = resolved(&thinned).expect("a scenario").contact.expect("a probe");
    assert_eq!(
        thinned.probe.candidates.len(),
        contact.probe.candidates.len().div_ceil(3)
    );
    let instruments = scenario.instruments(1);
    let probe = instruments.probe.expect("a probe");
    assert!((probe * Point3::origin() - Point3::new(0.0, 26.0, 50.0)).norm() < 1e-9);
    assert!((probe * Vector3::z() - Vector3::z()).norm() < 1e-9);
}

/// As a lever splits it: what acts a third of the way from the first point to the second rests on the first with two thirds.
#[test]
fn the_force_on_a_probe_is_split_between_the_points_that_drive_it() {
    let plain = resolved(&with_probe()).expect("a scenario");
    let driven = resolved(&(with_probe() + "driven_at_mm = [30, 90]\n")).expect("a scenario");
    for (scenario, columns) in [(&plain, 36), (&driven, 42)] {
        let mut written = Written {
            record: Record::new(scenario),
            csv: Vec::new(),
        };
        written.record.head(&mut written.csv).expect("memory");
        run(scenario, &mut Told::new(scenario), Asked::default(), &mut written).expect("a run");
        let text = String::from_utf8(written.csv).expect("text");
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert!(lines.iter().all(|line| line.len() == columns), "{:?}", lines[0]);
        assert_eq!(lines[0].last(), Some(&"ms"));
        let of = |name: &str| lines[0].iter().position(|column| *column == name);
        let force = |name: &str| of(name).map(|at| lines[1][at].parse::<f64>().expect("a number"));
        assert_eq!(force("driven_1_force_y_n").is_some(), columns == 42);
        if let (Some(first), Some(second)) = (force("driven_1_force_y_n"), force("driven_2_force_y_n")) {
            assert!(
                (first + 2.0).abs() < 1e-9 && (second + 1.0).abs() < 1e-9,
                "{first} {second}"
            );
        }
    }
}

/// Writes the table of steps.
struct Written {
    record: Record,
    csv: Vec<u8>,
}

impl Observer for Written {
    type Error = StepError;

    fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
        self.record.step(step, &mut self.csv).expect("memory");
        Ok(())
    }

    fn frame(&mut self, _: &Moment<'_>) -> Result<(), StepError> {
        Ok(())
    }

    fn mesh(&mut self, _: &Deformed<'_>) -> Result<(), StepError> {
        Ok(())
    }
}

#[test]
fn faults_point_at_their_line_and_say_what_is_expected() {
    let cases: &[(&str, &str, usize, &str)] = &[
        ("version = 1", "version = 2", 1, "expected `version = 1`"),
        ("dt_ms = 10", "dt_ms = 0", 3, "0.01 to 100 ms"),
        ("dt_ms = 10", "dt_s = 10", 3, "unknown key `dt_s`"),
        (
            "phantom = \"two-layer\"",
            "phantom = \"two\"",
            5,
            "unknown variant `two`",
        ),
        ("resolution_mm = 5", "resolution_mm = 99", 6, "expected 0.3 to 5 mm"),
        ("nodes = 250", "nodes = 2", 11, "8 to 1000000"),
        ("nodes = 250", "nodes = 250\nlevel = \"V\"", 12, "unknown variant `V`"),
        (
            "nodes = 250",
            "level = \"IV\"\ncolumns = \"on-demand\"",
            12,
            "keeps a dense inverse",
        ),
        (
            "nodes = 250",
            "model = \"mass-spring\"\nlevel = \"I\"",
            12,
            "mass-spring",
        ),
        ("40], [inf", "400], [inf", 13, "no node in this box"),
        ("\"phantom_inclusion\"", "\"phantom_inclusio\"", 15, "no label here"),
        ("friction_n_per_mm = 0.25", "friction_n_per_mm = -1", 16, "0 or more"),
        ("friction_n_per_mm = 0.25", "poisson = 0.5", 16, "below 0.5"),
        ("length_mm = 100", "length_mm = 0", 18, "0.1 to 1000"),
        ("length_mm = 100", "kappa_nmm_per_deg = 3", 18, "springs"),
        ("deposit_s = [1.0]", "deposit_s = [9.0]", 19, "within the run"),
        ("time_s = 2", "time_s = 0", 25, "more than 0"),
        (
            "direction = [0, 0, 1]\nroll",
            "direction = [0, 0, 0]\nroll",
            27,
            "not all zero",
        ),
        ("roll_deg = 90", "roll_deg = nan", 28, "finite number of degrees"),
    ];
    for (from, to, line, words) in cases {
        let text = BLOCK.replacen(from, to, 1);
        assert_ne!(text, BLOCK, "{from}");
        let error = resolved(&text).map(drop).expect_err(to);
        assert_eq!(error.location(), Some(("block.toml", *line)), "{to}: {error}");
        assert!(error.to_string().contains(words), "{to}: {error}");
        assert!(!error.is_machine(), "{to}");
    }
}

#[test]
fn scenes_are_named_or_refused() {
    let needle = BLOCK.replace("[scene.image]", "[scene.needle]\ntip_mm = [0, 0, 0]\n[scene.image]");
    let error = resolved(&needle).map(drop).expect_err("a needle of its own");
    assert!(error.to_string().contains("the scenario moves the needle"), "{error}");
    let at = BLOCK.find("[tissue]").expect("a table");
    let named = |scene: &str| format!("version = 1\nscene = \"{scene}\"\n{}", &BLOCK[at..]);
    for (scene, words) in [
        ("liver-needle", "a scene with `needle` of its own"),
        ("prostate-truss", "nothing here is named"),
        ("nowhere.toml", "cannot be read"),
    ] {
        let error = resolved(&named(scene)).map(drop).expect_err(scene);
        assert!(error.to_string().contains(words), "{error}");
        assert_eq!(error.location(), Some(("block.toml", 2)), "{error}");
    }
}

#[test]
fn scenarios_that_come_with_the_crate_are_read() {
    for (name, text) in super::EXAMPLES {
        let file = ScenarioFile::parse(text, name).expect(name);
        assert!(file.needle.is_some(), "{name}");
    }
}

#[test]
fn every_key_is_explained_by_the_schema() {
    fn undocumented(at: &serde_json::Value, path: &str, found: &mut Vec<String>) {
        let properties = at.get("properties").and_then(serde_json::Value::as_object);
        for (name, property) in properties.into_iter().flatten() {
            let path = format!("{path}.{name}");
            if property.get("description").is_none() {
                found.push(path.clone());
            }
        }
    }
    let schema = super::schema();
    let mut found = Vec::new();
    undocumented(&schema, "", &mut found);
    let defined = schema.get("$defs").and_then(serde_json::Value::as_object);
    for (name, of) in defined.into_iter().flatten() {
        undocumented(of, name, &mut found);
    }
    assert!(found.is_empty(), "{found:?}");
}
