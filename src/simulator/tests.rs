use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::forces::{Easing, Given};
use super::hand_over::hand_over;
use super::seeds::Seeds;
use super::*;
use crate::mechanics::insertion::{Field, Imager, Outcome, Saved, Snapshot, Tissue, Wrench};
use crate::mechanics::mesh::TetMesh;
use crate::scene::SceneFile;
use crate::synth::Backend;

/// What was asked of a fake model.
#[derive(Default)]
struct Asked {
    snapshots: AtomicUsize,
    imagers: AtomicUsize,
    tissues: AtomicUsize,
}

/// A model whose every number follows from its steps, and whose every state is one number in many places.
#[derive(Default)]
struct Fake {
    state: f64,
    step: u64,
    outcome: Outcome,
    slow: Duration,
    mesh: Option<Arc<TetMesh>>,
    asked: Arc<Asked>,
}

struct FakeImager {
    mesh: Option<Arc<TetMesh>>,
    asked: Arc<Asked>,
}

impl Imager for FakeImager {
    fn elements(&self) -> &[[u32; 4]] {
        self.mesh.as_ref().map_or(&[], |mesh| mesh.elements())
    }

    /// Moves all nodes along x by the state.
    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue) {
        self.asked.tissues.fetch_add(1, Ordering::Relaxed);
        let nodes = self.mesh.as_ref().map_or(&[][..], |mesh| mesh.nodes());
        into.reference.clear();
        into.reference.extend_from_slice(nodes);
        into.current.clear();
        into.current
            .extend(nodes.iter().map(|&[x, y, z]| [x + snapshot.time_s, y, z]));
    }
}

impl Model for Fake {
    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
        if dt_s <= 0.0 {
            return Err(StepError::Input {
                what: "time",
                found: dt_s,
                expected: "above 0",
            });
        }
        thread::sleep(self.slow);
        // Bits that any difference in the inputs reaches.
        let pose = instruments.base;
        let guide = instruments.guide.map_or(0.0, |guide| guide.z);
        self.state = (1.7 * self.state + pose.translation.x + pose.rotation.i * dt_s + guide).sin();
        self.step += 1;
        self.outcome.on_hand.force_n = Vector3::new(0.0, self.state, -1.0);
        self.outcome.on_hand.torque_nmm = Vector3::new(1.0, 0.0, 0.0);
        self.outcome.on_probe = instruments.probe.map(|_| self.outcome.on_hand);
        self.outcome.contacts = self.step as usize;
        Ok(&self.outcome)
    }

    fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    fn snapshot(&mut self, into: &mut Snapshot) {
        self.asked.snapshots.fetch_add(1, Ordering::Relaxed);
        into.step = self.step;
        let mark = self.step as f64;
        into.time_s = mark;
        into.line.set([
            (0.0, Point3::new(0.0, 0.0, mark)),
            (1.0 + mark, Point3::new(1.0, 0.0, mark)),
        ]);
        into.seeds.clear();
        into.seeds.resize(self.step as usize % 7, Point3::new(mark, 0.0, 0.0));
        into.moved.clear();
        into.moved.resize(self.step as usize % 5, (self.step as u32, [mark; 3]));
        match &mut into.field {
            Field::Displacement(field) => {
                field.clear();
                field.resize(500, [mark; 3]);
            }
            field => *field = Field::Displacement(vec![[mark; 3]; 500]),
        }
    }

    fn imager(&self) -> Box<dyn Imager> {
        self.asked.imagers.fetch_add(1, Ordering::Relaxed);
        Box::new(FakeImager {
            mesh: self.mesh.clone(),
            asked: self.asked.clone(),
        })
    }

    fn save(&mut self) -> Saved {
        Saved(serde_json::json!({ "state": self.state, "step": self.step }))
    }

    fn restore(&mut self, saved: &Saved) -> Result<(), StepError> {
        let foreign = || StepError::Foreign(saved.0.to_string());
        let state = saved.0["state"].as_f64().ok_or_else(foreign)?;
        self.step = saved.0["step"].as_u64().ok_or_else(foreign)?;
        self.state = state;
        Ok(())
    }
}

