//! Steps, hand-overs and frames of a simulator.

use std::sync::Arc;

use insonify::simulator::{Simulator, SimulatorOptions};
use insonify_imaging::synth::Synthesizer;
use insonify_mechanics::insertion::{
    Field, Instruments, Model, NodeSolver, Outcome, Saved, Snapshot, StepError, Tissue,
};
use insonify_mesh::TetMesh;
use nalgebra::{Isometry3, Matrix4, Point3};

/// A needle that advances with two seeds behind it, and tissue that swings.
struct Fake {
    mesh: Arc<TetMesh>,
    outcome: Outcome,
    steps: u64,
}

struct Swing(Arc<TetMesh>);

impl NodeSolver for Swing {
    fn elements(&self) -> &[[u32; 4]] {
        self.0.elements()
    }

    fn tissue(&mut self, snapshot: &Snapshot, into: &mut Tissue) {
        let by = (0.1 * snapshot.step as f64).sin();
        into.reference.clear();
        into.reference.extend_from_slice(self.0.nodes());
        into.current.clear();
        into.current
            .extend(self.0.nodes().iter().map(|&[x, y, z]| [x + by, y, z]));
    }
}

impl Model for Fake {
    fn step(&mut self, _: &Instruments, _: f64) -> Result<&Outcome, StepError> {
        self.steps += 1;
        Ok(&self.outcome)
    }

    fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    fn snapshot(&mut self, into: &mut Snapshot) {
        into.step = self.steps;
        let depth = (self.steps % 20) as f64;
        into.line.set([
            (0.0, Point3::new(0.0, -20.0, 0.0)),
            (30.0 + depth, Point3::new(0.0, 10.0 + depth, 0.0)),
        ]);
        into.seeds.clear();
        into.seeds
            .extend([[0.0, 12.0, 0.0], [0.0, 16.0, 0.0]].map(Point3::from));
        if let Field::BaseForces(forces) = &mut into.field {
            forces.clear();
            forces.extend((0..50).map(|dof| (dof, depth)));
        }
    }

    fn imager(&self) -> Box<dyn NodeSolver> {
        Box::new(Swing(Arc::clone(&self.mesh)))
    }

    fn save(&mut self) -> Saved {
        Saved(self.steps.into())
    }

    fn restore(&mut self, saved: &Saved) -> Result<(), StepError> {
        self.steps = saved
            .0
            .as_u64()
            .ok_or_else(|| StepError::Foreign(saved.0.to_string()))?;
        Ok(())
    }
}

/// Ten steps a frame, again and again.
pub(crate) fn rounds(synthesizer: Synthesizer, probe_to_world: Matrix4<f64>, frames: usize) -> impl FnMut() + Send {
    let mesh = synthesizer.tables().anatomy.mesh.clone().expect("a mesh");
    let model = Fake {
        mesh,
        outcome: Outcome::default(),
        steps: 0,
    };
    let simulator = Simulator::new(Box::new(model), synthesizer, 1.2, SimulatorOptions::default());
    let (mut haptic, mut imaging) = simulator.expect("a simulator").split();
    let instruments = Instruments {
        base: Isometry3::identity(),
        probe: None,
        guide: None,
        deposit: false,
    };
    move || {
        for _ in 0..frames {
            for _ in 0..10 {
                haptic.step(&instruments, 1e-3).expect("a step");
            }
            imaging.frame(&probe_to_world).expect("a frame");
        }
    }
}
