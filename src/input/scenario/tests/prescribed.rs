//! A model with a prescribed response.

use nalgebra::{Point3, Vector3};

use crate::input::scenario::Scenario;
use insonify_mechanics::insertion::{
    Event, EventKind, Field, Instruments, Model, NodeSolver, Outcome, Saved, Snapshot, StepError, Tissue, Wrench,
};
use insonify_mechanics::needle::CentreLine;
use insonify_mesh::TetMesh;

/// Holds the tip at its unloaded position, and pushes on the hand in proportion to depth.
pub(super) struct PrescribedModel {
    outcome: Outcome,
    line: CentreLine,
    seeds: Vec<Point3<f64>>,
    steps: u64,
    length_mm: f64,
    mesh: TetMesh,
}

impl PrescribedModel {
    pub(super) fn new(scenario: &Scenario) -> Self {
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

impl Model for PrescribedModel {
    fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
        self.steps += 1;
        let base = Point3::from(instruments.base.translation.vector);
        let tip = instruments.base * Point3::new(0.0, 0.0, self.length_mm);
        self.line.set([(0.0, base), (self.length_mm, tip)]);
        // Between two steps, so that rounding has no influence.
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

    fn imager(&self) -> Box<dyn NodeSolver> {
        Box::new(Rest(self.mesh.clone()))
    }

    fn save(&mut self) -> Saved {
        Saved(serde_json::Value::Null)
    }

    fn restore(&mut self, _saved: &Saved) -> Result<(), StepError> {
        Ok(())
    }
}

/// Tissue at rest that reports seven inverted elements.
struct Rest(TetMesh);

impl NodeSolver for Rest {
    fn elements(&self) -> &[[u32; 4]] {
        self.0.elements()
    }

    fn tissue(&mut self, _snapshot: &Snapshot, into: &mut Tissue) {
        into.reference = self.0.nodes().to_vec();
        into.current = self.0.nodes().to_vec();
        into.inverted = 7;
    }
}