fn instruments(step: usize) -> Instruments {
    let angle = 0.1 * step as f64;
    let rotation = UnitQuaternion::from_euler_angles(angle, 0.3, -0.7 * angle);
    Instruments {
        base: Isometry3::from_parts(Translation3::new(0.3 * angle.cos(), 1.0 / 3.0, angle), rotation),
        probe: (!step.is_multiple_of(3)).then(|| Isometry3::translation(angle, 0.0, 0.0)),
        guide: step.is_multiple_of(2).then(|| Point3::new(0.1, angle, angle / 3.0)),
        deposit: step.is_multiple_of(5),
    }
}

fn patient() -> Options {
    Options {
        budget: Duration::from_secs(60),
        policy: Policy::Finish,
    }
}

#[test]
fn no_state_is_ever_torn() {
    let (mut publisher, mut latest) = hand_over();
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = stop.clone();
    let writer = thread::spawn(move || {
        let mut model = Fake::default();
        while !stopped.load(Ordering::Relaxed) {
            model.step += 1;
            publisher.publish(&mut model);
        }
        model.step
    });
    let mut last = 0;
    for _ in 0..100 {
        while !latest.take() {
            thread::yield_now();
        }
        let state = latest.state();
        assert!(state.step > last, "{} after {last}", state.step);
        last = state.step;
        let (step, mark) = (state.step as usize, state.step as f64);
        assert_eq!(state.time_s, mark);
        assert!(state.line.nodes().iter().all(|node| node.1.z == mark));
        assert_eq!(state.line.length_mm(), 1.0 + mark);
        assert_eq!((state.seeds.len(), state.moved.len()), (step % 7, step % 5));
        assert!(state.seeds.iter().all(|seed| seed.x == mark));
        assert!(state.moved.iter().all(|node| node == &(step as u32, [mark; 3])));
        let Field::Displacement(field) = &state.field else {
            panic!("no field")
        };
        assert!(field.len() == 500 && field.iter().all(|node| node == &[mark; 3]));
    }
    stop.store(true, Ordering::Relaxed);
    let written = writer.join().expect("writer");
    // The last one is there to be taken, if it was not.
    assert!(latest.take() == (last < written) && latest.state().step == written);
}

#[test]
fn forces_are_on_the_hand_in_both_frames() {
    let mut haptic = Haptic::new(Box::new(Fake::default()), patient());
    // The base's z axis is the world's y axis.
    let base = Isometry3::rotation(Vector3::x() * -std::f64::consts::FRAC_PI_2);
    let inputs = Instruments {
        base,
        probe: Some(Isometry3::identity()),
        guide: None,
        deposit: false,
    };
    let forces = haptic.step(&inputs, 1e-3).expect("step");
    let found = haptic.outcome().on_hand;
    assert_eq!((forces.hand_world, forces.probe_world), (found, Some(found)));
    let axes = |world: Vector3<f64>| Vector3::new(world.x, -world.z, world.y);
    assert!((forces.hand_base.force_n - axes(found.force_n)).norm() < 1e-12);
    assert!((forces.hand_base.torque_nmm - axes(found.torque_nmm)).norm() < 1e-12);
    assert_eq!(forces.overrun, None);
    // What is refused changes nothing.
    assert!(haptic.step(&inputs, 0.0).is_err());
    assert_eq!((haptic.time_s(), haptic.outcome().contacts), (1e-3, 1));
}

#[test]
fn a_late_step_says_so_and_eases() {
    let slow = Duration::from_millis(4);
    let late = |policy| {
        let options = Options {
            budget: Duration::from_millis(1),
            policy,
        };
        let model = Fake {
            slow,
            ..Fake::default()
        };
        let mut haptic = Haptic::new(Box::new(model), options);
        let forces = haptic.step(&instruments(1), 1e-3).expect("step");
        assert!(forces.took >= slow);
        assert_eq!(forces.overrun, Some(forces.took - Duration::from_millis(1)));
        // The step is made all the same.
        assert_eq!(haptic.outcome().contacts, 1);
        (forces.hand_world.force_n, haptic.outcome().on_hand.force_n)
    };
    let (given, computed) = late(Policy::Finish);
    assert_eq!(given, computed);
    let over = Duration::from_millis(4);
    let (given, computed) = late(Policy::Ease { over });
    assert!((given - computed * 0.25).norm() < 1e-15);
}

