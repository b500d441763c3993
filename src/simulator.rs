//! Embedding API: tissue, needle and probe at haptic rate, images at their own rate.
//!
//! A [`Haptic`] steps a [`Model`] on the caller's thread and returns forces. An [`Imaging`] renders frames of it on
//! another thread, each from the latest complete state: a step publishes its state through a lock-free triple buffer,
//! so neither thread waits for the other and no frame shows half a step. A [`Simulator`] is both, to drive them in
//! turn or to [split](Simulator::split) them. Without images, a [`Haptic`] is used alone: then no state is published
//! or requested from the model.
//!
//! Further support for haptic devices: a probe's pose from [`TwoPoints`] and the force on each, a [`Damper`], a
//! [`LateralHold`], and a needle [`TemplateGuided`] by a template whose holes one device visits in turn.
//!
//! Frames of reference and signs of forces are stated by [`Forces`], late steps by [`Policy`], saving and replaying by
//! [`SimulatorState`](crate::SimulatorState) and [`Recording`](crate::Recording); `insonify insert --replay` repeats a
//! recording of a scenario, to score and to image it.

//!
//! Models and needles can be written outside of this crate. A needle of one's own in a model of it, and a model of
//! one's own, of tissue beyond z = 0 that does not move:
//!
//! ```
//! use insonify::{
//!     CentreLine, Entry, Haptic, Instruments, Interaction, Load, MassSpring, MassSpringParameters, MeshRegions, Model,
//!     MovedTissue, Needle, NodeSolver, Outcome, Saved, SimulatorOptions, Snapshot, StepError, TetMesh,
//! };
//! use nalgebra::{Isometry3, Point3, Vector3};
//!
//! /// A stiff needle, bent once by 5 mm.
//! #[derive(Debug)]
//! struct Bent;
//!
//! impl Needle for Bent {
//!     fn length_mm(&self) -> f64 {
//!         200.0
//!     }
//!     fn radius_mm(&self) -> f64 {
//!         0.6
//!     }
//!     fn place(&mut self, base: &Isometry3<f64>, _: Option<&Entry>, _: &[Load], _: &[Load], line: &mut CentreLine) {
//!         let nodes = [[0.0, 0.0, 0.0], [5.0, 0.0, 100.0], [0.0, 0.0, 200.0]];
//!         line.set(nodes.map(|node| (node[2], base * Point3::from(node))));
//!     }
//! }
//!
//! /// A needle of 100 mm, held by 0.02 N a millimetre.
//! #[derive(Default)]
//! struct Friction {
//!     base: Isometry3<f64>,
//!     outcome: Outcome,
//! }
//!
//! impl Model for Friction {
//!     fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<&Outcome, StepError> {
//!         instruments.check(dt_s)?;
//!         self.base = instruments.base;
//!         self.outcome.tip_mm = self.base * Point3::new(0.0, 0.0, 100.0);
//!         self.outcome.inserted_mm = self.outcome.tip_mm.z.max(0.0);
//!         self.outcome.on_hand.force_n = self.base * Vector3::z() * (-0.02 * self.outcome.inserted_mm);
//!         Ok(&self.outcome)
//!     }
//!     fn outcome(&self) -> &Outcome {
//!         &self.outcome
//!     }
//!     fn snapshot(&mut self, into: &mut Snapshot) {
//!         let shaft = [0.0, 100.0].map(|arc_mm| (arc_mm, self.base * Point3::new(0.0, 0.0, arc_mm)));
//!         into.line.set(shaft);
//!     }
//!     fn imager(&self) -> Box<dyn NodeSolver> {
//!         Box::new(Rest)
//!     }
//!     fn save(&mut self) -> Saved {
//!         Saved(serde_json::json!([self.base, self.outcome]))
//!     }
//!     fn restore(&mut self, saved: &Saved) -> Result<(), StepError> {
//!         let read = serde_json::from_value(saved.0.clone());
//!         (self.base, self.outcome) = read.map_err(|error| StepError::Foreign(error.to_string()))?;
//!         Ok(())
//!     }
//! }
//!
//! /// No mesh.
//! struct Rest;
//!
//! impl NodeSolver for Rest {
//!     fn elements(&self) -> &[[u32; 4]] {
//!         &[]
//!     }
//!     fn tissue(&mut self, _: &Snapshot, _: &mut MovedTissue) {}
//! }
//!
//! let mesh = TetMesh::over_box([-30.0, -30.0, 0.0], [30.0, 30.0, 60.0], 64)?.into();
//! let tissue = Interaction { friction_n_per_mm: 0.02, cutting_n: 0.5, puncture_n: 1.0, ..Interaction::default() };
//! let regions = MeshRegions::new(&mesh, &[(0, tissue)])?;
//! let parameters = MassSpringParameters { length_mm: Some(50.0), ..MassSpringParameters::default() };
//! let springs = MassSpring::new(parameters, Box::new(regions), Box::new(Bent))?;
//!
//! for (model, length_mm) in [(Box::new(springs) as Box<dyn Model>, 200.0), (Box::new(Friction::default()), 100.0)] {
//!     let mut haptic = Haptic::new(model, SimulatorOptions::default());
//!     for step in 0..60 {
//!         let base = Isometry3::translation(0.0, 0.0, 0.4 * f64::from(step) - length_mm - 1.0);
//!         haptic.step(&Instruments::new(base), 1e-3)?;
//!     }
//!     assert!((haptic.outcome().tip_mm.z - 22.6).abs() < 0.1 && haptic.outcome().on_hand.force_n.z < -0.1);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod devices;
mod forces;
mod haptic;
mod imaging;
#[cfg(test)]
mod tests;

