//! Saving, recording and replay.

use nalgebra::{Isometry3, Point3, Vector3};

use super::{Fake, instruments, patient};
use crate::input::scenario::ScenarioFile;
use crate::run::{Observer, Requests, Step, run};
use crate::simulator::{Forces, Haptic};
use insonify_mechanics::insertion::{Instruments, Outcome, RecordedInput, Recording, Saved, SimulatorState, StepError};
use insonify_mechanics::tissue::remesh::Level;

#[test]
fn a_recording_replays_to_the_bit_also_from_a_file() {
    let mut haptic = Haptic::new(Box::new(Fake::default()), patient());
    for step in 0..10 {
        haptic.step(&instruments(step), 1e-3).expect("step");
    }
    assert_eq!(haptic.take_recording(), None);
    haptic.record();
    let mut forces_seen = Vec::new();
    for step in 10..200 {
        let forces = haptic
            .step(&instruments(step), 1.0 / (700.0 + step as f64))
            .expect("step");
        forces_seen.push((forces.hand_base, haptic.outcome().clone()));
    }
    let end = haptic.save();
    let recording = haptic.take_recording().expect("recording");
    assert_eq!(recording.inputs.len(), 190);
    let text = serde_json::to_string(&recording).expect("text");
    let read: Recording = serde_json::from_str(&text).expect("recording");
    assert_eq!(read, recording);
    for recording in [recording, read] {
        let mut replayed = Haptic::new(Box::new(Fake::default()), patient());
        let mut seen = Vec::new();
        let step = |forces: &Forces, outcome: &Outcome| seen.push((forces.hand_base, outcome.clone()));
        replayed.replay(&recording, step).expect("replay");
        assert!(seen == forces_seen && replayed.save() == end && replayed.time_s() == haptic.time_s());
    }
}

#[test]
fn going_back_begins_a_recording_anew() {
    let mut haptic = Haptic::new(Box::new(Fake::default()), patient());
    haptic.step(&instruments(1), 1e-3).expect("step");
    let state = haptic.save();
    haptic.record();
    haptic.step(&instruments(2), 1e-3).expect("step");
    haptic.restore(&state).expect("state");
    haptic.step(&instruments(3), 1e-3).expect("step");
    let recording = haptic.take_recording().expect("recording");
    assert_eq!((recording.start, recording.inputs.len()), (state.clone(), 1));
    let foreign = SimulatorState {
        model: Saved(serde_json::json!("of another")),
        ..state
    };
    let time_s = haptic.time_s();
    assert!(matches!(haptic.restore(&foreign), Err(StepError::Foreign(_))));
    assert_eq!(haptic.time_s(), time_s);
}

#[test]
fn a_change_of_level_begins_a_recording_anew() {
    let mut haptic = Haptic::new(Box::new(Fake::default()), patient());
    haptic.record();
    haptic.step(&instruments(1), 1e-3).expect("step");
    let change = haptic.set_level(Level::III).expect("a level");
    assert_eq!((change.to, change.force_jump_n), (Level::III, 1.0));
    let forces = haptic.step(&instruments(2), 1e-3).expect("step");
    let recording = haptic.take_recording().expect("recording");
    assert_eq!(recording.inputs.len(), 1);
    let mut seen = Vec::new();
    haptic
        .replay(&recording, |forces, _| seen.push(forces.hand_base))
        .expect("replay");
    assert_eq!(seen, [forces.hand_base]);
}