#[test]
fn forces_ease_linearly_and_never_freeze() {
    let given = |force: f64| {
        let wrench = Wrench {
            force_n: Vector3::new(force, 0.0, 0.0),
            torque_nmm: Vector3::new(0.0, force, 0.0),
        };
        Given::of(&Outcome {
            on_hand: wrench,
            on_probe: Some(wrench),
            ..Outcome::default()
        })
    };
    let policy = Policy::Ease {
        over: Duration::from_millis(4),
    };
    let mut easing = Easing::default();
    let mut next = |force, late| {
        let forces = easing
            .next(given(force), 1e-3, late, policy)
            .forces(&Isometry3::identity(), Duration::ZERO, None);
        assert_eq!(forces.probe_world, Some(forces.hand_world));
        assert_eq!(forces.hand_world.torque_nmm.y, forces.hand_world.force_n.x);
        forces.hand_world.force_n.x
    };
    assert_eq!(next(1.0, false), 1.0);
    for (late, expected) in [(true, 2.0), (false, 3.0), (false, 4.0), (false, 5.0), (false, 5.0)] {
        assert!((next(5.0, late) - expected).abs() < 1e-12);
    }
    // Late every time: a low-pass filter, 3/4 of the way left after each step.
    for step in 1..60 {
        let expected = 9.0 - 4.0 * 0.75f64.powi(step);
        assert!((next(9.0, true) - expected).abs() < 1e-12);
    }
}

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

/// An anatomy of one block with a mesh of it or without, and a probe on it.
fn scene(meshed: bool) -> (Synthesizer, Matrix4<f64>, Option<Arc<TetMesh>>) {
    let mut text = String::from(
        "version = 1\nvolume = { phantom = \"two-layer\", resolution_mm = 3 }\nimage = { width = 64, height = 48 }\n",
    );
    if meshed {
        text += "[deform]\nnodes = 300\nfield = { kind = \"indentation\", centre_mm = [0, 0, 0], direction = [0, 1, 0], \
                 depth_mm = 0.0, radius_mm = 25.0 }\n";
    }
    let scene = SceneFile::parse(&text, "scene")
        .expect("file")
        .resolve(".".as_ref())
        .expect("scene");
    let pose = *scene.probe_pose(0, 1).probe_to_world();
    let mesh = scene.anatomy.mesh.clone();
    // Frames of one state are one image: without noise, which differs from frame to frame.
    let mut settings = scene.settings;
    (settings.effects.receiver, settings.effects.noise) = (None, None);
    let synthesizer = Synthesizer::new(scene.anatomy, settings, Backend::Cpu).expect("synthesizer");
    (synthesizer, pose, mesh)
}

#[test]
fn without_an_image_no_state_is_asked_for() {
    let model = Fake::default();
    let asked = model.asked.clone();
    let mut haptic = Haptic::new(Box::new(model), patient());
    let counts = || [&asked.snapshots, &asked.imagers, &asked.tissues].map(|count| count.load(Ordering::Relaxed));
    for step in 0..5 {
        haptic.step(&instruments(step), 1e-3).expect("step");
    }
    assert_eq!(counts(), [0, 0, 0]);
    // An image without a mesh asks for no tissue.
    let (synthesizer, pose, _) = scene(false);
    let mut imaging = haptic.imaged(synthesizer, 1.27).expect("imaging");
    assert_eq!(counts(), [1, 1, 0]);
    haptic.step(&instruments(5), 1e-3).expect("step");
    imaging.frame(&pose).expect("frame");
    assert_eq!((counts(), imaging.snapshot().step), ([2, 1, 0], 6));
    drop(imaging);
    haptic.step(&instruments(6), 1e-3).expect("step");
    assert_eq!(counts(), [2, 1, 0]);
}

