//! Saving, recording and replay.

use nalgebra::Vector3;

use super::{Fake, instruments, patient};
use crate::mechanics::insertion::{Outcome, Saved, StepError};
use crate::mechanics::tissue::remesh::Level;
use crate::simulator::{Forces, Haptic, Input, Recording, State};

#[test]
fn a_recording_replays_to_the_bit_also_from_a_file() {
    let mut haptic = Haptic::new(Box::new(Fake::default()), patient());
    for step in 0..10 {
        haptic.step(&instruments(step), 1e-3).expect("step");
    }
    assert_eq!(haptic.take_recording(), None);
    haptic.record();
    let mut found = Vec::new();
    for step in 10..200 {
        let forces = haptic
            .step(&instruments(step), 1.0 / (700.0 + step as f64))
            .expect("step");
        found.push((forces.hand_base, haptic.outcome().clone()));
    }
    let end = haptic.save();
    let recording = haptic.take_recording().expect("recording");
    assert_eq!(recording.inputs.len(), 190);
    let text = serde_json::to_string(&recording).expect("text");
    let read: Recording = serde_json::from_str(&text).expect("recording");
    assert_eq!(read, recording);
    for recording in [recording, read] {
        let mut other = Haptic::new(Box::new(Fake::default()), patient());
        let mut seen = Vec::new();
        let step = |forces: &Forces, outcome: &Outcome| seen.push((forces.hand_base, outcome.clone()));
        other.replay(&recording, step).expect("replay");
        assert!(seen == found && other.save() == end && other.time_s() == haptic.time_s());
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
    let foreign = State {
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
fn inputs_that_are_none_are_refused() {
    let good = r#"{"dt_s": 0.001, "base": {"position_mm": [1, 2, 3], "quaternion_xyzw": [0, 0.6, 0, 0.8]}}"#;
    let input: Input = serde_json::from_str(good).expect("input");
    assert_eq!(input.instruments.base.translation.vector, Vector3::new(1.0, 2.0, 3.0));
    assert!(input.instruments.probe.is_none() && !input.instruments.deposit);
    for (from, to, said) in [
        ("0.6", "0.7", "`quaternion_xyzw` of `base` is [0.0, 0.7, 0.0, 0.8]"),
        ("dt_s", "dt", "unknown field `dt`"),
        ("position_mm", "position", "unknown field `position`"),
    ] {
        let error = serde_json::from_str::<Input>(&good.replace(from, to)).expect_err(to);
        assert!(error.to_string().contains(said), "{error}");
    }
}