#[test]
fn a_session_of_a_scenario_replays_as_a_run() {
    const BLOCK: &str = r#"
version = 1
[run]
dt_ms = 10
[scene.volume]
phantom = "two-layer"
resolution_mm = 5
[tissue]
nodes = 250
[[tissue.fix]]
box_mm = [[-inf, -inf, 40], [inf, inf, inf]]
[[tissue.material]]
region = "phantom_inclusion"
friction_n_per_mm = 0.25
[needle]
length_mm = 100
[[needle.motion.keyframes]]
time_s = 0
tip_mm = [0, 0, -50]
direction = [0, 0, 1]
[[needle.motion.keyframes]]
time_s = 1
tip_mm = [0, 0, -20]
direction = [0, 0, 1]
"#;
    #[derive(Default)]
    struct Seen(Vec<(Outcome, Point3<f64>, Vector3<f64>)>);
    impl Observer for Seen {
        type Error = StepError;

        fn step(&mut self, step: &Step<'_>) -> Result<(), StepError> {
            let guidance = &step.guidance;
            self.0.push((step.outcome.clone(), guidance.array, guidance.normal));
            Ok(())
        }
    }
    let scenario = ScenarioFile::parse(BLOCK, "block.toml").and_then(|file| file.resolve(".".as_ref(), |_| {}));
    let scenario = scenario.expect("a scenario");
    let mut haptic = Haptic::new(scenario.model(|_, _| {}).expect("a model"), patient());
    haptic.record();
    let mut forces_made = Vec::new();
    // Another way in than the scenario's, and a probe that turns.
    for step in 0..80 {
        let share = f64::from(step) / 80.0;
        let view = Isometry3::new(Vector3::new(0.0, 60.0 * share, -45.0), Vector3::x() * share);
        let base = Isometry3::new(Vector3::new(2.0, 1.0, -150.0 + 40.0 * share), Vector3::zeros());
        haptic.record_view(view).expect("rigid");
        let instruments = Instruments { base, ..instruments(0) };
        haptic.step(&instruments, 0.01).expect("a step");
        forces_made.push((haptic.outcome().clone(), view * Point3::origin(), view * Vector3::z()));
    }
    let recording = haptic.take_recording().expect("a recording");
    let text = serde_json::to_string(&recording).expect("text");
    let recording: Recording = serde_json::from_str(&text).expect("a recording");
    let slow = Recording {
        inputs: vec![RecordedInput {
            dt_s: 0.02,
            ..recording.inputs[0]
        }],
        ..recording.clone()
    };
    let refused = scenario.clone().replaying(slow).expect_err("another step");
    assert_eq!(
        refused,
        "step 0 of 0.02 s; expected 0.01 s, as the scenario's `run.dt_s`"
    );
    let replayed = scenario.replaying(recording).expect("the same scenario");
    let mut model = replayed.model(|_, _| {}).expect("a model");
    let mut seen = Seen::default();
    run(&replayed, model.as_mut(), Requests::default(), &mut seen).expect("a run");
    assert!(forces_made.iter().any(|(outcome, ..)| outcome.inserted_mm > 5.0));
    assert!(seen.0 == forces_made, "the replay differs");
}

#[test]
fn inputs_that_are_none_are_refused() {
    let good = r#"{"dt_s": 0.001, "base": {"position_mm": [1, 2, 3], "quaternion_xyzw": [0, 0.6, 0, 0.8]}}"#;
    let input: RecordedInput = serde_json::from_str(good).expect("input");
    assert_eq!(input.instruments.base.translation.vector, Vector3::new(1.0, 2.0, 3.0));
    assert!(input.instruments.probe.is_none() && !input.instruments.deposit);
    for (written, replacement, said) in [
        ("0.6", "0.7", "`quaternion_xyzw` of `base` is [0.0, 0.7, 0.0, 0.8]"),
        ("dt_s", "dt", "unknown field `dt`"),
        ("position_mm", "position", "unknown field `position`"),
        (
            r#"{"position_mm": [1, 2, 3], "quaternion_xyzw": [0, 0.6, 0, 0.8]}"#,
            "[[1, 2, 3], [0, 0.6, 0, 0.8]]",
            "invalid type: sequence, expected a table",
        ),
        (good, "[0.001]", "invalid type: sequence, expected a table"),
    ] {
        let error = serde_json::from_str::<RecordedInput>(&good.replace(written, replacement)).expect_err(replacement);
        assert!(error.to_string().contains(said), "{error}");
    }
}