use std::time::Duration;

use nalgebra::Matrix4;

use crate::Error;
use crate::input::scenario::Scenario;
pub use devices::{Damper, HoldOptions, LateralHold, PointsPose, TemplateGuided, TwoPoints};
pub use forces::Forces;
pub use haptic::Haptic;
pub use imaging::Imaging;
use insonify_base::blame::Blame;
use insonify_imaging::synth::{Backend, Frame, SynthError, Synthesizer};
use insonify_mechanics::insertion::{Instruments, LevelChange, Model, StepError};
use insonify_mechanics::tissue::remesh::Level;
use insonify_tracking::template::UnknownHole;

/// Why a device, a hole or a model to be imaged is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimulatorError {
    /// A parameter or measurement out of range.
    #[error("`{key}` is {found}; expected {expected}")]
    Value {
        /// Name of the value.
        key: &'static str,
        /// The rejected value.
        found: String,
        /// Permitted values.
        expected: String,
    },
    /// The imaged mesh is not that of the model.
    #[error("{0}")]
    Mesh(String),
    /// The needle is in the body: it can change its hole only outside.
    #[error("the needle touches tissue, {inserted_mm:.1} mm deep; expected it outside before another hole is chosen")]
    Inserted {
        /// Depth of the tip, mm.
        inserted_mm: f64,
    },
    /// There is no such hole.
    #[error(transparent)]
    Hole(#[from] UnknownHole),
}

impl Blame for SimulatorError {}

impl SimulatorError {
    /// An error unless a value is finite and `holds`.
    fn check(key: &'static str, found: f64, holds: bool, expected: &str) -> Result<(), Self> {
        if found.is_finite() && holds {
            return Ok(());
        }
        let (found, expected) = (found.to_string(), expected.to_owned());
        Err(Self::Value { key, found, expected })
    }
}

/// Time budget of a step, and the policy for steps that exceed it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimulatorOptions {
    /// Time budget of a step, including the hand-over to the image. Default 1 ms.
    pub budget: Duration,
    /// Forces returned by a step that exceeds the budget. Default [`Policy::Finish`].
    pub policy: Policy,
    /// Two points that drive the probe, between which [`Forces::probe_points`] splits its force. Default none.
    pub probe_points: Option<TwoPoints>,
}

impl Default for SimulatorOptions {
    fn default() -> Self {
        Self {
            budget: Duration::from_millis(1),
            policy: Policy::Finish,
            probe_points: None,
        }
    }
}

/// Forces returned by a step that exceeds its budget.
///
/// Under either policy the step is completed, so that the state does not depend on the clock, and [`Forces::overrun`]
/// is the excess time. While the caller waits, a device continues with the previous forces; by the time the late ones
/// arrive, the instruments may have moved far, and the forces jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// Returns the forces of the step unchanged.
    Finish,
    /// Blends linearly from the previous forces to those of the model over this much simulated time, starting at the
    /// late step. If every step is late, forces follow the model as through a low-pass filter of this time constant:
    /// they lag, but neither jump nor freeze.
    Ease {
        /// Simulated duration of the blend.
        over: Duration,
    },
}