#[test]
fn frames_show_the_latest_state_and_tissue_is_computed_once_for_each() {
    let (synthesizer, pose, mesh) = scene(true);
    let model = Fake {
        mesh,
        ..Fake::default()
    };
    let asked = model.asked.clone();
    let tissues = || asked.tissues.load(Ordering::Relaxed);
    let mut simulator = Simulator::new(Box::new(model), synthesizer, 1.27, patient()).expect("simulator");
    let rest = simulator.frame(&pose).expect("frame").pixels.clone();
    assert_eq!(tissues(), 1);
    for step in 0..6 {
        simulator.step(&instruments(step), 1e-3).expect("step");
    }
    let (haptic, mut imaging) = simulator.split();
    let moved = imaging.frame(&pose).expect("frame").pixels.clone();
    assert_eq!((tissues(), imaging.snapshot().step), (2, 6));
    assert!(moved != rest);
    assert!(imaging.frame(&pose).expect("frame").pixels == moved);
    assert_eq!(tissues(), 2);
    drop(haptic);
    assert!(imaging.frame(&pose).expect("frame").pixels == moved);
}

#[test]
fn another_mesh_is_refused() {
    let (synthesizer, _, mesh) = scene(true);
    let found = mesh.as_ref().map_or(0, |mesh| mesh.elements().len());
    let refused = Simulator::new(Box::new(Fake::default()), synthesizer, 1.27, patient());
    assert_eq!(refused.err(), Some(InvalidImaging::Elements { found, expected: 0 }));
    let (synthesizer, ..) = scene(true);
    let refused = Simulator::new(
        Box::new(Fake {
            mesh,
            ..Fake::default()
        }),
        synthesizer,
        0.0,
        patient(),
    );
    assert_eq!(refused.err(), Some(InvalidImaging::Diameter { found: 0.0 }));
}

#[test]
fn seeds_move_with_the_tissue() {
    let size = Vector3::new(10.0, 10.0, 10.0);
    let mesh = TetMesh::lattice([3; 3], &Matrix4::new_nonuniform_scaling(&size)).expect("mesh");
    let (mesh, mut tissue) = (Arc::new(mesh), Tissue::default());
    // Linear in each element, so exact: a stretch along x, after a remesh that left the boundary as it was.
    let stretched = |tissue: &Tissue, by: f64| tissue.reference.iter().map(|&[x, y, z]| [x * by, y, z]).collect();
    tissue.reference = mesh.nodes().to_vec();
    let inner = |node: &&mut [f64; 3]| node.iter().all(|x| (0.1..9.9).contains(x));
    tissue
        .reference
        .iter_mut()
        .filter(inner)
        .for_each(|node| node[1] += 0.3);
    let mut snapshot = Snapshot::default();
    snapshot
        .line
        .set([(0.0, Point3::origin()), (10.0, Point3::new(0.0, 6.0, 8.0))]);
    let mut seeds = Seeds::new(Some(mesh));
    let (mut plain, mut shown, mut still) = (Seeds::new(None), Vec::new(), Vec::new());
    for (count, by) in [(0, 1.0), (1, 1.1), (3, 1.3), (2, 0.8)] {
        tissue.current = stretched(&tissue, by);
        let places = [[3.0, 4.0, 5.0], [9.0, 1.0, 1.0], [-5.0, 0.0, 0.0]].map(Point3::from);
        snapshot.seeds = places[..count].to_vec();
        seeds.show(&snapshot, &tissue, &mut shown);
        plain.show(&snapshot, &tissue, &mut still);
        assert_eq!((shown.len(), still.len()), (count, count));
        for ((place, shown), still) in places.iter().zip(&shown).zip(&still) {
            // The last one lies outside.
            let expected = if place.x < 0.0 {
                *place
            } else {
                Point3::new(place.x * by, place.y, place.z)
            };
            let along = shown.nodes[1] - shown.nodes[0];
            assert!((nalgebra::center(&shown.nodes[0], &shown.nodes[1]) - expected).norm() < 1e-9);
            assert!((along.normalize() - Vector3::new(0.0, 0.6, 0.8)).norm() < 1e-9);
            assert!((nalgebra::center(&still.nodes[0], &still.nodes[1]) - place).norm() < 1e-12);
        }
    }
}
