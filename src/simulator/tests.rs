//! Fake model for the tests, and its inputs.

mod devices;
mod forces;
mod hand_over;
mod images;
mod recording;

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::{Policy, SimulatorOptions};
use insonify_mechanics::insertion::{
    Field, Instruments, LevelChange, Model, NodeSolver, Outcome, Saved, Snapshot, StepError, Tissue,
};
use insonify_mechanics::tissue::remesh::Level;
use insonify_mesh::TetMesh;

/// Counts of the calls to a fake model.
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
    /// Entry point of the needle, mm.
    entry: Vector3<f64>,
    asked: Arc<Asked>,
}

struct FakeNodeSolver {
    mesh: Option<Arc<TetMesh>>,
    asked: Arc<Asked>,
}

impl NodeSolver for FakeNodeSolver {
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
        // Bits affected by any difference in the inputs.
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
            (0.0, Point3::new(0.0, 0.0, mark) + self.entry),
            (1.0 + mark, Point3::new(1.0, 0.0, mark) + self.entry),
        ]);
        into.seeds.clear();
        into.seeds
            .resize(self.step as usize % 7, Point3::new(mark, 0.0, 0.0) + self.entry);
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

    fn imager(&self) -> Box<dyn NodeSolver> {
        self.asked.imagers.fetch_add(1, Ordering::Relaxed);
        Box::new(FakeNodeSolver {
            mesh: self.mesh.clone(),
            asked: self.asked.clone(),
        })
    }

    fn set_level(&mut self, level: Level) -> Result<LevelChange, StepError> {
        self.state += 1.0;
        Ok(LevelChange {
            from: Level::Exact,
            to: level,
            compliance_change: 0.0,
            force_jump_n: 1.0,
            seconds: 0.0,
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

fn patient() -> SimulatorOptions {
    SimulatorOptions {
        budget: Duration::from_secs(60),
        policy: Policy::Finish,
        probe_points: None,
    }
}
