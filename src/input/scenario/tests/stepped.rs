//! Tests of runs: steps, frames, meshes, seeds, the table.

use nalgebra::Point3;

use super::prescribed::PrescribedModel;
use super::{BLOCK, resolved, with_probe};
use crate::input::scenario::{EXAMPLES, Scenario};
use crate::run::record::Record;
use crate::run::summary::Summary;
use crate::run::{Deformed, Moment, Observer, Requests, Step, run};
use insonify_base::document::InputError;
use insonify_mechanics::insertion::StepError;

/// Records what the observer receives.
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

fn heard(scenario: &Scenario, requests: Requests) -> (Heard, Summary) {
    let mut heard = Heard::default();
    let summary = run(scenario, &mut PrescribedModel::new(scenario), requests, &mut heard).expect("a run");
    (heard, summary)
}

#[test]
fn a_run_steps_from_start_to_end_and_tells_of_it() {
    let scenario = resolved(BLOCK).expect("a scenario");
    assert!(scenario.scene.settings.has_needle && scenario.scene.anatomy.mesh.is_some());
    let requests = Requests {
        frames: true,
        mesh_s: Some(0.5),
    };
    let (heard, summary) = heard(&scenario, requests);
    assert_eq!((summary.steps, heard.steps.len()), (200, 200));
    assert!((summary.simulated_s - 2.0).abs() < 1e-12);
    for &(time_s, tip) in &heard.steps {
        assert!((tip - (-50.0 + 10.0 * time_s)).abs() < 1e-9, "{tip} at {time_s} s");
    }
    // 25 frames per second and two meshes per second, from the first step to the end.
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
    assert!(summary.step_ms.remesh_max.is_some() && summary.step_ms.wall.median <= summary.step_ms.wall.max);
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
fn a_plan_moves_the_needle_and_leaves_seeds_on_the_way_out() {
    let needle_table = BLOCK.find("[needle]").expect("a table");
    let planned = BLOCK[..needle_table].to_owned()
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
    // Insertion 2 s, pause 1 s, withdrawal 2 s, pause 1 s, insertion 2 s, pause 1 s, withdrawal 2 s.
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
    let (_, summary) = heard(&scenario, Requests::default());
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
        // The model deposits them 0.5 mm beside the tip.
        assert!((seed.distance_mm.expect("in tissue") - 0.5).abs() < 1e-9);
    }
    assert_eq!(summary.misplacement.map(|misplacement| misplacement.seeds), Some(2));
    assert!((summary.targets[0].nearest_tip_mm) < 1e-6);
    assert!((summary.targets[0].nearest_seed_mm.expect("a seed") - f64::hypot(5.0, 0.5)).abs() < 1e-9);
}