/// Steps and images of one model, on one or two threads.
///
/// The [crate] has an example on one thread. On two, for a scenario:
///
/// ```
/// use insonify::{Backend, ScenarioFile, Simulator, SimulatorOptions};
///
/// # let text = r#"
/// # version = 2
/// # [scene]
/// # volume = { phantom = "two-layer", resolution_mm = 3.0 }
/// # image = { width = 160, height = 120 }
/// # [tissue]
/// # model = "mass-spring"
/// # [[needle.motion.keyframes]]
/// # time_s = 0.0
/// # tip_mm = [8.0, 0.0, -46.0]
/// # direction = [0.0, 0.0, 1.0]
/// # [[needle.motion.keyframes]]
/// # time_s = 0.1
/// # tip_mm = [8.0, 0.0, -26.0]
/// # direction = [0.0, 0.0, 1.0]
/// # "#;
/// # let scenario = ScenarioFile::parse(text, "insert.toml")?.resolve(".".as_ref(), |_| ())?;
/// let simulator = Simulator::of_scenario(&scenario, Backend::Cpu, SimulatorOptions::default())?;
/// let (mut haptic, mut imaging) = simulator.split();
/// let view = *scenario.scene.probe_pose(0, 1).probe_to_world();
/// std::thread::scope(|scope| {
///     // Here one frame; in a simulator, as many as there is time for.
///     let images = scope.spawn(move || imaging.frame(&view).map(|frame| frame.pixels.len()));
///     for step in 1..=scenario.timing.steps {
///         haptic.step(&scenario.instruments(step), scenario.timing.dt_s)?;
///     }
///     assert_eq!(images.join().expect("no panic")?, 160 * 120);
///     Ok::<(), Box<dyn std::error::Error>>(())
/// })?;
/// assert!(haptic.outcome().inserted_mm > 10.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Simulator {
    haptic: Haptic,
    imaging: Imaging,
}

impl Simulator {
    /// Joins a model and its imaging. `synthesizer` has the mesh of the model, in the same order, if moving tissue is
    /// to be visible. The needle, whose diameter is `needle_diameter_mm`, is drawn unless its settings leave out
    /// [`Effects::needle`](crate::Effects); each [`Frame::needle`] says what is seen of it.
    ///
    /// # Errors
    /// [`SimulatorError`].
    pub fn new(
        model: Box<dyn Model>,
        synthesizer: Synthesizer,
        needle_diameter_mm: f64,
        options: SimulatorOptions,
    ) -> Result<Self, SimulatorError> {
        let mut haptic = Haptic::new(model, options);
        let imaging = haptic.imaged(synthesizer, needle_diameter_mm)?;
        Ok(Self { haptic, imaging })
    }

    /// Builds the simulator of a scenario: its model, its scene on a backend, its needle.
    ///
    /// # Errors
    /// The errors of [`Scenario::model`], [`Synthesizer::new`] and [`Simulator::new`].
    pub fn of_scenario(scenario: &Scenario, backend: Backend, options: SimulatorOptions) -> Result<Self, Error> {
        let synthesizer = scenario.scene.synthesizer(backend)?;
        let model = scenario.model(|_, _| {})?;
        Ok(Self::new(model, synthesizer, scenario.needle.diameter_mm, options)?)
    }

    /// Makes one step; see [`Haptic::step`].
    ///
    /// # Errors
    /// The errors of [`Haptic::step`].
    pub fn step(&mut self, instruments: &Instruments, dt_s: f64) -> Result<Forces, StepError> {
        self.haptic.step(instruments, dt_s)
    }

    /// Changes the remeshing level; see [`Haptic::set_level`].
    ///
    /// # Errors
    /// The errors of [`Haptic::set_level`].
    pub fn set_level(&mut self, level: Level) -> Result<LevelChange, StepError> {
        self.haptic.set_level(level)
    }

    /// Renders a frame; see [`Imaging::frame`].
    ///
    /// # Errors
    /// The errors of [`Imaging::frame`].
    pub fn frame(&mut self, probe_to_world: &Matrix4<f64>) -> Result<&Frame, SynthError> {
        self.imaging.frame(probe_to_world)
    }

    /// Returns the stepping part, to save, restore, record and replay.
    pub fn haptic(&mut self) -> &mut Haptic {
        &mut self.haptic
    }

    /// Splits into the part for the haptic thread and the part for the image thread.
    pub fn split(self) -> (Haptic, Imaging) {
        (self.haptic, self.imaging)
    }
}