/// Lever rule: a force one third of the way from the first point to the second loads the first with two thirds.
#[test]
fn the_force_on_a_probe_is_split_between_the_points_that_drive_it() {
    let plain = resolved(&with_probe()).expect("a scenario");
    let driven = resolved(&(with_probe() + "driven_at_mm = [30, 90]\n")).expect("a scenario");
    for (scenario, columns) in [(&plain, 69), (&driven, 75)] {
        let mut written = Written {
            record: Record::new(scenario),
            csv: Vec::new(),
        };
        written.record.head(&mut written.csv).expect("memory");
        run(
            scenario,
            &mut PrescribedModel::new(scenario),
            Requests::default(),
            &mut written,
        )
        .expect("a run");
        let text = String::from_utf8(written.csv).expect("text");
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert!(lines.iter().all(|line| line.len() == columns), "{:?}", lines[0]);
        assert_eq!(lines[0].last(), Some(&"step_ms"));
        let column_of = |name: &str| lines[0].iter().position(|column| *column == name);
        let value = |name: &str| column_of(name).map(|column| lines[1][column].parse::<f64>().expect("a number"));
        assert_eq!(value("driven_1_force_y_n").is_some(), columns == 75);
        let pose = scenario.instruments(1).probe.expect("a probe");
        let position = ["probe_x_mm", "probe_y_mm", "probe_z_mm"].map(|name| value(name).expect("a place"));
        assert_eq!(position, <[f64; 3]>::from(pose.translation.vector));
        let turn = ["probe_qx", "probe_qy", "probe_qz", "probe_qw"].map(|name| value(name).expect("a turn"));
        assert_eq!(turn, <[f64; 4]>::from(pose.rotation.coords));
        if let (Some(first), Some(second)) = (value("driven_1_force_y_n"), value("driven_2_force_y_n")) {
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
}

#[test]
fn the_level_of_remeshing_changes_on_the_way() {
    let changes = "[[run.change]]\nat_s = 0.2\nlevel = \"IV\"\n[[run.change]]\nat_s = 1.9\nlevel = \"exact\"\n";
    let changing =
        resolved(&BLOCK.replace("[scene.volume]", &(changes.to_owned() + "[scene.volume]"))).expect("changes");
    let plain = resolved(BLOCK).expect("a scenario");
    let [(changing, told), (plain, untold)] = [changing, plain].map(|scenario| {
        let mut written = Written {
            record: Record::new(&scenario),
            csv: Vec::new(),
        };
        let mut model = scenario.model(|_, _| {}).expect("a model");
        let summary = run(&scenario, model.as_mut(), Requests::default(), &mut written).expect("a run");
        let text = String::from_utf8(written.csv).expect("text");
        let rows = text
            .lines()
            .filter_map(|line| Some(line.rsplit_once(',')?.0.to_owned()));
        (rows.collect::<Vec<_>>(), summary.level_changes)
    });
    assert_eq!(untold, []);
    let levels = told.iter().map(|change| (change.from.as_str(), change.to.as_str()));
    assert_eq!(levels.collect::<Vec<_>>(), [("exact", "IV"), ("IV", "exact")]);
    // Before the 20th and the 190th of 200 steps of 10 ms.
    for (change, time_s) in told.iter().zip([0.19, 1.89]) {
        assert!(
            (change.time_s - time_s).abs() < 1e-9 && change.seconds > 0.0,
            "{change:?}"
        );
    }
    assert!(
        told[0].force_jump_n < 1e-6,
        "level IV begins with what is there: {told:?}"
    );
    assert!(told[1].force_jump_n > 1e-6, "and what it left comes then: {told:?}");
    assert_eq!(changing[..20], plain[..20]);
    assert_ne!(changing[189], plain[189]);
}

/// The block seen in a plane across its needle, with an image of a planning study 3 mm beside it.
fn studied(image: &str) -> Result<Scenario, InputError> {
    let pose = "[scene.pose]\nposition_mm = [0, -40, 0]\ndirection = [0, 1, 0]\nlateral = [1, 0, 0]\n[scene.image]";
    resolved(&(BLOCK.replace("[scene.image]", pose) + "[[plan.image]]\nname = \"middle\"\n" + image))
}

const BESIDE: &str = "position_mm = [0, -40, 3]\ndirection = [0, 1, 0]\nlateral = [1, 0, 0]\n";

#[test]
fn the_probe_is_held_against_a_planning_study() {
    let scenario = studied(&format!("organ = [\"inclusion\"]\n{BESIDE}")).expect("a scenario");
    let (_, summary) = heard(&scenario, Requests::default());
    let [image] = &summary.images[..] else {
        panic!("{:?}", summary.images)
    };
    assert!((image.rms_mm - 3.0).abs() < 1e-9 && image.turn_deg < 1e-6, "{image:?}");
    assert!((image.elevational_mm.abs() - 3.0).abs() < 1e-9, "{image:?}");
    // The inclusion has the same section in both.
    assert!(image.dice.expect("an organ") > 0.99, "{image:?}");
    for (lines, key) in [
        (format!("organ = [\"spleen\"]\n{BESIDE}"), "plan.image[0].organ[0]"),
        (
            format!("organ = [\"inclusion\"]\n{}", BESIDE.replace("-40, 3", "-40, 400")),
            "plan.image[0].organ",
        ),
        (BESIDE.replace("[0, 1, 0]", "[0, 0, 0]"), "plan.image[0].direction"),
        (
            format!("{BESIDE}[[plan.image]]\nname = \"middle\"\n{BESIDE}"),
            "plan.image[1].name",
        ),
    ] {
        let error = studied(&lines).map(drop).expect_err(key);
        assert_eq!(error.key(), Some(key), "{error}");
    }
}

#[test]
fn the_implant_that_comes_with_the_crate_has_twenty_needles_and_eighty_seeds() {
    let (_, text) = EXAMPLES
        .iter()
        .find(|(name, _)| *name == "prostate-implant")
        .expect("an example");
    let coarse = text.replace("nodes = 3300", "nodes = 250");
    assert_ne!(coarse, *text);
    let scenario = resolved(&coarse).expect("a scenario");
    assert_eq!((scenario.guides.len(), scenario.deposits.len()), (20, 80));
}
